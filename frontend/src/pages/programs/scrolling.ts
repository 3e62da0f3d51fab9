/** Bring a row of a long table into view; the table itself keeps only the rows in view in the page. */
export function showRow(host: HTMLElement, index: number, total: number): void {
  const grid = host.querySelector<HTMLElement>('[role="grid"]')
  if (grid && total) grid.scrollTop = (index / total) * grid.scrollHeight - grid.clientHeight / 3
}
