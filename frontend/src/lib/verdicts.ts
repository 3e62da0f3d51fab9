/** What happened to a target, and the shape that stands for it (12 × 12), the same in tables, legends and scenes. */
export type VerdictKind = 'corrected' | 'unchanged' | 'skipped' | 'refused'

export const VERDICT_PATHS: Record<VerdictKind, string> = {
  corrected: 'M6 1.500a4.500 4.500 0 1 0 0 9a4.500 4.500 0 1 0 0 -9z',
  unchanged: 'M6 2a4 4 0 1 0 0 8a4 4 0 1 0 0 -8z',
  skipped: 'M6 1L11 6L6 11L1 6z',
  refused: 'M6 1.500L11 10.500L1 10.500z',
}

/** How its shape is drawn, the same in tables and legends. */
export const VERDICT_MARKS = {
  corrected: { kind: 'filled', color: 'var(--corrected)' },
  unchanged: { kind: 'hollow', color: 'var(--muted)' },
  skipped: { kind: 'hollow', color: 'var(--skipped)' },
  refused: { kind: 'filled', color: 'var(--refused)' },
} as const
