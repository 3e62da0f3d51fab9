/**
 * The cell file while it is edited: one text, which the form and the text view both change. The server applies changes
 * of single keys to the text (comments and order stay) and checks it; nothing is written before `save`.
 *
 * Editors live as long as the application, so that a page that is left and opened again still has what was typed.
 */
import { ApiError, call, post, type Schemas } from '../../lib/api'
import { showProblem } from '../../lib/notices.svelte'

export type Path = readonly string[]
type Text = Schemas['CellText']
export type KeyProblem = Schemas['KeyProblem']

export interface Conflict {
  current: string
  yours: string
  etag: string
}

const editors = new Map<string, CellEditor>()

/** The editor of a cell; the same one until the page is loaded again. */
export function editorOf(cell: string): CellEditor {
  let found = editors.get(cell)
  if (!found) editors.set(cell, (found = new CellEditor(cell)))
  return found
}

/** Whether any cell has changes that are not saved. */
export function unsaved(): boolean {
  return [...editors.values()].some((editor) => editor.dirty)
}

export class CellEditor {
  readonly cell: string
  loaded = $state(false)
  saving = $state(false)
  conflict = $state<Conflict | null>(null)
  name = $state('')
  command = $state('')
  schema = $state.raw<Record<string, unknown>>({})
  #state = $state.raw<Text>({ text: '', values: {}, problems: [], controller: null, angles: [], axes: null })
  #saved = $state('')
  #etag = ''
  #past = $state.raw<readonly string[]>([])
  #future = $state.raw<readonly string[]>([])
  #queue: Promise<void> = Promise.resolve()
  #timer: ReturnType<typeof setTimeout> | undefined

  constructor(cell: string) {
    this.cell = cell
  }

  get text(): string {
    return this.#state.text
  }
  get problems(): readonly KeyProblem[] {
    return this.#state.problems
  }
  get angles(): readonly string[] {
    return this.#state.angles
  }
  get axes(): number {
    return this.#state.axes ?? 6
  }
  /** Whether the text is TOML, so that its keys can be changed one by one. */
  get readable(): boolean {
    return this.#state.values !== null
  }
  get dirty(): boolean {
    return this.loaded && this.#state.text !== this.#saved
  }
  get canUndo(): boolean {
    return this.#past.length > 0
  }
  get canRedo(): boolean {
    return this.#future.length > 0
  }

  /** What the text states at a place. */
  value(path: Path): unknown {
    let at: unknown = this.#state.values
    for (const key of path) at = typeof at === 'object' && at !== null ? (at as Record<string, unknown>)[key] : undefined
    return at
  }

  /** The names of the tables in a table. */
  names(path: Path): string[] {
    const found = this.value(path)
    return typeof found === 'object' && found !== null && !Array.isArray(found) ? Object.keys(found) : []
  }

  /** What is wrong with a key; of a table also what is wrong with the table as a whole. */
  problem(path: Path): string | null {
    const wanted = path.join('\n')
    return this.problems.find((one) => one.path.join('\n') === wanted)?.message ?? null
  }

  /** The number of problems in a table, such as "tool" or "frames.groups". */
  count(table: string): number {
    return this.problems.filter((one) => `${one.path.join('.')}.`.startsWith(`${table}.`)).length
  }

  /** Read the file, unless there are changes that are not saved. */
  async load(): Promise<void> {
    if (this.dirty) return
    const { data, etag } = await call('get', '/api/v1/cells/{cell}', { path: { cell: this.cell } })
    if (this.loaded && etag === this.#etag) return
    this.#take(data, etag)
    this.#past = []
    this.#future = []
  }

  /** Change keys; null removes one. */
  change(...changes: { path: Path; value: unknown }[]): Promise<void> {
    return this.#next(async () => {
      const sent = changes.map(({ path, value }) => ({ path: [...path], value: value as never }))
      const body = { text: this.text, changes: sent }
      this.#show(await post('/api/v1/cells/{cell}/check', { path: { cell: this.cell }, body }))
    })
  }

  /** Take the text of the text view; it is checked when the typing pauses. */
  type(text: string): void {
    if (text === this.text) return
    this.#show({ ...this.#state, text }, this.#timer !== undefined)
    clearTimeout(this.#timer)
    this.#timer = setTimeout(() => {
      this.#timer = undefined
      void this.#check()
    }, 300)
  }

  undo(): Promise<void> {
    return this.#travel(this.#past, (past) => (this.#past = past), () => (this.#future = [...this.#future, this.text]))
  }

  redo(): Promise<void> {
    return this.#travel(this.#future, (rest) => (this.#future = rest), () => (this.#past = [...this.#past, this.text]))
  }

  /** Write the text; false if the server did not take it. */
  save(): Promise<boolean> {
    let written = false
    return this.#next(async () => {
      this.saving = true
      try {
        const body = { text: this.text, changes: [] }
        const { data, etag } = await call('put', '/api/v1/cells/{cell}', {
          path: { cell: this.cell },
          body,
          etag: this.#etag,
        })
        this.#take(data, etag)
        written = true
      } catch (error) {
        if (!(error instanceof ApiError) || error.status !== 412) throw error
        const { current, yours, etag } = error.problem as unknown as Conflict
        this.conflict = { current, yours, etag }
      } finally {
        this.saving = false
      }
    }).then(() => written)
  }

  /** End a conflict: with the text that was saved meanwhile (undo gives back one's own), or with one's own over it. */
  async resolve(keep: 'current' | 'yours'): Promise<void> {
    const conflict = this.conflict
    if (!conflict) return
    this.conflict = null
    this.#etag = conflict.etag
    this.#saved = conflict.current
    if (keep === 'yours') await this.save()
    else {
      this.#show({ ...this.#state, text: conflict.current })
      await this.#check()
    }
  }

  #check(): Promise<void> {
    return this.#next(async () => {
      const asked = this.text
      const found = await post('/api/v1/cells/{cell}/check', { path: { cell: this.cell }, body: { text: asked, changes: [] } })
      if (this.text === asked) this.#state = found
    })
  }

  #travel(from: readonly string[], keep: (rest: readonly string[]) => void, remember: () => void): Promise<void> {
    const text = from.at(-1)
    if (text === undefined) return Promise.resolve()
    remember()
    keep(from.slice(0, -1))
    this.#state = { ...this.#state, text }
    return this.#check()
  }

  #show(found: Text, same = false): void {
    if (found.text !== this.text && !same) {
      this.#past = [...this.#past.slice(-199), this.text]
      this.#future = []
    }
    this.#state = found
  }

  #take(data: Schemas['CellDocument'], etag: string | null): void {
    this.#state = data
    this.#saved = data.text
    this.#etag = etag ?? ''
    this.name = data.name
    this.command = data.command
    this.schema = data.schema
    this.loaded = true
  }

  /** Do one thing after the other, so that no answer overtakes another. */
  #next(work: () => Promise<void>): Promise<void> {
    this.#queue = this.#queue.then(work).catch(showProblem)
    return this.#queue
  }
}
