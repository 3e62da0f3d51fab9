/** Fields of standard deviation or error: a slice as a texture on its plane, a cloud as a volume. */
import {
  BackSide,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Data3DTexture,
  DataTexture,
  DoubleSide,
  LinearFilter,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  RGFormat,
  ShaderMaterial,
  UnsignedByteType,
  Vector3,
} from 'three'
import { cividisBytes } from './colours'
import type { Cloud, Slice } from './types'

export interface Drawn {
  readonly mesh: Mesh
  readonly bytes: number
  dispose(): void
}

export function sliceMesh(slice: Slice): Drawn {
  const { values, columns, rows, scale } = slice
  const bytes = new Uint8Array(4 * columns * rows)
  const colours = cividisBytes()
  for (let k = 0; k < values.length; k++) {
    const value = values[k]!
    if (!Number.isFinite(value)) continue
    const colour = 4 * Math.min(255, Math.round((255 * value) / (scale || 1)))
    bytes.set(colours.subarray(colour, colour + 3), 4 * k)
    bytes[4 * k + 3] = 225
  }
  const texture = new DataTexture(bytes, columns, rows)
  texture.magFilter = texture.minFilter = LinearFilter
  texture.needsUpdate = true
  const [corner, u, v] = [new Vector3(...slice.corner), new Vector3(...slice.u), new Vector3(...slice.v)]
  const corners = [corner, corner.clone().add(u), corner.clone().add(u).add(v), corner.clone().add(v)]
  const geometry = new BufferGeometry()
  geometry.setAttribute('position', new BufferAttribute(new Float32Array(corners.flatMap((p) => p.toArray())), 3))
  // values belong to the middles of texels
  const [du, dv] = [0.5 / columns, 0.5 / rows]
  const uv = new Float32Array([du, dv, 1 - du, dv, 1 - du, 1 - dv, du, 1 - dv])
  geometry.setAttribute('uv', new BufferAttribute(uv, 2))
  geometry.setIndex([0, 1, 2, 0, 2, 3])
  const material = new MeshBasicMaterial({ map: texture, transparent: true, side: DoubleSide, depthWrite: false })
  return drawn(new Mesh(geometry, material), bytes.byteLength, [geometry, material, texture])
}

const STEPS = 48

const CLOUD_VERTEX = /* glsl */ `
varying vec3 vPlace;
void main() {
  vPlace = position + 0.5;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`

const CLOUD_FRAGMENT = /* glsl */ `
precision highp sampler3D;
uniform sampler3D uField; uniform sampler2D uColours; uniform vec3 uEye;
varying vec3 vPlace;
void main() {
  // the back faces are drawn: walk from there to the eye or to the front face
  vec3 way = uEye - vPlace;
  vec3 inverse = 1.0 / (way + vec3(1e-9));
  vec3 far = max((vec3(0.0) - vPlace) * inverse, (vec3(1.0) - vPlace) * inverse);
  float whole = min(1.0, min(far.x, min(far.y, far.z)));
  vec3 stride = way * whole / ${STEPS.toFixed(1)};
  float size = length(stride) * 6.0;
  vec4 sum = vec4(0.0);
  vec3 at = vPlace + 0.5 * stride;
  for (int k = 0; k < ${STEPS}; k++) {
    vec2 value = texture(uField, at).rg;
    if (value.g > 0.5) {
      float share = value.r / value.g;
      float alpha = clamp(share * share * size, 0.0, 1.0);
      vec3 colour = texture2D(uColours, vec2(clamp(share, 0.002, 0.998), 0.5)).rgb;
      sum.rgb = mix(sum.rgb, colour, alpha); // back to front
      sum.a = 1.0 - (1.0 - sum.a) * (1.0 - alpha);
    }
    at += stride;
  }
  if (sum.a < 0.01) discard;
  gl_FragColor = vec4(sum.rgb, sum.a);
}`

export function cloudMesh(cloud: Cloud): Drawn {
  const { n, values, scale } = cloud
  const bytes = new Uint8Array(2 * n ** 3)
  for (let k = 0; k < values.length; k++) {
    const value = values[k]!
    if (!Number.isFinite(value)) continue
    bytes[2 * k] = Math.round(255 * Math.min(1, value / (scale || 1)))
    bytes[2 * k + 1] = 255
  }
  const field = new Data3DTexture(bytes, n, n, n)
  field.format = RGFormat
  field.type = UnsignedByteType
  field.minFilter = field.magFilter = LinearFilter
  field.unpackAlignment = 1
  field.needsUpdate = true
  const colours = new DataTexture(cividisBytes(), 256, 1)
  colours.needsUpdate = true
  const geometry = new BoxGeometry(1, 1, 1)
  const material = new ShaderMaterial({
    vertexShader: CLOUD_VERTEX,
    fragmentShader: CLOUD_FRAGMENT,
    side: BackSide,
    transparent: true,
    depthWrite: false,
    depthTest: false,
    uniforms: { uField: { value: field }, uColours: { value: colours }, uEye: { value: new Vector3() } },
  })
  const mesh = new Mesh(geometry, material)
  const [low, high] = [new Vector3(...cloud.low), new Vector3(...cloud.high)]
  mesh.scale.copy(high).sub(low).max(new Vector3(1e-3, 1e-3, 1e-3))
  mesh.position.copy(high).add(low).multiplyScalar(0.5)
  const inverse = new Matrix4()
  mesh.onBeforeRender = (_renderer, _scene, camera) => {
    const eye = material.uniforms['uEye']!.value as Vector3
    inverse.copy(mesh.matrixWorld).invert()
    eye.setFromMatrixPosition(camera.matrixWorld).applyMatrix4(inverse).addScalar(0.5)
  }
  return drawn(mesh, bytes.byteLength, [geometry, material, field, colours])
}

function drawn(mesh: Mesh, bytes: number, owned: { dispose(): void }[]): Drawn {
  return {
    mesh,
    bytes,
    dispose() {
      mesh.removeFromParent()
      for (const one of owned) one.dispose()
    },
  }
}
