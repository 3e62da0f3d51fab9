/** The sections of the form, in the order of the file, and the keys that need no control of their own. */
import type { Key } from '../../lib/i18n/types'

export interface Section {
  table: string
  title: Key
  /** Whether the table is a pose. */
  pose?: boolean
  keys: { key: string; label: Key; hint?: Key }[]
}

export const SECTIONS: readonly Section[] = [
  {
    table: 'tool',
    title: 'cell.tool',
    pose: true,
    keys: [{ key: 'fit', label: 'cell.fit', hint: 'cell.tool_fit_hint' }],
  },
  {
    table: 'tracker',
    title: 'cell.tracker',
    pose: true,
    keys: [
      { key: 'fit', label: 'cell.fit', hint: 'cell.tracker_fit_hint' },
      { key: 'robust', label: 'cell.robust' },
      { key: 'std_mm', label: 'cell.std', hint: 'cell.std_hint' },
      { key: 'range_um', label: 'cell.range' },
      { key: 'range_um_per_m', label: 'cell.range_per_m' },
      { key: 'angle_um', label: 'cell.across' },
      { key: 'angle_um_per_m', label: 'cell.across_per_m' },
    ],
  },
  { table: 'base', title: 'cell.base', pose: true, keys: [{ key: 'fit', label: 'cell.fit', hint: 'cell.base_fit_hint' }] },
  {
    table: 'payload',
    title: 'cell.payload',
    keys: [
      { key: 'mass_kg', label: 'cell.mass' },
      { key: 'x_mm', label: 'cell.centre_x' },
      { key: 'y_mm', label: 'cell.centre_y' },
      { key: 'z_mm', label: 'cell.centre_z' },
    ],
  },
  {
    table: 'conditions',
    title: 'cell.conditions',
    keys: [
      { key: 'approach', label: 'cell.approach_known', hint: 'cell.approach_known_hint' },
      { key: 'temperature_C', label: 'cell.temperature_at_work', hint: 'cell.at_work_hint' },
      { key: 'payload_kg', label: 'cell.payload_at_work', hint: 'cell.at_work_hint' },
    ],
  },
  {
    table: 'measuring',
    title: 'cell.measuring',
    keys: [
      { key: 'dwell_s', label: 'cell.dwell' },
      { key: 'speed_percent', label: 'cell.speed' },
      { key: 'trigger_output', label: 'cell.trigger' },
      { key: 'approach_deg', label: 'cell.approach', hint: 'cell.approach_hint' },
      { key: 'approach', label: 'cell.approach_sides', hint: 'cell.approach_sides_hint' },
      { key: 'limit_margin_deg', label: 'cell.limit_margin' },
      { key: 'reflector_axis', label: 'cell.reflector_axis' },
      { key: 'acceptance_deg', label: 'cell.acceptance' },
      { key: 'link_radius_mm', label: 'cell.link_radius' },
      { key: 'repeatability_mm', label: 'cell.repeatability_axis' },
    ],
  },
  {
    table: 'uncertainty',
    title: 'cell.uncertainty',
    keys: [
      { key: 'reflector_mm', label: 'cell.u_reflector' },
      { key: 'tool_mm', label: 'cell.u_tool' },
      { key: 'temperature_K', label: 'cell.u_temperature' },
      { key: 'expansion_um_per_m_K', label: 'cell.u_expansion' },
    ],
  },
  {
    table: 'correction',
    title: 'cell.correction',
    keys: [
      { key: 'tolerance_mm', label: 'cell.tolerance' },
      { key: 'on_guard', label: 'cell.on_guard' },
      { key: 'max_correction_mm', label: 'cell.max_correction' },
      { key: 'max_std_mm', label: 'cell.max_std' },
      { key: 'min_correction_stds', label: 'cell.min_stds' },
      { key: 'max_distance_mm', label: 'cell.max_distance' },
      { key: 'max_distance_deg', label: 'cell.max_distance_joints' },
      { key: 'max_joint_gap_deg', label: 'cell.max_joint_gap' },
      { key: 'max_angle_deg', label: 'cell.max_angle' },
      { key: 'max_tool_mm', label: 'cell.max_tool' },
      { key: 'max_bend_mm', label: 'cell.max_bend' },
      { key: 'max_difference_mm', label: 'cell.max_difference' },
      { key: 'max_difference_mrad', label: 'cell.max_difference_turn' },
      { key: 'max_rotation_mrad', label: 'cell.max_rotation' },
      { key: 'max_rotation_std_mrad', label: 'cell.max_rotation_std' },
      { key: 'require', label: 'cell.require', hint: 'cell.require_hint' },
    ],
  },
  {
    table: 'report',
    title: 'cell.report',
    keys: [
      { key: 'company', label: 'cell.company' },
      { key: 'logo', label: 'cell.logo' },
      { key: 'site', label: 'cell.site' },
      { key: 'operator', label: 'cell.operator' },
      { key: 'job', label: 'cell.job' },
      { key: 'part', label: 'cell.part' },
      { key: 'measured', label: 'cell.measured' },
      { key: 'robot_serial', label: 'cell.robot_serial' },
      { key: 'tracker', label: 'cell.tracker_model' },
      { key: 'tracker_serial', label: 'cell.tracker_serial' },
      { key: 'tracker_calibration_due', label: 'cell.tracker_due' },
      { key: 'reflector', label: 'cell.reflector' },
      { key: 'reflector_calibration_due', label: 'cell.reflector_due' },
      { key: 'temperature_C', label: 'cell.temperature' },
      { key: 'tolerance_mm', label: 'cell.tolerance' },
    ],
  },
]
