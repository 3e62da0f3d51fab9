/** The options of reading and correcting programs, as the server takes them, and the command that they make. */
import type { Schemas } from '../../lib/api'

export type ReadingOptions = Schemas['ReadingOptions']
export type CorrectionOptions = Schemas['CorrectionOptions']

export const DEFAULTS: Required<CorrectionOptions> = {
  tool: '',
  base: '',
  calls_keep_frames: false,
  ambiguous: 'refuse',
  absolute_accuracy: false,
  external_axes: false,
  offsets: false,
  derived: false,
  frame_tolerance: '',
  tool_tolerance: '',
  angles: '',
  joint_targets: false,
  controller_kinematics: false,
  whole_task: false,
  system_modules: false,
  mechanical_unit: '',
  controller: [],
  on_guard: '',
  orientation: false,
  require: '',
  other_maker: false,
  other_robot: '',
  this_robot: false,
  accept_weak_map: false,
  accept: [],
  whole: false,
  keep_going: false,
  dry_run: false,
  xlsx: false,
}

export type OptionName = keyof typeof DEFAULTS
type Named<T> = { [K in OptionName]: (typeof DEFAULTS)[K] extends T ? K : never }[OptionName]
export type Flag = Exclude<Named<boolean>, 'dry_run'>
export type List = Named<string[]>
export type Word = 'tool' | 'base' | 'frame_tolerance' | 'tool_tolerance' | 'angles' | 'mechanical_unit' | 'other_robot' | 'require'

/** The few that matter; the others are one click away. */
export const FLAGS: readonly Flag[] = ['derived', 'joint_targets', 'orientation', 'keep_going']
export const MORE_FLAGS: readonly Flag[] = [
  'whole',
  'whole_task',
  'calls_keep_frames',
  'offsets',
  'external_axes',
  'absolute_accuracy',
  'controller_kinematics',
  'system_modules',
  'other_maker',
  'this_robot',
  'accept_weak_map',
  'xlsx',
]
export const WORDS: readonly Word[] = ['frame_tolerance', 'tool_tolerance', 'require', 'tool', 'base', 'angles', 'mechanical_unit', 'other_robot']
export const LISTS: readonly List[] = ['controller', 'accept']
/** Options that only a correction has. */
const OF_CORRECTION: readonly OptionName[] = [
  'on_guard',
  'orientation',
  'require',
  'other_maker',
  'other_robot',
  'this_robot',
  'accept_weak_map',
  'accept',
  'whole',
  'keep_going',
  'dry_run',
  'xlsx',
]

/** The flag of an option of the command line, such as "--derived"; undefined for one with a value. */
export function flagOf(option: string): Flag | undefined {
  const name = option.replace(/^--/, '').replaceAll('-', '_')
  return [...FLAGS, ...MORE_FLAGS].find((flag) => flag === name)
}

/** Options as words of a command line; those at their defaults are left out. */
export function words(options: Partial<CorrectionOptions>): string[] {
  return (Object.entries(options) as [OptionName, unknown][]).flatMap(([name, value]) => {
    const option = `--${name.replaceAll('_', '-')}`
    if (value === true) return [option]
    if (Array.isArray(value)) return value.map((one) => `${option}=${one}`)
    return value === DEFAULTS[name] ? [] : [`${option}=${String(value)}`]
  })
}

/** The options of reading alone, for a check. */
export function reading(options: CorrectionOptions): ReadingOptions {
  const kept = Object.entries(options).filter(([name]) => !OF_CORRECTION.includes(name as OptionName))
  return Object.fromEntries(kept) as ReadingOptions
}
