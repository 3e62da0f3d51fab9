/** The point of a picture under the pointer. */
import type { Camera } from 'three'

/** A place of the canvas and the size of it, in CSS pixels. */
export interface Aim {
  camera: Camera
  x: number
  y: number
  width: number
  height: number
  /** The largest distance. */
  within: number
}

/** The number of the point that is nearest to a place of the canvas; −1 if none is near. Points without a place are passed over. */
export function nearest({ camera, x, y, width, height, within }: Aim, n: number, place: (k: number, to: Float64Array) => void): number {
  const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements
  const p = new Float64Array(3)
  let [best, found] = [within * within, -1]
  for (let k = 0; k < n; k++) {
    place(k, p)
    const [px, py, pz] = [p[0]!, p[1]!, p[2]!]
    const w = m[3]! * px + m[7]! * py + m[11]! * pz + m[15]!
    if (w <= 0) continue
    const dx = (0.5 + (0.5 * (m[0]! * px + m[4]! * py + m[8]! * pz + m[12]!)) / w) * width - x
    const dy = (0.5 - (0.5 * (m[1]! * px + m[5]! * py + m[9]! * pz + m[13]!)) / w) * height - y
    const far = dx * dx + dy * dy
    if (far < best) [best, found] = [far, k]
  }
  return found
}
