/** Colours: cividis, which all readers see alike, and the variables of the theme. */
import { Color } from 'three'

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
    verdicts: ['--corrected', '--skipped', '--refused', '--line-strong'].map(colour),
  }
}

/** Knots of cividis (Nuñez, Anderton and Renslow 2018), red, green, blue from 0 to 255. */
const CIVIDIS = [
  [0, 34, 78],
  [0, 46, 108],
  [30, 58, 111],
  [53, 69, 108],
  [71, 81, 108],
  [87, 93, 109],
  [102, 105, 112],
  [117, 117, 117],
  [132, 130, 121],
  [148, 142, 119],
  [165, 156, 116],
  [183, 169, 110],
  [200, 184, 102],
  [219, 199, 90],
  [238, 214, 73],
  [254, 232, 56],
] as const

/** Bytes of the colour at a share from 0 to 1. */
export function cividis(share: number): [number, number, number] {
  const at = Math.min(Math.max(share, 0), 1) * (CIVIDIS.length - 1)
  const k = Math.min(Math.floor(at), CIVIDIS.length - 2)
  const [from, to] = [CIVIDIS[k]!, CIVIDIS[k + 1]!]
  const mix = (c: 0 | 1 | 2) => Math.round(from[c] + (at - k) * (to[c] - from[c]))
  return [mix(0), mix(1), mix(2)]
}

/** 256 colours in RGBA, for textures. */
export function cividisBytes(): Uint8Array {
  const bytes = new Uint8Array(1024)
  for (let k = 0; k < 256; k++) bytes.set([...cividis(k / 255), 255], 4 * k)
  return bytes
}

/** A CSS gradient for the legend. */
export function cividisGradient(): string {
  return `linear-gradient(to right, ${CIVIDIS.map((rgb) => `rgb(${rgb.join(' ')})`).join(', ')})`
}
