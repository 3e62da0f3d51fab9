/** A ring around the selected point of each layer. */
import { BufferGeometry, Float32BufferAttribute, Points, ShaderMaterial, type Object3D, type Vector3 } from 'three'
import type { Palette } from './colours'
import type { Layer } from './types'

const VERTEX = /* glsl */ `
uniform float uSize;
void main() {
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
  gl_PointSize = uSize;
}`

const FRAGMENT = /* glsl */ `
uniform vec3 uColour;
void main() {
  float r = length(2.0 * gl_PointCoord - 1.0);
  if (r > 1.0 || r < 0.68) discard;
  gl_FragColor = vec4(uColour, 1.0);
}`

export class Marker {
  private readonly rings: Record<Layer, Points<BufferGeometry, ShaderMaterial>>

  constructor(parent: Object3D, colours: Palette) {
    const ring = () => {
      const geometry = new BufferGeometry()
      geometry.setAttribute('position', new Float32BufferAttribute([0, 0, 0], 3))
      const material = new ShaderMaterial({
        vertexShader: VERTEX,
        fragmentShader: FRAGMENT,
        depthTest: false,
        uniforms: { uSize: { value: 22 * Math.min(devicePixelRatio, 2) }, uColour: { value: null } },
      })
      const points = new Points(geometry, material)
      points.frustumCulled = points.visible = false
      points.renderOrder = 10
      parent.add(points)
      return points
    }
    this.rings = { arrows: ring(), targets: ring() }
    this.colour(colours)
  }

  show(layer: Layer, place: Vector3): void {
    this.rings[layer].position.copy(place)
    this.rings[layer].visible = true
  }

  hide(layer: Layer): void {
    this.rings[layer].visible = false
  }

  colour(colours: Palette): void {
    for (const ring of Object.values(this.rings)) ring.material.uniforms['uColour']!.value = colours.accent
  }

  dispose(): void {
    for (const ring of Object.values(this.rings)) {
      ring.geometry.dispose()
      ring.material.dispose()
      ring.removeFromParent()
    }
  }
}
