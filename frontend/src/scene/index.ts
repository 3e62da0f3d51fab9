/**
 * The 3-D view of Cell, Measure, Map and Programs.
 *
 *   import { mountScene } from '../../scene'
 *   import { sceneWords } from '../../scene/words'
 *   const scene = await mountScene(element, { words: sceneWords(t('cell.picture')) })
 *   scene.setArm(await get('/api/v1/cells/{cell}/arm', { path: { cell } }))
 *   scene.setMeshes(meshesOf(cell))                     // meshes instead of its shells, if the cell has any
 *   scene.setJoints([0, -90, 90, 0, 45, 0])
 *   scene.setBoxes({ region: arm.region, obstacles: arm.obstacles })
 *   scene.setTracker(arm.tf_base_tracker)
 *   scene.setArrows({ before, after })                  // rows of p, e, std: arrays.bin
 *   scene.setPaths([{ points, verdicts, line: true }])  // targets of a program, poses of a plan
 *   scene.fit()
 *   return () => scene.dispose()                        // from onMount or $effect
 *
 * The element decides the size and needs a height; the view follows it. Everything is in mm and in the robot's base
 * frame. Mouse: drag turns, right button or Shift moves, wheel zooms, double click fits. Touch: one finger turns, two
 * move and zoom. Keyboard, when the view has the focus: arrows turn, Shift and arrows move, + and − zoom, F fits.
 *
 * three.js is loaded with the first view. A frame is drawn only when something changed. When frames take over 50 ms,
 * arrows become lines and at most 5,000 are shown, the largest first, and the view says so. Colours come from the
 * variables of styles.css, again after a change of theme. Where the browser has no WebGL 2, a sentence stands instead of
 * the picture and every call does nothing; `element.scene` holds the handle for tests.
 */
import type { Counters, SceneHandle, SceneOptions } from './types'

export * from './types'

export interface SceneElement extends HTMLElement {
  scene?: SceneHandle
}

/** Put a 3-D view into an element. */
export async function mountScene(element: HTMLElement, options: SceneOptions): Promise<SceneHandle> {
  const handle = hasWebGl() ? new (await import('./view')).SceneView(element, options) : sentence(element, options)
  ;(element as SceneElement).scene = handle
  return handle
}

function hasWebGl(): boolean {
  const context = document.createElement('canvas').getContext('webgl2')
  context?.getExtension('WEBGL_lose_context')?.loseContext()
  return context !== null
}

const NOTHING: Counters = {
  frames: 0,
  calls: 0,
  triangles: 0,
  lines: 0,
  points: 0,
  scriptMs: 0,
  frameMs: 0,
  arrowsMs: 0,
  gpuBytes: 0,
  arrowsShown: 0,
  arrowsTotal: 0,
  reduced: false,
  geometries: 0,
  textures: 0,
}

function sentence(element: HTMLElement, options: SceneOptions): SceneHandle {
  const note = document.createElement('p')
  note.className = 'scene-note'
  note.setAttribute('role', 'status')
  note.textContent = options.words.noWebGl
  element.append(note)
  const nothing = () => {}
  return {
    setArm: nothing,
    setMeshes: nothing,
    setJoints: nothing,
    setBoxes: nothing,
    setTracker: nothing,
    setArrows: nothing,
    setMagnification: nothing,
    setState: nothing,
    setReduced: nothing,
    setSlice: nothing,
    setCloud: nothing,
    setPaths: nothing,
    select: nothing,
    setWords: (words) => (note.textContent = words.noWebGl),
    view: nothing,
    fit: nothing,
    counters: () => ({ ...NOTHING }),
    dispose: () => note.remove(),
  }
}
