/**
 * Colours of values: cividis for lengths (readable with deuteranopia and protanopia, and in grey), blue to orange for
 * signed values. `t` runs from 0 to 1; results are sRGB, 0 to 1.
 */
export type Rgb = readonly [number, number, number]
export type Scale = (t: number) => Rgb

// 16 colours of cividis (Nuñez, Anderton and Renslow 2018), interpolated between
const CIVIDIS: readonly Rgb[] = [
  [0, 0.133, 0.306],
  [0, 0.18, 0.424],
  [0.118, 0.227, 0.435],
  [0.208, 0.271, 0.424],
  [0.278, 0.318, 0.424],
  [0.341, 0.365, 0.427],
  [0.4, 0.412, 0.439],
  [0.459, 0.459, 0.459],
  [0.518, 0.51, 0.475],
  [0.58, 0.557, 0.467],
  [0.647, 0.612, 0.455],
  [0.718, 0.663, 0.431],
  [0.784, 0.722, 0.4],
  [0.859, 0.78, 0.353],
  [0.933, 0.839, 0.286],
  [0.996, 0.91, 0.22],
]

const BLUE_ORANGE: readonly Rgb[] = [
  [0.03, 0.25, 0.5],
  [0.2, 0.5, 0.76],
  [0.62, 0.79, 0.9],
  [0.95, 0.95, 0.94],
  [0.98, 0.77, 0.54],
  [0.9, 0.48, 0.12],
  [0.55, 0.24, 0.02],
]

export const cividis: Scale = (t) => interpolate(CIVIDIS, t)
/** 0.5 is zero, 0 the most negative, 1 the most positive. */
export const blueOrange: Scale = (t) => interpolate(BLUE_ORANGE, t)

export function cssRgb([r, g, b]: Rgb): string {
  return `rgb(${Math.round(255 * r)} ${Math.round(255 * g)} ${Math.round(255 * b)})`
}

function interpolate(stops: readonly Rgb[], t: number): Rgb {
  const at = Math.min(1, Math.max(0, Number.isFinite(t) ? t : 0)) * (stops.length - 1)
  const index = Math.min(stops.length - 2, Math.floor(at))
  const share = at - index
  const [low, high] = [stops[index] as Rgb, stops[index + 1] as Rgb]
  return [0, 1, 2].map((i) => (low[i] as number) * (1 - share) + (high[i] as number) * share) as unknown as Rgb
}
