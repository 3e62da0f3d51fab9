/** The view itself; see `index.ts`. */
import {
  Box3,
  ColorManagement,
  DirectionalLight,
  Group,
  HemisphereLight,
  LinearSRGBColorSpace,
  MathUtils,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from 'three'
import { Arm } from './arm'
import { ArrowField, MOST } from './arrows'
import { bufferBytes } from './bytes'
import { palette } from './colours'
import { cloudMesh, sliceMesh, type Drawn } from './field'
import { FrameClock } from './frames'
import { Marker } from './marker'
import { Meshes } from './meshes'
import { Orbit } from './orbit'
import { Overlay } from './overlay'
import { Paths } from './paths'
import './scene.css'
import type { LoadedMeshes } from '../lib/meshes.svelte'
import { Boxes, Floor, Tracker } from './stage'
import type {
  ArmPicture,
  Arrows,
  Cloud,
  Counters,
  Hit,
  Layer,
  Path,
  SceneHandle,
  SceneOptions,
  SceneWords,
  Slice,
  View,
  WorkBox,
} from './types'

const PICK_PX = 10
/** A frame that takes longer shows lines instead of arrows, and fewer of them. */
const SLOW_MS = 50
/** A frame of few arrows that is as quick lets all be tried. */
const QUICK_MS = 15
const TRIALS = 3
/** So few arrows are never the reason. */
const FEW = 500
const VIEWS: Record<View, [azimuth: number, elevation: number]> = {
  iso: [-50, 25],
  top: [-90, 89.4],
  front: [0, 0],
  side: [-90, 0],
}

export class SceneView implements SceneHandle {
  private readonly canvas = document.createElement('canvas')
  private readonly renderer: WebGLRenderer
  private readonly scene = new Scene()
  private readonly content = new Group()
  private readonly camera = new PerspectiveCamera(35, 1, 10, 20_000)
  private readonly orbit: Orbit
  private readonly overlay: Overlay
  private readonly clock: FrameClock
  private readonly marker: Marker
  private readonly ending = new AbortController()
  private readonly watched: { disconnect(): void }[] = []
  private colours: ReturnType<typeof palette>
  private words: SceneWords
  private request = 0
  private dirty = true
  private lost = false
  private disposed = false

  private floor: Floor
  private arm: Arm | undefined
  private picture: ArmPicture | null = null
  private meshes: Meshes | undefined
  private boxes: Boxes | undefined
  private boxesOf: { region?: WorkBox | null; obstacles?: readonly WorkBox[] } = {}
  private tracker: Tracker | undefined
  private trackerAt: readonly (readonly number[])[] | null = null
  private arrows: ArrowField | undefined
  private slice: Drawn | undefined
  private cloud: Drawn | undefined
  private field: { title: string; scale: number } | null = null
  private paths: Paths | undefined
  private factor = 1
  private after = 0
  private reducible = true
  private reduced = false
  private trials = 0
  private slow = 0
  private pointer: { x: number; y: number } | null = null

  constructor(
    private readonly host: HTMLElement,
    private readonly options: SceneOptions,
  ) {
    ColorManagement.enabled = false // colours of the theme pass unchanged
    this.words = options.words
    host.classList.add('scene-host')
    this.canvas.tabIndex = 0
    host.prepend(this.canvas)
    const antialias = !drawnBySoftware()
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias, powerPreference: 'high-performance' })
    this.renderer.outputColorSpace = LinearSRGBColorSpace
    this.renderer.info.autoReset = false
    this.clock = new FrameClock(this.renderer.getContext() as WebGL2RenderingContext)
    this.colours = palette()
    this.floor = new Floor(1500, this.colours)
    const sun = new DirectionalLight(0xffffff, 2.2)
    sun.position.set(0.4, 0.7, 1)
    this.camera.add(sun)
    this.scene.add(this.camera, new HemisphereLight(0xffffff, 0x777777, 1.6), this.floor.lines, this.content)
    this.marker = new Marker(this.scene, this.colours)
    this.overlay = new Overlay(host, this.words)
    this.orbit = new Orbit(this.camera, this.canvas, () => this.invalidate(), {
      click: (x, y) => this.click(x, y),
      fit: () => this.fit(),
    })
    this.setWords(this.words)
    this.listen()
    this.paint()
    this.resize()
    this.fit()
  }

  setWords(words: SceneWords): void {
    this.words = words
    this.canvas.setAttribute('role', 'img')
    this.canvas.setAttribute('aria-label', `${words.label}. ${words.keys}`)
    this.canvas.title = words.keys
    this.overlay.speak(words)
    this.invalidate()
  }

  setArm(arm: ArmPicture | null): void {
    const first = this.picture === null
    this.arm?.dispose()
    this.arm = arm ? new Arm(arm, this.colours) : undefined
    this.picture = arm
    if (this.arm) this.content.add(this.arm.mesh)
    this.meshes?.wear(this.arm, arm)
    if (arm) {
      this.floor.dispose()
      this.floor = new Floor(arm.reach_mm, this.colours)
      this.scene.add(this.floor.lines)
    }
    if (first) this.fit()
    this.invalidate()
  }

  setMeshes(meshes: LoadedMeshes | null): void {
    this.meshes?.dispose()
    this.arm?.hide(new Set())
    this.meshes = meshes ? new Meshes(meshes, this.colours) : undefined
    if (this.meshes) this.content.add(this.meshes.mesh)
    this.meshes?.wear(this.arm, this.picture)
    this.invalidate()
  }

  setJoints(q: readonly number[]): void {
    this.arm?.move(q)
    this.invalidate()
  }

  setBoxes(boxes: { region?: WorkBox | null; obstacles?: readonly WorkBox[] }): void {
    this.boxes?.dispose()
    this.boxesOf = boxes
    this.boxes = new Boxes(boxes.region, boxes.obstacles ?? [], this.colours)
    this.content.add(this.boxes.group)
    this.invalidate()
  }

  setTracker(tf: readonly (readonly number[])[] | null): void {
    this.tracker?.dispose()
    this.trackerAt = tf
    this.tracker = tf ? new Tracker(tf, 0.15 * (this.picture?.reach_mm ?? 1500), this.colours) : undefined
    if (this.tracker) this.content.add(this.tracker.group)
    this.invalidate()
  }

  setArrows(arrows: Arrows | null): void {
    this.arrows?.dispose()
    this.arrows = undefined
    this.marker.hide('arrows')
    this.clock.mark()
    this.trials = this.slow = 0
    if (arrows?.before.length) {
      this.arrows = new ArrowField(arrows, this.content, this.picture?.reach_mm ?? 1500)
      this.reduce(this.reducible && this.arrows.total > MOST)
      this.arrows.factor = this.factor
      this.arrows.after = this.after
    }
    this.invalidate()
  }

  setMagnification(factor: number): void {
    this.factor = factor
    if (this.arrows) this.arrows.factor = factor
    this.invalidate()
  }

  setState(state: 'before' | 'after'): void {
    this.after = state === 'after' ? 1 : 0
    if (this.arrows) this.arrows.after = this.after
    this.invalidate()
  }

  setReduced(reduced: 'auto' | 'never'): void {
    this.reducible = reduced === 'auto'
    if (!this.reducible) this.reduce(false)
  }

  setSlice(slice: Slice | null): void {
    this.slice?.dispose()
    this.slice = slice ? sliceMesh(slice) : undefined
    if (this.slice) this.content.add(this.slice.mesh)
    if (slice) this.field = { title: slice.title, scale: slice.scale }
    this.invalidate()
  }

  setCloud(cloud: Cloud | null): void {
    this.cloud?.dispose()
    this.cloud = cloud ? cloudMesh(cloud) : undefined
    if (this.cloud) this.content.add(this.cloud.mesh)
    if (cloud) this.field = { title: cloud.title, scale: cloud.scale }
    this.invalidate()
  }

  setPaths(paths: readonly Path[]): void {
    this.paths?.dispose()
    this.marker.hide('targets')
    this.paths = paths.length ? new Paths(paths, this.colours, this.renderer.getPixelRatio()) : undefined
    if (this.paths) this.content.add(this.paths.group)
    this.invalidate()
  }

  select(layer: Layer, index: number | null): void {
    const from = layer === 'arrows' ? this.arrows : this.paths
    if (index === null || !from || index < 0 || index >= from.total) this.marker.hide(layer)
    else this.marker.show(layer, from.place(index))
    this.invalidate()
  }

  view(view: View): void {
    const [azimuth, elevation] = VIEWS[view]
    this.orbit.azimuth = MathUtils.degToRad(azimuth)
    this.orbit.elevation = MathUtils.degToRad(elevation)
    this.fit()
  }

  fit(): void {
    const box = new Box3()
    for (const place of this.arm?.places() ?? []) box.expandByPoint(place)
    this.boxes?.expand(box)
    this.arrows?.expand(box)
    this.paths?.expand(box)
    if (box.isEmpty()) box.set(new Vector3(-500, -500, 0), new Vector3(500, 500, 1000))
    const radius = Math.max(box.getSize(new Vector3()).length() / 2, 10)
    box.getCenter(this.orbit.target)
    const [half, aspect] = [MathUtils.degToRad(this.camera.fov) / 2, Math.min(1, this.camera.aspect)]
    this.orbit.distance = (1.08 * radius) / Math.sin(Math.atan(Math.tan(half) * aspect))
    this.invalidate()
  }

  counters(): Counters {
    const { render, memory } = this.renderer.info
    return {
      frames: this.clock.frames,
      calls: render.calls,
      triangles: render.triangles,
      lines: render.lines,
      points: render.points,
      scriptMs: this.clock.scriptMs,
      frameMs: this.clock.frameMs,
      arrowsMs: this.clock.markedMs,
      gpuBytes: bufferBytes(this.scene) + (this.slice?.bytes ?? 0) + (this.cloud?.bytes ?? 0),
      arrowsShown: this.arrows?.shown ?? 0,
      arrowsTotal: this.arrows?.total ?? 0,
      reduced: this.reduced,
      geometries: memory.geometries,
      textures: memory.textures,
    }
  }

  dispose(): void {
    this.disposed = true
    cancelAnimationFrame(this.request)
    this.ending.abort()
    for (const one of this.watched) one.disconnect()
    for (const one of [this.arm, this.meshes, this.boxes, this.tracker, this.arrows, this.slice, this.cloud, this.paths]) one?.dispose()
    this.floor.dispose()
    this.marker.dispose()
    this.orbit.dispose()
    this.overlay.dispose()
    this.clock.dispose()
    this.renderer.dispose()
    this.renderer.forceContextLoss()
    this.canvas.remove()
    this.host.classList.remove('scene-host')
  }

  private listen(): void {
    const options = { signal: this.ending.signal }
    const resized = new ResizeObserver(() => this.resize())
    resized.observe(this.host)
    const themed = new MutationObserver(() => this.paint())
    themed.observe(document.documentElement, { attributes: true, attributeFilter: ['data-theme'] })
    this.watched.push(resized, themed)
    this.canvas.addEventListener(
      'webglcontextlost',
      (event) => {
        event.preventDefault()
        this.lost = true
        if (!this.disposed) this.overlay.contextLost = true
      },
      options,
    )
    this.canvas.addEventListener(
      'webglcontextrestored',
      () => {
        this.lost = this.overlay.contextLost = false
        this.clock.forget()
        this.invalidate()
      },
      options,
    )
    this.canvas.addEventListener('pointermove', (event) => this.hover(event), options)
    this.canvas.addEventListener('pointerleave', () => this.hover(null), options)
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.host
    if (!width || !height) return
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2))
    this.renderer.setSize(width, height, false)
    this.camera.aspect = width / height
    this.camera.updateProjectionMatrix()
    this.invalidate()
  }

  /** Take the colours of the theme. */
  private paint(): void {
    this.colours = palette()
    this.renderer.setClearColor(this.colours.page)
    this.arm?.colour(this.colours)
    this.meshes?.colour(this.colours)
    this.paths?.colour(this.colours)
    this.marker.colour(this.colours)
    const { picture } = this
    this.floor.dispose()
    this.floor = new Floor(picture?.reach_mm ?? 1500, this.colours)
    this.scene.add(this.floor.lines)
    if (this.boxes) this.setBoxes(this.boxesOf)
    if (this.tracker) this.setTracker(this.trackerAt)
    this.invalidate()
  }

  private invalidate(): void {
    this.dirty = true
    this.ask()
  }

  private ask(): void {
    if (!this.request && !this.disposed) this.request = requestAnimationFrame(() => this.frame())
  }

  private frame(): void {
    this.request = 0
    if (this.lost || this.disposed) return
    if (this.dirty) this.draw()
    if (this.pointer && !this.orbit.dragging) this.explain(this.pointer)
  }

  private draw(): void {
    this.dirty = false
    this.clock.begin()
    this.orbit.apply()
    this.camera.near = Math.max(this.orbit.distance / 200, 1)
    this.camera.far = this.orbit.distance * 20 + 2e4
    this.camera.updateProjectionMatrix()
    this.renderer.info.reset()
    this.renderer.render(this.scene, this.camera)
    const { clientWidth: width, clientHeight: height } = this.canvas
    this.overlay.place(this.camera, this.floor.axis, width, height)
    this.legend()
    this.clock.end((ms) => this.took(ms))
  }

  private legend(): void {
    this.overlay.show({
      error: this.arrows ? { title: this.arrows.title ?? this.words.error, end: this.arrows.end, beyond: this.arrows.beyond } : null,
      field: this.slice || this.cloud ? this.field : null,
      factor: this.factor,
      grid: this.floor.step,
      shown: this.arrows?.shown ?? 0,
      total: this.arrows?.total ?? 0,
    })
  }

  /** Reduce the arrows after a frame that took too long; show all of many after a quick one. */
  private took(ms: number): void {
    if (!this.arrows || !this.reducible) return
    if (!this.reduced) {
      this.slow = ms > SLOW_MS && this.arrows.total > FEW ? this.slow + 1 : 0
      if (this.slow === 1) this.invalidate() // the first frame also compiles
      else if (this.slow > 1) this.reduce(true)
    } else if (this.trials < TRIALS) {
      this.trials += 1
      if (ms > QUICK_MS) this.invalidate()
      else {
        this.trials = TRIALS
        this.reduce(false)
      }
    }
  }

  private reduce(reduced: boolean): void {
    this.reduced = reduced
    if (this.arrows) this.arrows.reduced = reduced
    this.invalidate()
  }

  private hover(event: PointerEvent | null): void {
    const over = event && !this.orbit.dragging
    this.pointer = over ? { x: event.offsetX, y: event.offsetY } : null
    if (over) this.ask()
    else this.overlay.explain([], 0, 0)
  }

  private explain({ x, y }: { x: number; y: number }): void {
    const hit = this.options.describe ? this.pick(x, y) : null
    this.overlay.explain(hit ? this.options.describe!(hit) : [], x, y)
  }

  private click(x: number, y: number): void {
    const hit = this.pick(x, y)
    if (hit) this.select(hit.layer, hit.index)
    this.options.onSelect?.(hit)
  }

  private pick(x: number, y: number): Hit | null {
    const { clientWidth: width, clientHeight: height } = this.canvas
    const aim = { camera: this.camera, x, y, width, height, within: PICK_PX }
    const layers: [Layer, Paths | ArrowField | undefined][] = [
      ['targets', this.paths],
      ['arrows', this.arrows],
    ]
    for (const [layer, from] of layers) {
      const index = from?.pick(aim) ?? -1
      if (index >= 0) return { layer, index, x, y }
    }
    return null
  }
}

/** Whether the processor draws, so that smooth edges would cost most of a frame. */
function drawnBySoftware(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2')
  const known = gl?.getExtension('WEBGL_debug_renderer_info')
  const name = known ? String(gl?.getParameter(known.UNMASKED_RENDERER_WEBGL)) : ''
  gl?.getExtension('WEBGL_lose_context')?.loseContext()
  return /swiftshader|llvmpipe|software/i.test(name)
}
