/** The verdicts of records, and the shapes that stand for them. */
import type { VerdictKind } from '../../lib/verdicts'
import { VERDICTS as SHAPES } from '../../scene'

/** By their codes in path.bin. */
export const VERDICTS = ['skip', 'correct', 'clip', 'refuse', 'below uncertainty', 'follows'] as const
export type Verdict = (typeof VERDICTS)[number]

export const KINDS: Record<Verdict, VerdictKind> = {
  correct: 'corrected',
  clip: 'corrected',
  follows: 'corrected',
  'below uncertainty': 'unchanged',
  skip: 'skipped',
  refuse: 'refused',
}

export function kindOf(verdict: string): VerdictKind {
  return KINDS[verdict as Verdict] ?? 'skipped'
}

/** The shape in the scene of each code of path.bin. */
export const SHAPE_OF_CODE = Uint8Array.from(VERDICTS, (verdict) => SHAPES.indexOf(KINDS[verdict]))
