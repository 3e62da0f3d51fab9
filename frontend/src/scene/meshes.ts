/** Meshes of an arm: all links in one draw call, moved by the bones of the arm. */
import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DoubleSide,
  Matrix4,
  MeshLambertMaterial,
  SkinnedMesh,
} from 'three'
import type { LoadedMeshes } from '../lib/meshes.svelte'
import type { Arm } from './arm'
import type { Palette } from './colours'
import type { ArmPicture } from './types'

const SAME_MM = 1e-6

export class Meshes {
  readonly mesh: SkinnedMesh<BufferGeometry, MeshLambertMaterial>
  /** Bodies whose shells the meshes replace. */
  private readonly replaced: ReadonlySet<number>

  constructor(
    private readonly meshes: LoadedMeshes,
    colours: Palette,
  ) {
    const { about, data } = meshes
    const placeholders = new Set(about.placeholders)
    this.replaced = new Set((about.parts ?? []).map((part) => part.body).filter((body) => !placeholders.has(body)))
    const material = new MeshLambertMaterial({ vertexColors: true, side: DoubleSide, flatShading: true })
    this.mesh = new SkinnedMesh(geometryOf(about, data), material)
    this.mesh.frustumCulled = false
    this.colour(colours)
  }

  /** Put the meshes onto an arm instead of its shells; on another robot nothing is shown. */
  wear(arm: Arm | undefined, picture: ArmPicture | null): void {
    const fits = arm !== undefined && picture !== null && isOf(this.meshes.about.links ?? [], picture)
    this.mesh.visible = fits
    if (!fits) return
    this.mesh.bind(arm.mesh.skeleton, new Matrix4())
    arm.hide(this.replaced)
  }

  colour(colours: Palette): void {
    const attribute = this.mesh.geometry.getAttribute('color') as BufferAttribute
    for (const part of this.meshes.about.parts ?? []) {
      const { r, g, b } = part.colour ? new Color(part.colour) : colours.arm
      for (let k = part.first_point; k < part.first_point + part.points; k++) attribute.setXYZ(k, r, g, b)
    }
    attribute.needsUpdate = true
  }

  dispose(): void {
    this.mesh.geometry.dispose()
    this.mesh.material.dispose()
    this.mesh.removeFromParent()
  }
}

/** Whether meshes, whose points are in frames of bodies, belong to the arm of a picture. */
function isOf(links: readonly (readonly (readonly number[])[])[], picture: ArmPicture): boolean {
  if (links.length !== picture.bodies.length - 1) return false
  return links.every((link, k) =>
    link.every((row, i) => row.every((value, j) => Math.abs(value - (picture.bodies[k]?.[i]?.[j] ?? NaN)) < SAME_MM)),
  )
}

function geometryOf(about: LoadedMeshes['about'], data: ArrayBuffer): BufferGeometry {
  const parts = about.parts ?? []
  const points = parts.reduce((sum, part) => sum + part.points, 0)
  const body = new Uint8Array(4 * points)
  const weight = new Uint8Array(4 * points)
  for (const part of parts) {
    for (let k = part.first_point; k < part.first_point + part.points; k++) {
      body[4 * k] = part.body
      weight[4 * k] = 255
    }
  }
  const geometry = new BufferGeometry()
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(data, 0, 3 * points), 3))
  geometry.setAttribute('color', new BufferAttribute(new Float32Array(3 * points), 3))
  geometry.setAttribute('skinIndex', new BufferAttribute(body, 4))
  geometry.setAttribute('skinWeight', new BufferAttribute(weight, 4, true))
  geometry.setIndex(new BufferAttribute(new Uint32Array(data, 12 * points), 1))
  return geometry
}
