/** Numbers that are typed: always with a decimal point, in every language. */

/** The text of a number in a field: shortest form, decimal point, no groups. */
export function fieldText(value: number | null | undefined): string {
  return value === null || value === undefined || !Number.isFinite(value) ? '' : String(value)
}

/** What a field holds: a finite number, or null. "1,5" is null: a comma may also separate thousands. */
export function parseField(text: string): number | null {
  const trimmed = text.trim()
  return /^[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/i.test(trimmed) ? Number(trimmed) : null
}
