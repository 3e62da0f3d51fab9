/** Types and small functions of the page. */
import { significant } from '../../lib/format'
import { t } from '../../lib/i18n/index.svelte'
import type { Schemas } from '../../lib/api'

export type MapEntry = Schemas['MapEntry']
export type MapFacts = Schemas['MapFacts']
export type Lengths = Schemas['Lengths']

/** Numbers of a row of arrays.bin: p, e, length of the standard deviation. */
export const ROW = 7

export interface SampleRow {
  index: number
  p: [number, number, number]
  before: number
  after: number
  std: number
}

/** The samples as rows of a table. */
export function sampleRows(before: Float32Array, after: Float32Array): SampleRow[] {
  return Array.from({ length: before.length / ROW }, (_, index) => {
    const at = ROW * index
    return {
      index,
      p: [before[at]!, before[at + 1]!, before[at + 2]!],
      before: length(before, at + 3),
      after: length(after, at + 3),
      std: before[at + 6]!,
    }
  })
}

export function length(values: Float32Array, at: number): number {
  return Math.sqrt(values[at]! ** 2 + values[at + 1]! ** 2 + values[at + 2]! ** 2) // hypot takes ten times as long
}

/** A magnification of 1, 2 or 5 times a power of ten at which most arrows are well seen beside a size in mm. */
export function usualFactor(rows: Float32Array, size: number): number {
  const lengths = Float32Array.from({ length: rows.length / ROW }, (_, k) => length(rows, ROW * k + 3)).sort()
  const typical = lengths[Math.floor(0.9 * (lengths.length - 1))] ?? 0
  if (!typical || !size) return 100
  const about = (0.12 * size) / typical
  const power = 10 ** Math.floor(Math.log10(about))
  const share = about / power
  return Math.min(10_000, Math.max(1, power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10)))
}

/** The finite largest of some values; 0 if there is none. */
export function largest(values: Float32Array): number {
  return values.reduce((best, value) => (value > best ? value : best), 0)
}

/** A point as text: "1200, 40, 700". */
export function place(p: readonly number[]): string {
  return p.map((value) => significant(value, 5)).join('; ')
}

/** What a figure is of, in the language of the page. */
export function origin(of: Lengths['of']): string {
  return {
    'samples after registration': t('map.of_registered'),
    'leave-one-out': t('map.of_left_out'),
    'unseen blocks': t('map.of_blocks'),
    'cross-validation': t('map.of_crossed'),
  }[of]
}
