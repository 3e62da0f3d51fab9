/**
 * Hash routes: `#/PAGE/CELL/REST…?QUERY`, for example `#/map/1f0c3a5b7d9e/joints?before=0`.
 * Pages read `route` (reactive) and move with `go` or with links to `href(…)`.
 */
export const PAGES = ['cell', 'measure', 'map', 'programs', 'verify', 'report', 'history'] as const
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

export function parseRoute(hash: string): Route {
  const [path = '', search = ''] = hash.replace(/^#\/?/, '').split('?', 2)
  const [page, cell, ...rest] = path.split('/').map(decodeURIComponent)
  return {
    page: PAGES.find((name) => name === page) ?? 'cell',
    cell: cell && cell !== '-' ? cell : null,
    rest: rest.filter(Boolean),
    query: Object.fromEntries(new URLSearchParams(search)),
  }
}

const current = $state({ route: parseRoute(location.hash) })
addEventListener('hashchange', () => (current.route = parseRoute(location.hash)))

/** The route shown now. Its properties are reactive. */
export const route: Readonly<Route> = {
  get page() {
    return current.route.page
  },
  get cell() {
    return current.route.cell
  },
  get rest() {
    return current.route.rest
  },
  get query() {
    return current.route.query
  },
}

/** The address of a page; page and cell are those shown now unless given. */
export function href(to: Destination): string {
  const page = to.page ?? current.route.page
  const cell = to.cell === undefined ? current.route.cell : to.cell
  const path = [page, cell ?? '-', ...(to.rest ?? [])].map(encodeURIComponent).join('/')
  const query = new URLSearchParams()
  for (const [name, value] of Object.entries(to.query ?? {})) if (value !== undefined) query.set(name, String(value))
  const search = query.toString()
  return `#/${path}${search ? `?${search}` : ''}`
}

/** Show another page or place; `replace` leaves no entry in the browser's history. */
export function go(to: Destination, { replace = false } = {}): void {
  const hash = href(to)
  if (replace) {
    history.replaceState(null, '', hash)
    current.route = parseRoute(hash)
  } else location.hash = hash
}
