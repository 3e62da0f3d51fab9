/**
 * Keys of the page. `?` lists all that hold now.
 *
 *   useKeys([{ key: 'm', text: () => t('map.key_mask'), run: mask }])     in a component: while it is shown
 *
 * Keys do nothing while the user types in a field or a dialog is open.
 */
import { onDestroy } from 'svelte'

export interface Key {
  /** As in KeyboardEvent.key: 'm', 'ArrowLeft', '/'. */
  key: string
  /** What it does, in the language shown. */
  text: () => string
  /** Left out for keys that a component handles itself (arrows of a table) and that are only listed. */
  run?: () => void
}

const groups = $state<{ list: Key[][] }>({ list: [] })

/** All keys that hold now. */
export const keys = {
  get list(): Key[] {
    return groups.list.flat()
  },
}

/** Add keys as long as the component lives. */
export function useKeys(added: Key[]): void {
  groups.list = [...groups.list, added]
  const own = groups.list.at(-1)
  onDestroy(() => (groups.list = groups.list.filter((group) => group !== own)))
}

/** Run what a key stands for. */
export function pressed(event: KeyboardEvent): void {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return
  const target = event.target as HTMLElement
  if (target.closest('input:not([type=checkbox], [type=radio], [type=range]), select, textarea, [contenteditable], dialog')) return
  const key = keys.list.findLast((candidate) => candidate.key === event.key && candidate.run)
  if (!key?.run) return
  event.preventDefault()
  key.run()
}
