/** The arm: all its shells in one draw call, moved by bones. */
import {
  Bone,
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  Matrix4,
  MeshLambertMaterial,
  Skeleton,
  SkinnedMesh,
  Vector3,
  type Color,
} from 'three'
import type { Palette } from './colours'
import type { ArmPicture } from './types'

const AROUND = 28
const DEGREE = Math.PI / 180

export class Arm {
  readonly mesh: SkinnedMesh
  private readonly index: readonly number[]
  private readonly bones: Bone[]
  private readonly fixed: Matrix4[]
  private readonly tip = new Matrix4()

  constructor(
    private readonly picture: ArmPicture,
    colours: Palette,
  ) {
    this.fixed = picture.bodies.map((rows) => matrix(rows))
    this.bones = picture.bodies.map(() => new Bone())
    for (let k = 1; k < this.bones.length; k++) this.bones[k - 1]!.add(this.bones[k]!)
    for (const bone of this.bones) bone.matrixAutoUpdate = false
    const material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide })
    const geometry = shells(picture)
    this.index = [...geometry.index!.array]
    this.mesh = new SkinnedMesh(geometry, material)
    this.mesh.add(this.bones[0]!)
    this.mesh.frustumCulled = false
    this.mesh.bind(new Skeleton(this.bones, this.bones.map(() => new Matrix4())), new Matrix4())
    this.colour(colours)
    this.move(picture.q_deg)
  }

  /** Turn the joints; degrees. */
  move(q: readonly number[]): void {
    this.tip.identity()
    const turn = new Matrix4()
    for (let k = 1; k < this.bones.length; k++) {
      turn.makeRotationZ(DEGREE * (q[k - 1] ?? 0) * (this.picture.sign[k - 1] ?? 1))
      this.bones[k]!.matrix.multiplyMatrices(this.fixed[k - 1]!, turn)
      this.tip.multiply(this.bones[k]!.matrix)
    }
    this.tip.multiply(this.fixed[this.fixed.length - 1]!)
    this.mesh.updateMatrixWorld(true)
  }

  /** The joints' places and the tool's, for the bounds of the view. */
  places(): Vector3[] {
    const joints = this.bones.map((bone) => new Vector3().setFromMatrixPosition(bone.matrixWorld))
    return [...joints, new Vector3().setFromMatrixPosition(this.tip)]
  }

  colour(colours: Palette): void {
    const of: Record<string, Color> = { foot: colours.drum, drum: colours.drum, link: colours.arm, tool: colours.tool }
    const each = 4 * (AROUND + 1)
    const attribute = this.mesh.geometry.getAttribute('color') as BufferAttribute
    this.picture.parts.forEach((part, number) => {
      const colour = of[part.kind]!
      for (let k = 0; k < each; k++) attribute.setXYZ(number * each + k, colour.r, colour.g, colour.b)
    })
    attribute.needsUpdate = true
  }

  /** Draw the shells without those of some bodies; the tool, which no mesh replaces, stays. */
  hide(bodies: ReadonlySet<number>): void {
    const { parts } = this.picture
    const each = this.index.length / parts.length
    const shown = parts.flatMap((part, number) =>
      bodies.has(part.body) && part.kind !== 'tool' ? [] : this.index.slice(number * each, (number + 1) * each),
    )
    this.mesh.geometry.setIndex(shown)
    this.mesh.visible = shown.length > 0
  }

  dispose(): void {
    this.mesh.geometry.dispose()
    this.mesh.skeleton.dispose()
    ;(this.mesh.material as MeshLambertMaterial).dispose()
    this.mesh.removeFromParent()
  }
}

/** A three.js matrix from rows. */
export function matrix(rows: readonly (readonly number[])[]): Matrix4 {
  return new Matrix4().fromArray(rows.flat()).transpose()
}

/** Truncated cones with caps, 4 rings of vertices each: bottom cap, side, side, top cap. */
function shells(picture: ArmPicture): BufferGeometry {
  const ring = AROUND + 1
  const each = 4 * ring
  const vertices = each * picture.parts.length
  const [position, normal] = [new Float32Array(3 * vertices), new Float32Array(3 * vertices)]
  const body = new Uint16Array(4 * vertices)
  const weight = new Float32Array(4 * vertices)
  const index: number[] = []
  const [across, along, side, point] = [new Vector3(), new Vector3(), new Vector3(), new Vector3()]
  picture.parts.forEach((part, number) => {
    const ends = [new Vector3(...part.start_mm), new Vector3(...part.end_mm)]
    along.subVectors(ends[1]!, ends[0]!).normalize()
    across.set(Math.abs(along.x) < 0.9 ? 1 : 0, Math.abs(along.x) < 0.9 ? 0 : 1, 0).cross(along).normalize()
    side.crossVectors(along, across)
    const first = number * each
    for (let row = 0; row < 4; row++) {
      const end = row < 2 ? 0 : 1
      const cap = row === 0 ? -1 : row === 3 ? 1 : 0
      for (let k = 0; k < ring; k++) {
        const [c, s] = [Math.cos((2 * Math.PI * k) / AROUND), Math.sin((2 * Math.PI * k) / AROUND)]
        const at = first + row * ring + k
        const out = point.copy(across).multiplyScalar(c).addScaledVector(side, s)
        const facing = cap ? along : out
        normal.set([facing.x * (cap || 1), facing.y * (cap || 1), facing.z * (cap || 1)], 3 * at)
        const radius = part.radii_mm[end]!
        const from = ends[end]!
        position.set([from.x + radius * out.x, from.y + radius * out.y, from.z + radius * out.z], 3 * at)
        body[4 * at] = part.body
        weight[4 * at] = 1
        if (k === AROUND) continue
        if (row === 1) index.push(at, at + 1, at + ring, at + 1, at + ring + 1, at + ring)
        else if (cap && k > 0) index.push(first + row * ring, at, at + 1)
      }
    }
  })
  const geometry = new BufferGeometry()
  geometry.setAttribute('position', new BufferAttribute(position, 3))
  geometry.setAttribute('normal', new BufferAttribute(normal, 3))
  geometry.setAttribute('color', new BufferAttribute(new Float32Array(3 * vertices), 3))
  geometry.setAttribute('skinIndex', new BufferAttribute(body, 4))
  geometry.setAttribute('skinWeight', new BufferAttribute(weight, 4))
  geometry.setIndex(index)
  return geometry
}
