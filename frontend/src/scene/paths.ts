/** Targets of programs and poses of plans: lines, and markers whose shape tells the verdict. */
import {
  BufferAttribute,
  BufferGeometry,
  Group,
  LineBasicMaterial,
  LineSegments,
  Points,
  ShaderMaterial,
  Vector3,
  type Box3,
} from 'three'
import type { Palette } from './colours'
import { nearest, type Aim } from './pick'
import { VERDICTS, type Path } from './types'

const PLAIN = VERDICTS.indexOf('plain')

const VERTEX = /* glsl */ `
attribute float aVerdict;
uniform vec3 uColours[5]; uniform float uSize;
varying vec3 vColour; varying float vVerdict;
void main() {
  vVerdict = aVerdict;
  vColour = uColours[int(aVerdict + 0.5)];
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  gl_PointSize = uSize * (aVerdict > 3.5 ? 0.8 : 1.0);
}`

/** The shapes of `lib/verdicts`. Corrected: disc. Unchanged: ring. Skipped: diamond. Refused: triangle. Plain: disc. */
const FRAGMENT = /* glsl */ `
uniform vec3 uPage;
varying vec3 vColour; varying float vVerdict;
void main() {
  vec2 p = 2.0 * gl_PointCoord - 1.0;
  vec2 a = abs(p);
  float inside;
  if (vVerdict < 0.5 || vVerdict > 3.5) inside = 0.85 - length(p);
  else if (vVerdict < 1.5) inside = 0.2 - abs(length(p) - 0.6);
  else if (vVerdict < 2.5) inside = 0.9 - a.x - a.y;
  else inside = min(0.75 - p.y, 0.53 * (p.y + 0.85) - a.x);
  if (inside < 0.0) discard;
  gl_FragColor = vec4(inside < 0.08 ? mix(vColour, uPage, 0.5) : vColour, 1.0);
}`

export class Paths {
  readonly group = new Group()
  readonly total: number
  private readonly points: Float32Array
  private readonly markers: Points<BufferGeometry, ShaderMaterial>
  private readonly lines: LineSegments<BufferGeometry, LineBasicMaterial>

  constructor(paths: readonly Path[], colours: Palette, pixels: number) {
    this.total = paths.reduce((sum, path) => sum + path.points.length / 3, 0)
    this.points = new Float32Array(3 * this.total)
    const verdicts = new Float32Array(this.total).fill(PLAIN)
    const joined: number[] = []
    let first = 0
    for (const path of paths) {
      const n = path.points.length / 3
      this.points.set(path.points, 3 * first)
      if (path.verdicts) verdicts.set(path.verdicts, first)
      if (path.line) for (let k = 1; k < n; k++) joined.push(first + k - 1, first + k)
      first += n
    }
    const position = new BufferAttribute(this.points, 3)
    const marks = new BufferGeometry()
    marks.setAttribute('position', position)
    marks.setAttribute('aVerdict', new BufferAttribute(verdicts, 1))
    this.markers = new Points(
      marks,
      new ShaderMaterial({
        vertexShader: VERTEX,
        fragmentShader: FRAGMENT,
        uniforms: { uColours: { value: [] }, uSize: { value: 11 * pixels }, uPage: { value: null } },
      }),
    )
    const strokes = new BufferGeometry()
    strokes.setAttribute('position', position)
    strokes.setIndex(new BufferAttribute(new Uint32Array(joined), 1))
    this.lines = new LineSegments(strokes, new LineBasicMaterial())
    this.markers.frustumCulled = this.lines.frustumCulled = false
    this.lines.visible = joined.length > 0
    this.group.add(this.lines, this.markers)
    this.colour(colours)
  }

  colour(colours: Palette): void {
    this.markers.material.uniforms['uColours']!.value = colours.verdicts
    this.markers.material.uniforms['uPage']!.value = colours.page
    this.lines.material.color.copy(colours.line)
  }

  place(index: number): Vector3 {
    return new Vector3().fromArray(this.points, 3 * index)
  }

  expand(box: Box3): void {
    for (let k = 0; k < this.total; k++) box.expandByPoint(this.place(k))
  }

  /** The number of the nearest marker; −1 for none. */
  pick(aim: Aim): number {
    const { points } = this
    return nearest(aim, this.total, (k, to) => {
      for (let c = 0; c < 3; c++) to[c] = points[3 * k + c]!
    })
  }

  dispose(): void {
    for (const one of [this.markers, this.lines]) {
      one.geometry.dispose()
      one.material.dispose()
    }
    this.group.removeFromParent()
  }
}
