/** Problems and short news, shown in a corner until the user closes them (news go on their own). */
import { ApiError, type Problem } from './api'

export interface Notice {
  id: number
  kind: 'problem' | 'news'
  title: string
  problem?: Problem
}

const list = $state<Notice[]>([])
const session = $state({ lost: false, users: false })
let last = 0

export const notices: readonly Notice[] = list

/** Whether the server does not know this browser (any more): only the start address helps. */
export const sessionLost = (): boolean => session.lost

/** Whether users of this server log in by name and password. */
export const loginNeeded = (): boolean => session.lost && session.users

/** Say that this browser has no session, and whether users of this server log in. */
export function askToEnter(users: boolean): void {
  session.lost = true
  session.users = users
}

/** Show what went wrong: title, detail, file and line, remedy. Aborted requests are no problem. */
export function showProblem(error: unknown): void {
  if (error instanceof DOMException && error.name === 'AbortError') return
  if (error instanceof ApiError && error.status === 401) {
    askToEnter(Boolean(error.problem['users']))
  } else if (error instanceof ApiError) add({ kind: 'problem', title: error.problem.title, problem: error.problem })
  else add({ kind: 'problem', title: error instanceof Error ? error.message : String(error) })
}

/** Tell a result in one line; screen readers read it too. */
export function showNews(title: string): void {
  const id = add({ kind: 'news', title })
  setTimeout(() => closeNotice(id), 6000)
}

export function closeNotice(id: number): void {
  const index = list.findIndex((notice) => notice.id === id)
  if (index >= 0) list.splice(index, 1)
}

/** Run something that may fail and show its problem; undefined when it failed. */
export async function attempt<T>(work: () => Promise<T>): Promise<T | undefined> {
  try {
    return await work()
  } catch (error) {
    showProblem(error)
    return undefined
  }
}

let region: HTMLElement | undefined
const places: HTMLElement[] = []

/** Attached to the element that shows the notices. */
export function showNotices(element: HTMLElement): void {
  region = element
  if (element.parentElement) places.unshift(element.parentElement)
}

/** Attached to dialogs: an open dialog makes the rest of the page inert, so it holds the notices. */
export function hostNotices(dialog: HTMLElement): () => void {
  const settle = () => region && places.at(-1)?.append(region)
  places.push(dialog)
  settle()
  return () => {
    places.splice(places.indexOf(dialog), 1)
    settle()
  }
}

function add(notice: Omit<Notice, 'id'>): number {
  const same = list.find((other) => other.title === notice.title && other.problem?.detail === notice.problem?.detail)
  if (same) return same.id
  list.push({ ...notice, id: ++last })
  if (list.length > 5) list.shift()
  return last
}
