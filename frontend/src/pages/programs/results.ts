/** What the commands check and correct print as JSON, as far as the page shows it. */
export interface CoverageReason {
  reason: string
  count: number
  option: string
  assumption: string
}

export interface CoverageLine {
  targets: number
  correctable: number
  reasons: CoverageReason[]
}

export interface CheckResult {
  coverage: CoverageLine
  missing_frames: string[]
  programs: { file: string; correct: number; skip: number; refuse: number; following: number }[]
  unreadable: string[]
  backups: unknown[]
}

export interface CorrectResult {
  written: string[]
  coverage: { corrected: number; targets: number }
  programs: { program: string; summary: Record<string, number>; warnings: string[] }[]
  refused: { file: string; reason: string }[]
}
