/** The options of a uPlot: our axes, colours, bands and straight lines. Used by `components/Chart.svelte`. */
import type uPlot from 'uplot'
import { date, dateTime, number, significant } from './format'
import { cssColor } from './theme.svelte'

export interface ChartSeries {
  label: string
  y: ArrayLike<number | null>
  /** Name of a CSS variable; the curve colours in turn by default. */
  color?: `--${string}`
  points?: boolean
  /** With `points`: a line through them, also across gaps. */
  joined?: boolean
  dash?: boolean
  /** Lower and upper bound, drawn as an area. */
  band?: [ArrayLike<number | null>, ArrayLike<number | null>]
}

export interface ChartLine {
  x?: number
  y?: number
  label: string
  color?: `--${string}`
}

export interface ChartSpec {
  Plot: typeof uPlot
  series: readonly ChartSeries[]
  xLabel: string
  yLabel: string
  xUnit?: string
  yUnit?: string
  /** x is a time in seconds since 1970. */
  xTime?: boolean
  width: number
  height: number
  lines: readonly ChartLine[]
  xRange: () => [number, number] | null
  yRange: () => [number, number] | null
  onhover: (index: number | null) => void
}

/** The columns of a uPlot: x, then each series, followed by the bounds of its band. */
export function chartData(x: ArrayLike<number>, series: readonly ChartSeries[]): uPlot.AlignedData {
  const column = (values: ArrayLike<number | null>) =>
    Array.from(values, (value) => (value !== null && Number.isFinite(value) ? value : null))
  const columns = series.flatMap(({ y, band }) => (band ? [column(y), column(band[0]), column(band[1])] : [column(y)]))
  return [Array.from(x), ...columns] as uPlot.AlignedData
}

export function chartOptions(spec: ChartSpec): uPlot.Options {
  const colors = spec.series.map(({ color }, i) => cssColor(color ?? `--curve-${(i % 5) + 1}`))
  const series: uPlot.Series[] = [{ label: title(spec.xLabel, spec.xUnit), value: (_, value) => (spec.xTime && value !== null ? dateTime(value) : significant(value)) }]
  const bands: uPlot.Band[] = []
  spec.series.forEach((one, i) => {
    const color = colors[i] as string
    series.push(drawn(one, color))
    if (!one.band) return
    const low = series.length
    series.push(bound(`${one.label} −`, color), bound(`${one.label} +`, color))
    bands.push({ series: [low + 1, low], fill: transparent(color, 0.18) })
  })
  const [text, line] = [cssColor('--muted'), cssColor('--line')]
  const axis = (label: string): uPlot.Axis => ({
    label,
    stroke: text,
    grid: { stroke: line, width: 1 },
    ticks: { stroke: line, width: 1 },
    font: '12px system-ui, sans-serif',
    labelFont: '12px system-ui, sans-serif',
    labelSize: 20,
    values: (_, splits) => {
      const step = splits.length > 1 ? Math.abs((splits[1] as number) - (splits[0] as number)) : 1
      const whole = Math.max(0, -Math.floor(Math.log10(step) + 1e-9))
      const decimals = Math.abs(step * 10 ** whole - Math.round(step * 10 ** whole)) > 1e-6 ? whole + 1 : whole // 0.025
      return splits.map((value) => number(value, decimals))
    },
  })
  return {
    width: spec.width,
    height: spec.height - 28, // the legend stands below
    series,
    bands,
    axes: [spec.xTime ? timeAxis(axis(spec.xLabel)) : axis(title(spec.xLabel, spec.xUnit)), { ...axis(title(spec.yLabel, spec.yUnit)), size: 64 }],
    scales: {
      x: { time: false, range: (_, min, max) => spec.xRange() ?? widened(min, max, spec.xTime ? 0.03 : 0) },
      y: { range: (_, min, max) => spec.yRange() ?? widened(min, max, 0.06) },
    },
    cursor: { drag: { x: false, y: false }, points: { size: 7 } },
    legend: { live: true, markers: { width: 2 } },
    hooks: {
      draw: [(plot) => spec.lines.forEach((one) => drawLine(plot, one))],
      setCursor: [(plot) => spec.onhover(plot.cursor.idx ?? null)],
    },
  }
}

const DAY = 86_400

/** Dates below an axis of seconds since 1970; times of day where days are too coarse. */
function timeAxis(axis: uPlot.Axis): uPlot.Axis {
  return {
    ...axis,
    space: 104,
    incrs: [60, 300, 900, 3600, 3 * 3600, 6 * 3600, 12 * 3600, ...[1, 2, 7, 14, 30, 61, 91, 183, 365, 730, 1826].map((n) => n * DAY)],
    values: (_, splits) => {
      const step = splits.length > 1 ? (splits[1] as number) - (splits[0] as number) : DAY
      return splits.map((value) => (step < DAY ? dateTime(value) : date(value)))
    },
  }
}

function drawn({ label, points, joined, dash }: ChartSeries, color: string): uPlot.Series {
  return {
    label,
    stroke: color,
    width: points ? (joined ? 1.5 : 0) : 2,
    spanGaps: joined ?? false,
    dash: dash ? [6, 4] : undefined,
    points: points ? { show: true, size: 6, stroke: color, fill: color } : { show: false },
    value: (_, value) => significant(value),
  }
}

function bound(label: string, color: string): uPlot.Series {
  return { label, class: 'band-bound', stroke: transparent(color, 0.4), width: 1, points: { show: false }, value: (_, value) => significant(value) }
}

function drawLine(plot: uPlot, { x, y, label, color }: ChartLine): void {
  const { ctx, bbox } = plot
  const ratio = devicePixelRatio
  ctx.save()
  ctx.strokeStyle = ctx.fillStyle = cssColor(color ?? '--text')
  ctx.lineWidth = ratio
  ctx.setLineDash([5 * ratio, 4 * ratio])
  ctx.font = `${11 * ratio}px system-ui, sans-serif`
  ctx.beginPath()
  if (y !== undefined) {
    const at = plot.valToPos(y, 'y', true)
    ctx.moveTo(bbox.left, at)
    ctx.lineTo(bbox.left + bbox.width, at)
    ctx.textAlign = 'right'
    ctx.fillText(label, bbox.left + bbox.width - 4 * ratio, at - 4 * ratio)
  } else if (x !== undefined) {
    const at = plot.valToPos(x, 'x', true)
    ctx.moveTo(at, bbox.top)
    ctx.lineTo(at, bbox.top + bbox.height)
    ctx.textAlign = 'left'
    ctx.fillText(label, at + 4 * ratio, bbox.top + 12 * ratio)
  }
  ctx.stroke()
  ctx.restore()
}

function title(label: string, unit: string | undefined): string {
  return unit ? `${label} [${unit}]` : label
}

function widened(min: number | null, max: number | null, share: number): [number, number] {
  if (min === null || max === null || !Number.isFinite(min) || !Number.isFinite(max)) return [0, 1]
  const pad = (max - min) * share || (min === max ? Math.abs(min) * 0.1 || 1 : 0)
  return [min >= 0 && min - pad < 0 ? 0 : min - pad, max + pad]
}

function transparent(color: string, alpha: number): string {
  return `color-mix(in srgb, ${color} ${Math.round(100 * alpha)}%, transparent)`
}
