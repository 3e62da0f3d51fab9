/** What stands around the arm: grid and axes, work region and obstacles, the tracker. */
import {
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  CylinderGeometry,
  EdgesGeometry,
  Float32BufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshLambertMaterial,
  Vector3,
  type Box3,
  type Color,
} from 'three'
import { matrix } from './arm'
import type { Palette } from './colours'
import type { WorkBox } from './types'

const AXES = [0xd0402b, 0x3a8a2e, 0x2f6fd0]

/** Grid on the base plane with a step of 1, 2 or 5, and the axes of the base frame. */
export class Floor {
  readonly lines: LineSegments<BufferGeometry, LineBasicMaterial>
  readonly step: number
  readonly axis: number

  constructor(reach: number, colours: Palette) {
    this.step = roundStep(reach / 8)
    const cells = Math.ceil(reach / this.step)
    const half = cells * this.step
    this.axis = half / 2
    const [position, colour]: [number[], number[]] = [[], []]
    const segment = (from: number[], to: number[], of: Color) => {
      position.push(...from, ...to)
      colour.push(of.r, of.g, of.b, of.r, of.g, of.b)
    }
    for (let k = -cells; k <= cells; k++) {
      const at = k * this.step
      segment([at, -half, 0], [at, half, 0], colours.grid)
      segment([-half, at, 0], [half, at, 0], colours.grid)
    }
    const axis = colours.grid.clone()
    for (let k = 0; k < 3; k++) {
      const end = [0, 0, 0]
      end[k] = this.axis
      segment([0, 0, k < 2 ? 0.5 : 0], end.map((v, c) => (c === 2 && k < 2 ? 0.5 : v)), axis.setHex(AXES[k]!))
    }
    const geometry = new BufferGeometry()
    geometry.setAttribute('position', new Float32BufferAttribute(position, 3))
    geometry.setAttribute('color', new Float32BufferAttribute(colour, 3))
    this.lines = new LineSegments(geometry, new LineBasicMaterial({ vertexColors: true }))
  }

  dispose(): void {
    this.lines.geometry.dispose()
    this.lines.material.dispose()
    this.lines.removeFromParent()
  }
}

export function roundStep(about: number): number {
  const power = 10 ** Math.floor(Math.log10(about))
  const share = about / power
  return power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10)
}

/** Edges and faint faces of boxes, in two draw calls. */
export class Boxes {
  readonly group = new Group()
  private readonly corners: Vector3[] = []

  constructor(region: WorkBox | null | undefined, obstacles: readonly WorkBox[], colours: Palette) {
    const unit = new BoxGeometry(1, 1, 1)
    const edges = new EdgesGeometry(unit)
    const [lines, faces]: [Merged, Merged] = [new Merged(), new Merged()]
    for (const box of region ? [region, ...obstacles] : obstacles) {
      const colour = box === region ? colours.accent : colours.obstacle
      const place = matrix(box.tf_base_box).multiply(new Matrix4().makeScale(...(box.size_mm as [number, number, number])))
      lines.add(edges, place, colour)
      if (box !== region) faces.add(unit, place, colour)
      const corner = unit.getAttribute('position')
      for (let k = 0; k < corner.count; k++) {
        this.corners.push(new Vector3().fromBufferAttribute(corner, k).applyMatrix4(place))
      }
    }
    unit.dispose()
    edges.dispose()
    if (lines.count) this.group.add(new LineSegments(lines.geometry(), new LineBasicMaterial({ vertexColors: true })))
    if (faces.count) {
      const look = { vertexColors: true, transparent: true, opacity: 0.18, depthWrite: false }
      this.group.add(new Mesh(faces.geometry(), new MeshBasicMaterial(look)))
    }
  }

  expand(box: Box3): void {
    for (const corner of this.corners) box.expandByPoint(corner)
  }

  dispose(): void {
    disposeAll(this.group)
  }
}

/** Geometries under one, with a colour each. */
class Merged {
  private readonly position: number[] = []
  private readonly colour: number[] = []

  get count(): number {
    return this.position.length
  }

  add(geometry: BufferGeometry, place: Matrix4, colour: Color): void {
    const at = geometry.getAttribute('position')
    const point = new Vector3()
    const rows = geometry.index ? Array.from(geometry.index.array) : Array.from({ length: at.count }, (_, k) => k)
    for (const row of rows) {
      point.fromBufferAttribute(at, row).applyMatrix4(place)
      this.position.push(point.x, point.y, point.z)
      this.colour.push(colour.r, colour.g, colour.b)
    }
  }

  geometry(): BufferGeometry {
    const made = new BufferGeometry()
    made.setAttribute('position', new BufferAttribute(new Float32Array(this.position), 3))
    made.setAttribute('color', new BufferAttribute(new Float32Array(this.colour), 3))
    return made
  }
}

/** A symbol of a tracker: foot, column and head. */
export class Tracker {
  readonly group = new Group()

  constructor(tf: readonly (readonly number[])[], size: number, colours: Palette) {
    const shapes: [CylinderGeometry, number][] = [
      [new CylinderGeometry(0.12 * size, 0.3 * size, 0.6 * size, 20), -0.55],
      [new CylinderGeometry(0.2 * size, 0.2 * size, 0.4 * size, 20), 0],
    ]
    for (const [shape, at] of shapes) {
      shape.rotateX(Math.PI / 2) // cylinders stand along y
      const mesh = new Mesh(shape, new MeshLambertMaterial({ color: at ? colours.drum : colours.accent }))
      mesh.position.z = at * size
      this.group.add(mesh)
    }
    this.group.applyMatrix4(matrix(tf))
  }

  dispose(): void {
    disposeAll(this.group)
  }
}

function disposeAll(group: Group): void {
  for (const child of group.children) {
    const { geometry, material } = child as Mesh<BufferGeometry, MeshBasicMaterial>
    geometry.dispose()
    material.dispose()
  }
  group.removeFromParent()
}
