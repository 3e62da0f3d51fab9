/** The states of the maps of the cell in the store, for `components/MapState.svelte`; empty on a server without users. */
import { get, type Schemas } from './api'
import { jobs } from './jobs.svelte'
import { attempt } from './notices.svelte'
import { route } from './router.svelte'
import { user } from './user.svelte'

type States = Schemas['States']
export type FileState = States['maps'][string]
let current = $state.raw<States>({ maps: {}, files: {} })
let read = $state(0)

export const states = {
  get current(): States {
    return current
  },
}

/** Read the states again, after a signature. */
export function renewStates(): void {
  read++
}

/** Keep the states up to date: with the cell, the jobs, and signatures. Called once, by the frame of the pages. */
export function followStates(): void {
  const ended = $derived(jobs.list.filter((job) => job.state === 'done').length)
  $effect(() => {
    void [read, ended, route.page]
    const cell = route.cell
    if (!cell || !user.current) return
    void attempt(async () => {
      const found = await get('/api/v1/cells/{cell}/states', { path: { cell } })
      if (cell === route.cell) current = found
    })
  })
}
