/** The cells of the workspace, shared by the picker and the pages. Call `loadCells` after making or renaming one. */
import { raw } from './api'
import { go, route } from './router.svelte'

export interface CellEntry {
  id: string
  name: string
}

const state = $state<{ list: CellEntry[]; loaded: boolean }>({ list: [], loaded: false })

export const cells = {
  get list(): CellEntry[] {
    return state.list
  },
  get loaded(): boolean {
    return state.loaded
  },
  /** The cell of the address. */
  get current(): CellEntry | undefined {
    return state.list.find((cell) => cell.id === route.cell)
  },
}

/** Read the list again; chooses the first cell when the address names none that exists. */
export async function loadCells(): Promise<void> {
  state.list = await raw('get', '/api/v1/cells')
  state.loaded = true
  if (!cells.current) go({ cell: state.list[0]?.id ?? null }, { replace: true })
}
