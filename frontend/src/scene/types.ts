/** The data of a scene. Lengths in mm, base frame of the robot; angles in degrees. */
import type { Schemas } from '../lib/api'
import type { LoadedMeshes } from '../lib/meshes.svelte'
import type { VerdictKind } from '../lib/verdicts'

/** An arm as `GET /cells/{cell}/arm` and `GET /robots/{robot}/arm` give it. */
export type ArmPicture = Schemas['ArmPicture']
export type WorkBox = Schemas['WorkBox']

/** Error vectors at points: rows of 7 numbers (p, e, length of the standard deviation), as `arrays.bin` gives them. */
export interface Arrows {
  /** Errors before the correction, or predicted errors. */
  before: Float32Array
  /** Errors that are left, in the same order; without it, `before` only. */
  after?: Float32Array
  /** Length at the end of the colour scale in mm; by default the largest but the top 2 % of `before`. */
  scale?: number
  /** Title of the colour scale, with unit; by default that of `SceneWords`. */
  title?: string
}

/** Values on a plane, in rows along `v`; NaN where there is none. */
export interface Slice {
  values: Float32Array
  columns: number
  rows: number
  /** Corner of the first value, and the edges from there to the last column and the last row. */
  corner: readonly [number, number, number]
  u: readonly [number, number, number]
  v: readonly [number, number, number]
  scale: number
  /** Title of its colour scale, with unit. */
  title: string
}

/** Values in a box, n³ in the order z, y, x (x fastest); NaN where there is none. */
export interface Cloud {
  values: Float32Array
  n: number
  low: readonly [number, number, number]
  high: readonly [number, number, number]
  scale: number
  /** Title of its colour scale, with unit. */
  title: string
}

/** What became of a target, with the shapes of `lib/verdicts`; a pose of a plan is plain. */
export const VERDICTS = ['corrected', 'unchanged', 'skipped', 'refused', 'plain'] as const satisfies readonly (
  | VerdictKind
  | 'plain'
)[]
export type Verdict = (typeof VERDICTS)[number]

/** Targets of a program or poses of a plan, joined by a line where `line` is true. */
export interface Path {
  /** n points, 3 numbers each. */
  points: Float32Array
  /** The index of a verdict in `VERDICTS` for each point; by default all are plain. */
  verdicts?: Uint8Array
  line?: boolean
}

export type Layer = 'arrows' | 'targets'

/** The point under the pointer, or the selected one. */
export interface Hit {
  layer: Layer
  /** Row of `Arrows`, or number of the target counted over all paths. */
  index: number
  /** Its place in the canvas in CSS pixels. */
  x: number
  y: number
}

/** Texts in the language of the page. */
export interface SceneWords {
  /** What the picture shows, for screen readers. */
  label: string
  /** The keys: arrows turn, Shift and arrows move, plus and minus zoom, F fits the view. */
  keys: string
  /** Shown instead of the picture where the browser has no WebGL 2; tables remain. */
  noWebGl: string
  /** Shown while the graphics context is lost. */
  contextLost: string
  /** Title of the colour scale of arrows, with unit. */
  error: string
  grid: (step: number) => string
  shown: (shown: number, total: number) => string
  magnified: (factor: number) => string
  /** The end of a scale that some values exceed. */
  orMore: (value: number) => string
  /** A number of a scale in the language of the page. */
  number: (value: number) => string
}

export interface SceneOptions {
  words: SceneWords
  /** Lines of the tooltip of a point; none for no tooltip. */
  describe?: (hit: Hit) => string[]
  /** A click on a point, or on none. */
  onSelect?: (hit: Hit | null) => void
}

/** Figures of the last frame, for tests and benchmarks. */
export interface Counters {
  frames: number
  calls: number
  triangles: number
  lines: number
  points: number
  /** JavaScript time of the last frame in ms. */
  scriptMs: number
  /** Time until the graphics finished the last frame in ms; NaN while it is not known. */
  frameMs: number
  /** From the call of `setArrows` until the graphics finished the first frame with them, in ms. */
  arrowsMs: number
  /** Buffers and textures that the scene uploaded, in bytes. */
  gpuBytes: number
  arrowsShown: number
  arrowsTotal: number
  reduced: boolean
  geometries: number
  textures: number
}

export type View = 'iso' | 'top' | 'front' | 'side'

export interface SceneHandle {
  /** The arm, at the joints of its picture; null removes it. */
  setArm(arm: ArmPicture | null): void
  /** Meshes instead of the shells of the arm, as `meshesOf` gives them; null shows the shells. */
  setMeshes(meshes: LoadedMeshes | null): void
  /** Move the arm; degrees. */
  setJoints(q: readonly number[]): void
  setBoxes(boxes: { region?: WorkBox | null; obstacles?: readonly WorkBox[] }): void
  /** The tracker's station, a 4 × 4 matrix; null removes it. */
  setTracker(tf: readonly (readonly number[])[] | null): void
  setArrows(arrows: Arrows | null): void
  setMagnification(factor: number): void
  /** Show errors before or after the correction. */
  setState(state: 'before' | 'after'): void
  /** Show all arrows also where frames take long. */
  setReduced(reduced: 'auto' | 'never'): void
  setSlice(slice: Slice | null): void
  setCloud(cloud: Cloud | null): void
  setPaths(paths: readonly Path[]): void
  /** Mark a point, as a click does. */
  select(layer: Layer, index: number | null): void
  /** Texts again, after a change of language. */
  setWords(words: SceneWords): void
  view(view: View): void
  /** Show everything but the tracker. */
  fit(): void
  counters(): Counters
  dispose(): void
}
