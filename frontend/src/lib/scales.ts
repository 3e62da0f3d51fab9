/**
 * Colours of values: cividis for lengths (readable with deuteranopia and protanopia, and in grey), blue to orange for
 * signed values. `t` runs from 0 to 1; results are sRGB, 0 to 1.
 */
export type Rgb = readonly [number, number, number]
export type Scale = (t: number) => Rgb

// every tenth of cividis (Nuñez, Anderton and Renslow 2018), interpolated between
const CIVIDIS: readonly Rgb[] = [
  [0.0, 0.135, 0.304],
  [0.0, 0.204, 0.435],
  [0.221, 0.274, 0.423],
  [0.33, 0.345, 0.426],
  [0.421, 0.417, 0.443],
  [0.505, 0.49, 0.47],
  [0.595, 0.566, 0.469],
  [0.688, 0.645, 0.448],
  [0.786, 0.728, 0.411],
  [0.889, 0.815, 0.354],
  [0.996, 0.909, 0.218],
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
