/** Outlines of 20 × 20, drawn with a stroke of 1.5. */
import type { PageName } from '../lib/router.svelte'

export const ICONS: Record<PageName, string> = {
  cell: 'M3 17h8M7 17v-6l6-5M13 6h3m-3 0V3M7 11m-1.500 0a1.500 1.500 0 1 0 3 0a1.500 1.500 0 1 0 -3 0',
  measure: 'M4 17l6-10 6 10M10 7V3M10 3m-1 0a1 1 0 1 0 2 0a1 1 0 1 0 -2 0M6.500 13h7',
  map: 'M3 3h14v14H3zM6 13l3-4M12 14V9M13 6l2 2M6 6h2',
  programs: 'M5 2.500h7l4 4v11H5zM12 2.500v4h4M7.500 10h6M7.500 13h6',
  verify: 'M10 3a7 7 0 1 0 7 7M6.500 9.500l3.500 3.500 7-8',
  report: 'M4 2.500h12v15H4zM7 13V10M10 13V7M13 13V9',
  release: 'M5 9h10v8H5zM7 9V6.500a3 3 0 0 1 6 0V9M10 12v2',
  users: 'M7 9m-2.500 0a2.500 2.500 0 1 0 5 0a2.500 2.500 0 1 0-5 0M2.500 17c0-6 9-6 9 0M13 10a2 2 0 1 0-1-3.800M13.500 12.500c3 0 4 2 4 4.500',
  history: 'M3.500 10a6.500 6.500 0 1 1 2 4.700M3.500 15.500v-4h4M10 6.500V10l2.500 2',
}
