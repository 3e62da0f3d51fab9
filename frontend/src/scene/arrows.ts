/** Error vectors: one draw call of instanced arrows, or of lines where frames take too long. */
import {
  BufferAttribute,
  DataTexture,
  DoubleSide,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  LineSegments,
  Mesh,
  ShaderMaterial,
  Vector3,
  type Box3,
  type Object3D,
} from 'three'
import { cividisBytes } from './colours'
import { nearest, type Aim } from './pick'
import { most, nth, squares } from './reduce'
import type { Arrows } from './types'

/** Numbers of a row: p, e, length of the standard deviation. */
export const ROW = 7
/** The most arrows that are shown where frames take too long. */
export const MOST = 5000
const SIDES = 6

const VERTEX = /* glsl */ `
attribute vec3 aPoint; attribute vec3 aBefore; attribute vec3 aAfter;
uniform float uAfter; uniform float uFactor; uniform float uHead; uniform float uScale; uniform bool uLines;
varying vec3 vNormal; varying float vShare;
void main() {
  vec3 e = mix(aBefore, aAfter, uAfter);
  float size = length(e);
  vShare = size / uScale;
  vec3 way = e * uFactor;
  float whole = length(way);
  if (!(whole > 0.0) || !(aPoint.x == aPoint.x)) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }
  vec3 along = way / whole;
  vec3 helper = abs(along.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
  vec3 across = normalize(cross(along, helper));
  vec3 side = cross(along, across);
  float head = min(0.45 * whole, uHead);
  // position.z: 0 at the tail, 1 at the neck, 2 at the tip; x, y: around, 1 for the shaft's radius
  float at = position.z < 1.5 ? position.z * (whole - head) : whole;
  float radius = uLines ? 0.3 * head : 0.14 * head;
  vec3 out_ = across * position.x + side * position.y;
  vNormal = normalMatrix * (normal.x * across + normal.y * side + normal.z * along);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(aPoint + along * at + out_ * radius, 1.0);
}`

const FRAGMENT = /* glsl */ `
uniform sampler2D uColours; uniform bool uLines;
varying vec3 vNormal; varying float vShare;
void main() {
  vec3 colour = texture2D(uColours, vec2(clamp(vShare, 0.002, 0.998), 0.5)).rgb;
  float light = uLines ? 1.0 : 0.72 + 0.28 * abs(normalize(vNormal).z);
  gl_FragColor = vec4(colour * light, 1.0);
}`

export class ArrowField {
  readonly total: number
  private readonly colours: DataTexture
  private readonly material: ShaderMaterial
  private readonly full: Mesh
  private lines: LineSegments | undefined
  private few: Int32Array | undefined
  private readonly scale: number
  private readonly size: Float32Array

  constructor(
    private readonly arrows: Arrows,
    private readonly parent: Object3D,
    extent: number,
  ) {
    this.total = arrows.before.length / ROW
    this.size = squares(arrows.before, ROW)
    const unknown = this.size.reduce((count, one) => (one < 0 ? count + 1 : count), 0)
    const usual = nth(this.size, unknown + Math.floor(0.98 * (this.total - unknown - 1)))
    this.scale = arrows.scale ?? (Math.sqrt(usual) || 0)
    this.colours = new DataTexture(cividisBytes(), 256, 1)
    this.colours.needsUpdate = true
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: DoubleSide,
      uniforms: {
        uAfter: { value: 0 },
        uFactor: { value: 1 },
        uHead: { value: extent / 45 },
        uScale: { value: this.scale || 1 },
        uLines: { value: false },
        uColours: { value: this.colours },
      },
    })
    this.full = new Mesh(instances(cone(), arrows.before, arrows.after), this.material)
    this.full.frustumCulled = false
    parent.add(this.full)
  }

  get shown(): number {
    return this.lines?.visible ? (this.few?.length ?? 0) : this.total
  }

  get title(): string | undefined {
    return this.arrows.title
  }

  /** Length in mm at the end of the colour scale. */
  get end(): number {
    return this.scale
  }

  /** Whether some lengths are beyond the end of the colour scale. */
  get beyond(): boolean {
    const end = this.scale * (1 + 1e-6)
    return this.size.some((one) => one > end * end)
  }

  set factor(value: number) {
    this.material.uniforms['uFactor']!.value = value
  }

  /** 0 shows errors before, 1 those after. */
  set after(share: number) {
    this.material.uniforms['uAfter']!.value = this.arrows.after ? share : 0
  }

  /** Lines and fewer arrows, or all. */
  set reduced(reduced: boolean) {
    if (reduced && !this.lines) this.makeLines()
    this.material.uniforms['uLines']!.value = reduced
    if (this.lines) this.lines.visible = reduced
    this.full.visible = !reduced
  }

  /** The row of the shown arrow whose tail or middle is nearest; −1 for none. */
  pick(aim: Aim): number {
    const { before, after } = this.arrows
    const factor = this.material.uniforms['uFactor']!.value as number
    const data = this.material.uniforms['uAfter']!.value && after ? after : before
    const rows = this.lines?.visible ? this.few! : null
    const found = nearest(aim, 2 * (rows?.length ?? this.total), (k, to) => {
      const at = ROW * (rows ? rows[k >> 1]! : k >> 1)
      const way = k & 1 ? 0.5 * factor : 0
      for (let c = 0; c < 3; c++) to[c] = data[at + c]! + way * data[at + 3 + c]!
    })
    if (found < 0) return -1
    return rows ? rows[found >> 1]! : found >> 1
  }

  place(row: number): Vector3 {
    return new Vector3().fromArray(this.arrows.before, ROW * row)
  }

  expand(box: Box3): void {
    const point = new Vector3()
    for (let k = 0; k < this.total; k++) {
      point.fromArray(this.arrows.before, ROW * k)
      if (Number.isFinite(point.x)) box.expandByPoint(point)
    }
  }

  dispose(): void {
    for (const drawn of [this.full, this.lines]) {
      drawn?.geometry.dispose()
      drawn?.removeFromParent()
    }
    this.material.dispose()
    this.colours.dispose()
  }

  private makeLines(): void {
    const { before, after } = this.arrows
    this.few = most(before, ROW, MOST, this.size)
    const part = (data: Float32Array) => {
      const rows = new Float32Array(ROW * this.few!.length)
      this.few!.forEach((row, k) => rows.set(data.subarray(ROW * row, ROW * (row + 1)), ROW * k))
      return rows
    }
    this.lines = new LineSegments(instances(barbs(), part(before), after && part(after)), this.material)
    this.lines.frustumCulled = false
    this.parent.add(this.lines)
  }
}

function instances(geometry: InstancedBufferGeometry, before: Float32Array, after?: Float32Array) {
  const first = new InstancedInterleavedBuffer(before, ROW)
  const second = after ? new InstancedInterleavedBuffer(after, ROW) : first
  geometry.setAttribute('aPoint', new InterleavedBufferAttribute(first, 3, 0))
  geometry.setAttribute('aBefore', new InterleavedBufferAttribute(first, 3, 3))
  geometry.setAttribute('aAfter', new InterleavedBufferAttribute(second, 3, 3))
  geometry.instanceCount = before.length / ROW
  return geometry
}

/** A three-sided shaft and a cone: 24 triangles. */
function cone(): InstancedBufferGeometry {
  const position: number[] = []
  const normal: number[] = []
  const index: number[] = []
  const ring = (sides: number, radius: number, at: number, tilt: number) => {
    const first = position.length / 3
    for (let k = 0; k < sides; k++) {
      const [c, s] = [Math.cos((2 * Math.PI * k) / sides), Math.sin((2 * Math.PI * k) / sides)]
      position.push(radius * c, radius * s, at)
      normal.push(c, s, tilt)
    }
    return first
  }
  const join = (from: number, to: number, sides: number) => {
    for (let k = 0; k < sides; k++) {
      const next = (k + 1) % sides
      index.push(from + k, from + next, to + k, from + next, to + next, to + k)
    }
  }
  join(ring(3, 1, 0, 0), ring(3, 1, 1, 0), 3)
  const base = ring(SIDES, 2.5, 1, 0.35)
  const tip = ring(SIDES, 0, 2, 0.35)
  for (let k = 0; k < SIDES; k++) index.push(base + k, base + ((k + 1) % SIDES), tip + k)
  for (let k = 1; k < SIDES - 1; k++) index.push(base, base + k, base + k + 1)
  return geometryOf(position, normal, index)
}

/** A line with two barbs. */
function barbs(): InstancedBufferGeometry {
  const position = [0, 0, 0, 0, 0, 2, 0, 0, 2, 1, 0, 1, 0, 0, 2, -1, 0, 1]
  return geometryOf(position, position.map(() => 0), [0, 1, 2, 3, 4, 5])
}

function geometryOf(position: number[], normal: number[], index: number[]): InstancedBufferGeometry {
  const geometry = new InstancedBufferGeometry()
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(position), 3))
  geometry.setAttribute('normal', new BufferAttribute(new Float32Array(normal), 3))
  geometry.setIndex(index)
  return geometry
}
