/** The path of a program in the base frame, as path.bin holds it. */
import { SHAPE_OF_CODE } from './verdicts'

export interface ProgramPath {
  /** Number of targets with a known position; more than there are points, if some were left out. */
  known: number
  /** Positions before the correction [mm]. */
  before: Float32Array
  /** Corrections [mm]. */
  change: Float32Array
  /** Row of each point in the record, ascending. */
  rows: Uint32Array
  /** The shape of each point. */
  shapes: Uint8Array
}

export function pathOf(buffer: ArrayBuffer): ProgramPath {
  const [n = 0, known = 0] = new Uint32Array(buffer, 0, 2)
  return {
    known,
    before: new Float32Array(buffer, 8, 3 * n),
    change: new Float32Array(buffer, 8 + 12 * n, 3 * n),
    rows: new Uint32Array(buffer, 8 + 24 * n, n),
    shapes: new Uint8Array(buffer, 8 + 28 * n, n).map((code) => SHAPE_OF_CODE[code] ?? 0),
  }
}

/** The arrows of the corrections: position, correction, no deviation. */
export function arrowsOf(path: ProgramPath): Float32Array {
  const n = path.rows.length
  const arrows = new Float32Array(7 * n)
  for (let k = 0; k < n; k++) {
    arrows.set(path.before.subarray(3 * k, 3 * k + 3), 7 * k)
    arrows.set(path.change.subarray(3 * k, 3 * k + 3), 7 * k + 3)
  }
  return arrows
}

/** A magnification that makes the longest correction about a twelfth of the path's extent; of 1 to 1,000. */
export function magnificationOf(path: ProgramPath): number {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]]
  let longest = 0
  for (let k = 0; k < path.rows.length; k++) {
    for (let axis = 0; axis < 3; axis++) {
      const p = path.before[3 * k + axis]!
      low[axis] = Math.min(low[axis]!, p)
      high[axis] = Math.max(high[axis]!, p)
    }
    longest = Math.max(longest, Math.hypot(path.change[3 * k]!, path.change[3 * k + 1]!, path.change[3 * k + 2]!))
  }
  const extent = Math.hypot(...high.map((value, axis) => value - low[axis]!))
  if (!longest || !extent || !Number.isFinite(extent)) return 100
  return Number(Math.min(1000, Math.max(1, extent / longest / 12)).toPrecision(2))
}

/** The point of a row; where points were left out the nearest before it, −1 for none. */
export function pointOf(path: ProgramPath, row: number): number {
  let [low, high] = [0, path.rows.length]
  while (low < high) {
    const middle = (low + high) >> 1
    if (path.rows[middle]! <= row) low = middle + 1
    else high = middle
  }
  const nearest = low - 1
  return path.rows.length < path.known || path.rows[nearest] === row ? nearest : -1
}
