/** The cells of the workspace, shared by the picker and the pages. Call `loadCells` after making or renaming one. */
import { get, post, type Schemas } from './api'
import { runJob, type Job } from './jobs.svelte'
import { go, route } from './router.svelte'

export type CellEntry = Schemas['CellSummary']

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

/** Read the list again. */
export async function loadCells(): Promise<void> {
  state.list = await get('/api/v1/cells')
  state.loaded = true
}

/** The job that makes the virtual cell, while it runs. */
export const virtualCell = $state<{ job: Job | null }>({ job: null })

/** Open the virtual cell; make one if the workspace holds none. */
export async function openVirtualCell(): Promise<void> {
  let id = state.list.find((cell) => cell.name === 'virtual-cell')?.id
  if (id === undefined) {
    try {
      const job = await runJob(post('/api/v1/cells/virtual'), { onProgress: (news) => (virtualCell.job = news) })
      id = job.cell
    } finally {
      virtualCell.job = null
    }
  }
  await loadCells()
  go({ cell: id, rest: [] })
}
