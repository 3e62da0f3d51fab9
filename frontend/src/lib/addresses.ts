/** Addresses of pages: `#/PAGE/CELL/REST…?QUERY`. */
export const PAGES = ['cell', 'measure', 'map', 'programs', 'verify', 'report', 'history', 'release', 'users'] as const
export type PageName = (typeof PAGES)[number]

export interface Route {
  page: PageName
  /** Id of the chosen cell; null when there is none yet. */
  cell: string | null
  /** What follows the cell in the address. */
  rest: string[]
  query: Record<string, string>
}

export interface Destination {
  page?: PageName
  cell?: string | null
  rest?: string[]
  query?: Record<string, string | number | undefined>
}

export function parseAddress(hash: string): Route {
  const [path = '', search = ''] = hash.replace(/^#\/?/, '').split('?', 2)
  const [page, cell, ...rest] = path.split('/').map(decoded)
  return {
    page: PAGES.find((name) => name === page) ?? 'cell',
    cell: cell && cell !== '-' ? cell : null,
    rest: rest.filter(Boolean),
    query: Object.fromEntries(new URLSearchParams(search)),
  }
}

/** The address of a destination; page and cell are those of `now` unless given. */
export function address(to: Destination, now: Pick<Route, 'page' | 'cell'>): string {
  const cell = to.cell === undefined ? now.cell : to.cell
  const path = [to.page ?? now.page, cell ?? '-', ...(to.rest ?? [])].map(encodeURIComponent).join('/')
  const query = new URLSearchParams()
  for (const [name, value] of Object.entries(to.query ?? {})) if (value !== undefined) query.set(name, String(value))
  const search = query.toString()
  return `#/${path}${search ? `?${search}` : ''}`
}

function decoded(part: string): string {
  try {
    return decodeURIComponent(part)
  } catch {
    return part // a stray per cent sign that somebody typed
  }
}
