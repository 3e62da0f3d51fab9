/** HTML over the picture: colour scales, letters of the axes, the tooltip, and what the picture cannot show. */
import { Vector3, type Camera } from 'three'
import { cividisGradient } from './colours'
import type { SceneWords } from './types'

/** What the legend says. */
export interface Legend {
  error: { title: string; end: number; beyond: boolean } | null
  field: { title: string; scale: number } | null
  factor: number
  grid: number
  shown: number
  total: number
}

export class Overlay {
  private readonly legend: HTMLElement
  private readonly tip: HTMLElement
  private readonly lost: HTMLElement
  private readonly axes: HTMLElement[]
  private last = ''

  constructor(
    private readonly host: HTMLElement,
    private words: SceneWords,
  ) {
    this.legend = this.part('scene-legend')
    this.axes = ['X', 'Y', 'Z'].map((letter) => this.part('scene-axis', letter))
    this.tip = this.part('scene-tip')
    this.lost = this.part('scene-note', words.contextLost)
    this.lost.setAttribute('role', 'status')
    for (const axis of this.axes) axis.setAttribute('aria-hidden', 'true')
    this.tip.hidden = this.lost.hidden = true
  }

  speak(words: SceneWords): void {
    this.words = words
    this.lost.textContent = words.contextLost
    this.last = ''
  }

  set contextLost(lost: boolean) {
    this.lost.hidden = !lost
  }

  show(legend: Legend): void {
    const text = JSON.stringify(legend)
    if (text === this.last) return
    this.last = text
    const { words } = this
    const lines: HTMLElement[] = []
    if (legend.error !== null) lines.push(this.scale(legend.error.title, legend.error.end, legend.error.beyond))
    if (legend.field !== null) lines.push(this.scale(legend.field.title, legend.field.scale, false))
    if (legend.error !== null) lines.push(make('span', words.magnified(legend.factor)))
    if (legend.shown < legend.total) {
      const shown = make('strong', words.shown(legend.shown, legend.total))
      shown.className = 'scene-shown'
      lines.push(shown)
    }
    lines.push(make('span', words.grid(legend.grid)))
    this.legend.replaceChildren(...lines)
  }

  /** Put the letters at the ends of the axes. */
  place(camera: Camera, length: number, width: number, height: number): void {
    const point = new Vector3()
    this.axes.forEach((letter, k) => {
      point.set(0, 0, 0).setComponent(k, length * 1.04)
      point.project(camera)
      letter.hidden = Math.abs(point.z) > 1
      const [x, y] = [(0.5 + 0.5 * point.x) * width, (0.5 - 0.5 * point.y) * height]
      letter.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`
    })
  }

  /** Show some lines at a place of the canvas; none hides them. */
  explain(lines: readonly string[], x: number, y: number): void {
    this.tip.hidden = lines.length === 0
    if (!lines.length) return
    this.tip.replaceChildren(...lines.map((line) => make('span', line)))
    const left = Math.min(x + 12, this.host.clientWidth - this.tip.offsetWidth - 4)
    const top = y + 12 + this.tip.offsetHeight > this.host.clientHeight ? y - 8 - this.tip.offsetHeight : y + 12
    this.tip.style.transform = `translate(${Math.max(4, left)}px, ${Math.max(4, top)}px)`
  }

  dispose(): void {
    for (const part of [this.legend, this.tip, this.lost, ...this.axes]) part.remove()
  }

  private scale(title: string, end: number, beyond: boolean): HTMLElement {
    const scale = make('div')
    scale.className = 'scene-scale'
    const bar = make('span')
    bar.className = 'scene-bar'
    bar.style.background = cividisGradient()
    const last = beyond ? this.words.orMore(end) : this.words.number(end)
    scale.append(make('span', title), make('span', this.words.number(0)), bar, make('span', last))
    return scale
  }

  private part(className: string, text = ''): HTMLElement {
    const part = make('div', text)
    part.className = className
    this.host.append(part)
    return part
  }
}

function make(tag: string, text = ''): HTMLElement {
  const element = document.createElement(tag)
  if (text) element.textContent = text
  return element
}
