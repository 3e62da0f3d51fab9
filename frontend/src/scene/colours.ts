/** Colours: the variables of the theme, and cividis for textures. */
import { Color } from 'three'
import { cividis, cssRgb } from '../lib/scales'

/** Colours of the theme, as three.js takes them. */
export interface Palette {
  page: Color
  grid: Color
  text: Color
  accent: Color
  arm: Color
  drum: Color
  tool: Color
  line: Color
  obstacle: Color
  verdicts: readonly Color[]
}

export function palette(): Palette {
  const style = getComputedStyle(document.documentElement)
  const colour = (name: string) => new Color(style.getPropertyValue(name).trim() || '#888888')
  const [page, text, line] = [colour('--surface'), colour('--text'), colour('--line')]
  const mixed = (share: number) => page.clone().lerp(text, share)
  return {
    page,
    text,
    line: colour('--line-strong'),
    grid: line,
    accent: colour('--accent'),
    arm: mixed(0.22),
    drum: mixed(0.5),
    tool: colour('--accent'),
    obstacle: colour('--skipped'),
    verdicts: ['--corrected', '--muted', '--skipped', '--refused', '--accent'].map(colour),
  }
}

/** 256 colours of cividis in RGBA, for textures. */
export function cividisBytes(): Uint8Array {
  const bytes = new Uint8Array(1024)
  for (let k = 0; k < 256; k++) bytes.set([...cividis(k / 255).map((part) => Math.round(255 * part)), 255], 4 * k)
  return bytes
}

/** A CSS gradient for the legend. */
export function cividisGradient(): string {
  const stops = Array.from({ length: 17 }, (_, k) => cssRgb(cividis(k / 16)))
  return `linear-gradient(to right, ${stops.join(', ')})`
}
