/** The size of the vertex buffers of a scene. */
import { type Mesh, type InterleavedBufferAttribute, type Object3D, type TypedArray } from 'three'

/** Bytes of all vertex and index buffers below an object; a buffer of several geometries counts once. */
export function bufferBytes(root: Object3D): number {
  const arrays = new Set<TypedArray>()
  root.traverse((one) => {
    const { geometry } = one as Mesh
    if (!geometry?.attributes) return
    for (const attribute of Object.values(geometry.attributes)) {
      arrays.add((attribute as InterleavedBufferAttribute).data?.array ?? attribute.array)
    }
    if (geometry.index) arrays.add(geometry.index.array)
  })
  return [...arrays].reduce((sum, array) => sum + array.byteLength, 0)
}
