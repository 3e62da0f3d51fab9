/** What `truepose verify --json` prints, as far as the page shows it. */
export type DecisionKind = 'pass' | 'undecided' | 'fail'
/** Of a whole program: targets that were measured pass, and others were not measured. */
export type Assessment = DecisionKind | 'not assessed'

export interface VerifiedTarget {
  name: string
  file: string
  line: number
  correction: string
  nominal_mm: [number, number, number]
  measured_mm: [number, number, number]
  error_mm: number
  uncertainty_mm: number
  before_mm: number | null
  readings: number
  decision: DecisionKind
}

/** A contribution to the uncertainty; without a value where it is not stated. */
export interface BudgetLine {
  source: 'reading' | 'reflector' | 'station' | 'tool' | 'repeatability' | 'temperature'
  u_mm: number | null
  share: number | null
  common: boolean
  origin: string
}

export interface Figures {
  n: number
  mean_mm: number
  max_mm: number
}

export interface ProgramVerification {
  decision: Assessment
  counts: Record<DecisionKind, number>
  figures: { before?: Figures; after: Figures }
  rule: string
  program: string
  readings: string
  tolerance_mm: number
  tolerance_origin: string
  station: string
  before: '' | 'measured' | 'predicted'
  targets: VerifiedTarget[]
  unmeasured: string[]
  run: '' | 'original' | 'corrected'
  coverage_factor?: number
  budget?: BudgetLine[]
}
