/** Columns, pages and the order of rows for `components/Table.svelte`. */
import type { Snippet } from 'svelte'
import type { Ordered } from './order'

export { arrange, type Sorting } from './order'

export interface Column<Row> extends Ordered<Row> {
  label: string
  /** Shown in the header. */
  unit?: string
  /** What the numbers are of (held-out, cross-validated, predicted): shown on hover. */
  note?: string
  /** Least width in px (96 if not given), and how much of spare width it takes (1). */
  width?: number
  grow?: number
  align?: 'left' | 'right'
  sortable?: boolean
  /** Decimals of numbers. */
  decimals?: number
  /** Shown instead of the value. */
  cell?: Snippet<[Row]>
}

export interface PageRequest {
  offset: number
  limit: number
  sort: string | null
  descending: boolean
  filter: string
  signal: AbortSignal
}

export type PageSource<Row> = (request: PageRequest) => Promise<{ rows: Row[]; total: number }>

const PAGE = 200
const KEPT = 40

type Question = Pick<PageRequest, 'sort' | 'descending' | 'filter'>

/** Pages of rows that the server holds: asked for when they come into view, the oldest dropped. */
export class RowPages<Row> {
  total = $state(0)
  loading = $state(false)
  #version = $state(0)
  #pages = new Map<number, Row[]>()
  #asked = new Set<number>()
  #source: PageSource<Row> | null = null
  #question: Question = { sort: null, descending: false, filter: '' }
  #abort = new AbortController()
  #timer: ReturnType<typeof setTimeout> | undefined
  #failed: (error: unknown) => void

  constructor(failed: (error: unknown) => void) {
    this.#failed = failed
  }

  /** Begin again with another source, order or filter. */
  start(source: PageSource<Row>, question: Question): void {
    const typing = source === this.#source && question.filter !== this.#question.filter
    this.#abort.abort()
    this.#abort = new AbortController()
    this.#source = source
    this.#question = question
    this.#pages.clear()
    this.#asked.clear()
    this.loading = true
    clearTimeout(this.#timer)
    this.#timer = setTimeout(() => this.#ask(0), typing ? 150 : 0)
  }

  row(index: number): Row | undefined {
    void this.#version // a page that arrives shows its rows
    return this.#pages.get(Math.floor(index / PAGE))?.[index % PAGE]
  }

  /** Ask for the pages of the rows in view, once the scrolling pauses. */
  need(first: number, last: number): void {
    if (last <= first) return
    clearTimeout(this.#timer)
    this.#timer = setTimeout(() => {
      for (let page = Math.floor(first / PAGE); page <= Math.floor((last - 1) / PAGE); page++) this.#ask(page)
    }, 40)
  }

  #ask(page: number): void {
    if (!this.#source || this.#pages.has(page) || this.#asked.has(page)) return
    this.#asked.add(page)
    const { signal } = this.#abort
    this.#source({ offset: page * PAGE, limit: PAGE, ...this.#question, signal })
      .then(({ rows, total }) => {
        if (signal.aborted) return
        this.#keep(page, rows)
        this.total = total
        this.loading = false
      })
      .catch((error: unknown) => {
        if (signal.aborted) return
        this.#asked.delete(page)
        this.loading = false
        this.#failed(error)
      })
  }

  #keep(page: number, rows: Row[]): void {
    this.#pages.set(page, rows)
    this.#asked.delete(page)
    if (this.#pages.size > KEPT) this.#pages.delete(this.#pages.keys().next().value as number)
    this.#version++
  }
}
