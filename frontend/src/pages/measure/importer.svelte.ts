/** The import of a measurement file while its settings are chosen: every change asks the server what would come of it. */
import { ApiError, upload, type Schemas } from '../../lib/api'
import { showProblem } from '../../lib/notices.svelte'
import type { PathFile } from '../../lib/files'
import { runJob, type Job } from '../../lib/jobs.svelte'

export type Preview = Schemas['ReadingsPreview']
export type Residual = Schemas['Residual']
export type Quantity = 'x' | 'y' | 'z' | 'name' | 'time'
export type Columns = Partial<Record<Quantity, number>>
export const PERMISSIONS = ['reorder', 'missing', 'two_stations', 'accept_campaign'] as const
export type Permission = (typeof PERMISSIONS)[number]
export const UNITS = ['mm', 'm', 'cm', 'in'] as const

interface Masked {
  row: number
  point: string | null
  reason: string
}

export class Importer {
  readonly cell: string
  file = $state.raw<PathFile | null>(null)
  plan = $state('')
  /** A plan that is sent with the readings, instead of one of the cell. */
  planFile = $state.raw<PathFile | null>(null)
  reflectors = $state<number | null>(null)
  keep = $state<number | null>(null)
  /** Columns that the user states; null: those that were recognised. */
  columns = $state.raw<Columns | null>(null)
  unit = $state('')
  permissions = $state.raw<ReadonlySet<Permission>>(new Set())
  masked = $state.raw<readonly Masked[]>([])
  preview = $state.raw<Preview | null>(null)
  asking = $state(false)
  job = $state.raw<Job | null>(null)
  #undone: (readonly Masked[])[] = $state.raw([])
  /** The ids of files that the server keeps, so that a change does not send them again. */
  #stored = new Map<File, string>()
  #abort = new AbortController()
  #timer: ReturnType<typeof setTimeout> | undefined

  constructor(cell: string) {
    this.cell = cell
  }

  get canUndo(): boolean {
    return this.#undone.length > 0
  }

  /** Whether the columns that the user chose can be sent. */
  get complete(): boolean {
    const { columns } = this
    return columns === null || (columns.x !== undefined && columns.y !== undefined && columns.z !== undefined)
  }

  take(file: PathFile): void {
    this.file = file
    this.columns = null
    this.unit = ''
    this.reflectors = this.keep = null
    this.permissions = new Set()
    this.masked = []
    this.#undone = []
    this.preview = null
    this.ask(0)
  }

  allow(permission: Permission, given: boolean): void {
    const now = new Set(this.permissions)
    if (given) now.add(permission)
    else now.delete(permission)
    this.permissions = now
    this.ask()
  }

  choose(quantity: Quantity, column: number | null): void {
    const known = Object.fromEntries(Object.entries(this.preview?.columns ?? {}).map(([what, places]) => [what, places[0]]))
    const now: Columns = { ...(this.columns ?? (known as Columns)) }
    if (column === null) delete now[quantity]
    else now[quantity] = column
    this.columns = now
    if (this.complete) this.ask()
  }

  mask(rows: readonly Residual[], reason: string): void {
    const gone = new Set(rows.map((row) => row.row))
    const added = rows.map(({ row, point }) => ({ row, point: point ?? null, reason }))
    this.#masks([...this.masked.filter((one) => !gone.has(one.row)), ...(reason ? added : [])])
  }

  undo(): void {
    const before = this.#undone.at(-1)
    if (!before) return
    this.#undone = this.#undone.slice(0, -1)
    this.masked = before
    this.ask()
  }

  #masks(now: readonly Masked[]): void {
    this.#undone = [...this.#undone, this.masked]
    this.masked = now
    this.ask()
  }

  /** Ask for the preview when the changes pause. */
  ask(wait = 200): void {
    clearTimeout(this.#timer)
    this.#timer = setTimeout(() => void this.#look(), wait)
  }

  async #look(): Promise<void> {
    if (!this.file) return
    this.#abort.abort()
    const abort = (this.#abort = new AbortController())
    this.asking = true
    try {
      const answer = await this.#send(true, abort.signal)
      if (!abort.signal.aborted) this.preview = answer as Preview
    } catch (error) {
      if (!abort.signal.aborted) showProblem(error)
    } finally {
      if (this.#abort === abort) this.asking = false
    }
  }

  /** Keep the file and import it; undefined if that failed. */
  async run(): Promise<Job | undefined> {
    try {
      const started = this.#send(false) as unknown as Promise<Job>
      return await runJob(started, { onProgress: (job) => (this.job = job) })
    } catch (error) {
      showProblem(error)
      return undefined
    } finally {
      this.job = null
    }
  }

  async #send(preview: boolean, signal?: AbortSignal): Promise<unknown> {
    const body = new FormData()
    const file = this.file?.file
    const plan = this.planFile?.file
    if (!file) throw new Error('no file')
    const stored = { stored: this.#stored.get(file), stored_plan: plan && this.#stored.get(plan) }
    body.append('options', JSON.stringify({ ...this.#options(), ...stored }))
    if (!stored.stored) body.append('file', file, file.name)
    if (plan && !stored.stored_plan) body.append('plan', plan, this.planName)
    try {
      const options = { path: { cell: this.cell }, query: { preview }, body, signal }
      const answer: unknown = await upload('/api/v1/cells/{cell}/readings', options)
      if (preview) this.#keep(answer as Preview, file, plan)
      return answer
    } catch (error) {
      if (!(error instanceof ApiError) || error.status !== 410 || !this.#stored.size) throw error
      this.#stored.clear() // removed by age: send it once more
      return this.#send(preview, signal)
    }
  }

  #keep(answer: Preview, file: File, plan: File | undefined): void {
    if (answer.stored) this.#stored.set(file, answer.stored)
    if (plan && answer.stored_plan) this.#stored.set(plan, answer.stored_plan)
  }

  #options(): Record<string, unknown> {
    return {
      ...(this.planFile ? { plan_file: this.planName } : this.plan ? { plan: this.plan } : {}),
      ...(this.reflectors ? { reflectors: this.reflectors, ...(this.keep ? { keep: this.keep } : {}) } : {}),
      ...(this.columns && this.complete ? { columns: { ...this.columns, skip: this.preview?.skip ?? 0 } } : {}),
      ...(this.unit ? { unit: this.unit } : {}),
      ...Object.fromEntries([...this.permissions].map((permission) => [permission, true])),
      mask: this.masked,
    }
  }

  /** The name under which the plan is sent; never that of the readings. */
  get planName(): string {
    const name = this.planFile?.file.name ?? ''
    return name.toLowerCase() === this.file?.file.name.toLowerCase() ? `plan of ${name}` : name
  }

  /** The command line that does the same. */
  command(plan: string): string[] {
    const name = this.file?.file.name ?? 'READINGS'
    const stated = this.columns && { ...this.columns, ...(this.preview?.skip ? { skip: this.preview.skip } : {}) }
    const columns = Object.entries(stated ?? {}).map(([what, column]) => `${what}=${column}`)
    return [
      ...['import', 'cell.toml', `readings/${name}`, '--plan', this.planFile ? `readings/${this.planName}` : plan || 'PLAN'],
      ...['--out', `samples/${name.replace(/\.[^.]*$/, '')}.csv`],
      ...(columns.length ? ['--columns', columns.join(', ')] : []),
      ...(this.unit ? ['--unit', this.unit] : []),
      ...(this.reflectors ? ['--reflectors', String(this.reflectors)] : []),
      ...(this.reflectors && this.keep ? ['--keep', String(this.keep)] : []),
      ...PERMISSIONS.filter((one) => this.permissions.has(one)).map((one) => `--${one.replaceAll('_', '-')}`),
      ...(this.masked.length ? ['--mask', `samples/${name.replace(/\.[^.]*$/, '')}.mask.csv`] : []),
    ]
  }
}
