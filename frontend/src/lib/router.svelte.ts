/**
 * Hash routes: `#/PAGE/CELL/REST…?QUERY`, for example `#/map/1f0c3a5b7d9e/joints?before=0`.
 * Pages read `route` (reactive) and move with `go` or with links to `href(…)`.
 */
import { address, parseAddress, type Destination, type Route } from './addresses'

export { PAGES, type Destination, type PageName, type Route } from './addresses'

const current = $state({ route: parseAddress(location.hash) })
addEventListener('hashchange', () => (current.route = parseAddress(location.hash)))

// a page is not made again when only the rest of the address changes
const page = $derived(current.route.page)
const cell = $derived(current.route.cell)

/** The route shown now. Its properties are reactive. */
export const route: Readonly<Route> = {
  get page() {
    return page
  },
  get cell() {
    return cell
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
  return address(to, current.route)
}

/** Show another page or place; `replace` leaves no entry in the browser's history. */
export function go(to: Destination, { replace = false } = {}): void {
  const hash = href(to)
  if (replace) {
    history.replaceState(null, '', hash)
    current.route = parseAddress(hash)
  } else location.hash = hash
}
