/** What the JSON schema of cell files says about a key: which control it needs, its bounds and its default. */
import type { Path } from './editor.svelte'

interface Schema {
  $ref?: string
  $defs?: Record<string, Schema>
  type?: string
  format?: string
  enum?: string[]
  anyOf?: Schema[]
  properties?: Record<string, Schema>
  additionalProperties?: Schema | boolean
  items?: Schema
  prefixItems?: Schema[]
  minItems?: number
  minimum?: number
  maximum?: number
  exclusiveMinimum?: number
  default?: unknown
}

export interface KeySchema {
  kind: 'number' | 'whole' | 'text' | 'flag' | 'choice' | 'date' | 'numbers'
  choices: string[]
  /** Whether a text of digits is a number, as the numbers of frames are. */
  orWhole: boolean
  min?: number
  max?: number
  default: unknown
}

export function keySchema(root: Record<string, unknown>, path: Path): KeySchema {
  const whole = root as Schema
  let at: Schema = whole
  for (const key of path) at = child(whole, at, key)
  const forms = [at, ...(at.anyOf ?? [])].map((form) => resolved(whole, form))
  const is = (type: string) => forms.some((form) => form.type === type)
  const bounds = forms.find((form) => form.type === 'number' || form.type === 'integer')
  const choices = forms.flatMap((form) => form.enum ?? [])
  const kind = choices.length
    ? 'choice'
    : is('array')
      ? 'numbers'
      : is('boolean')
        ? 'flag'
        : forms.some((form) => form.format === 'date')
          ? 'date'
          : is('number')
            ? 'number'
            : is('integer') && !is('string')
              ? 'whole'
              : 'text'
  const orWhole = kind === 'text' && is('integer')
  return { kind, choices, orWhole, min: bounds?.minimum ?? bounds?.exclusiveMinimum, max: bounds?.maximum, default: at.default }
}

function child(root: Schema, schema: Schema, key: string): Schema {
  for (const form of [schema, ...(schema.anyOf ?? [])].map((one) => resolved(root, one))) {
    const found = form.properties?.[key] ?? (typeof form.additionalProperties === 'object' ? form.additionalProperties : undefined)
    if (found) return found.$ref ? { ...resolved(root, found), default: found.default } : found
  }
  return {}
}

function resolved(root: Schema, schema: Schema): Schema {
  return schema.$ref ? (root.$defs?.[schema.$ref.split('/').at(-1) ?? ''] ?? {}) : schema
}

/** The unit in the name of a key. */
export function unitOf(key: string): string | undefined {
  const units: [RegExp, string][] = [
    [/_um_per_m$/, 'µm/m'],
    [/_um$/, 'µm'],
    [/_mm$/, 'mm'],
    [/_mrad$/, 'mrad'],
    [/_rad$/, 'rad'],
    [/_deg$/, '°'],
    [/_kg$/, 'kg'],
    [/_percent$/, '%'],
    [/_C$/, '°C'],
    [/_s$/, 's'],
  ]
  return units.find(([ending]) => ending.test(key))?.[1]
}
