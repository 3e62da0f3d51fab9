/** Turning, moving and zooming with mouse, touch and keyboard, about a target, with z upwards. */
import { MathUtils, Vector3, type PerspectiveCamera } from 'three'

const STEP = Math.PI / 24
const ZOOM = 1.15
const STEEPEST = Math.PI / 2 - 0.01
const CLICK_PX = 4

export class Orbit {
  readonly target = new Vector3()
  distance = 1000
  azimuth = MathUtils.degToRad(-50)
  elevation = MathUtils.degToRad(25)
  /** Whether a drag is under way. */
  dragging = false
  private readonly pointers = new Map<number, { x: number; y: number }>()
  private readonly ending = new AbortController()
  private moved = 0
  private button = 0

  constructor(
    private readonly camera: PerspectiveCamera,
    private readonly canvas: HTMLCanvasElement,
    private readonly changed: () => void,
    private readonly does: { click: (x: number, y: number) => void; fit: () => void },
  ) {
    const options = { signal: this.ending.signal }
    canvas.addEventListener('pointerdown', (event) => this.down(event), options)
    canvas.addEventListener('pointermove', (event) => this.move(event), options)
    for (const name of ['pointerup', 'pointercancel'] as const) {
      canvas.addEventListener(name, (event) => this.up(event), options)
    }
    canvas.addEventListener('wheel', (event) => this.wheel(event), { ...options, passive: false })
    canvas.addEventListener('contextmenu', (event) => event.preventDefault(), options)
    canvas.addEventListener('dblclick', () => does.fit(), options)
    canvas.addEventListener('keydown', (event) => this.key(event), options)
  }

  apply(): void {
    const flat = Math.cos(this.elevation)
    const from = new Vector3(flat * Math.cos(this.azimuth), flat * Math.sin(this.azimuth), Math.sin(this.elevation))
    this.camera.up.set(0, 0, 1)
    this.camera.position.copy(this.target).addScaledVector(from, this.distance)
    this.camera.lookAt(this.target)
    this.camera.updateMatrixWorld()
  }

  turn(right: number, up: number): void {
    this.azimuth -= right
    this.elevation = MathUtils.clamp(this.elevation + up, -STEEPEST, STEEPEST)
    this.changed()
  }

  zoom(factor: number): void {
    this.distance = MathUtils.clamp(this.distance * factor, 1, 1e6)
    this.changed()
  }

  /** Move by pixels of the canvas. */
  pan(dx: number, dy: number): void {
    const perPixel = (2 * this.distance * Math.tan(MathUtils.degToRad(this.camera.fov) / 2)) / this.canvas.clientHeight
    const [right, up] = [new Vector3(), new Vector3()]
    this.camera.matrixWorld.extractBasis(right, up, new Vector3())
    this.target.addScaledVector(right, -dx * perPixel).addScaledVector(up, dy * perPixel)
    this.changed()
  }

  dispose(): void {
    this.ending.abort()
  }

  private down(event: PointerEvent): void {
    this.canvas.focus({ preventScroll: true })
    this.canvas.setPointerCapture(event.pointerId)
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY })
    this.button = event.shiftKey ? 2 : event.button
    this.moved = 0
    this.dragging = true
  }

  private move(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId)
    if (!before) return
    const [dx, dy] = [event.clientX - before.x, event.clientY - before.y]
    this.moved += Math.abs(dx) + Math.abs(dy)
    const apart = this.apart()
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY })
    if (this.pointers.size === 2) {
      const now = this.apart()
      if (apart && now) this.zoom(apart / now)
      this.pan(dx / 2, dy / 2)
    } else if (this.button === 0) this.turn(dx * 0.008, dy * 0.008)
    else this.pan(dx, dy)
  }

  private up(event: PointerEvent): void {
    const held = this.pointers.delete(event.pointerId)
    this.dragging = this.pointers.size > 0
    if (held && event.type === 'pointerup' && this.moved < CLICK_PX && event.button === 0) {
      this.does.click(event.offsetX, event.offsetY)
    }
    this.changed()
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault()
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 30 : event.deltaY
    this.zoom(ZOOM ** (MathUtils.clamp(lines, -300, 300) / 100))
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key]
    if (way && event.shiftKey) this.pan(-40 * way[0]!, -40 * way[1]!)
    else if (way) this.turn(STEP * way[0]!, STEP * -way[1]!)
    else if (event.key === '+' || event.key === '=') this.zoom(1 / ZOOM)
    else if (event.key === '-') this.zoom(ZOOM)
    else if (event.key === 'f' || event.key === 'F' || event.key === 'Home') this.does.fit()
    else return
    event.preventDefault()
    event.stopPropagation()
  }

  private apart(): number {
    const [a, b] = [...this.pointers.values()]
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0
  }
}
