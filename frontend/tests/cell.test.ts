import assert from 'node:assert/strict'
import { test } from 'node:test'
import { diffLines } from '../src/pages/cell/diff.ts'
import { keySchema, unitOf } from '../src/pages/cell/schema.ts'

const of = (lines: ReturnType<typeof diffLines>, side: 'current' | 'yours') =>
  lines.filter((line) => line.of === 'both' || line.of === side).map((line) => line.text).join('\n')

/** Texts of a few different lines, so that many of them repeat. */
function someText(seed: number): string {
  let state = seed * 2654435761 + 1
  const next = (n: number) => ((state = (state * 1103515245 + 12345) >>> 0), (state >>> 8) % n)
  return Array.from({ length: next(14) }, () => 'abc'.charAt(next(3))).join('\n')
}

test('a comparison holds both texts completely and in their order', () => {
  for (let seed = 0; seed < 300; seed++) {
    const [current, yours] = [someText(seed), someText(seed + 1000)]
    const lines = diffLines(current, yours)
    assert.equal(of(lines, 'current'), current)
    assert.equal(of(lines, 'yours'), yours)
  }
})

test('equal lines are shown once', () => {
  assert.deepEqual(diffLines('a\nb\nc', 'a\nB\nc'), [
    { of: 'both', text: 'a' },
    { of: 'current', text: 'b' },
    { of: 'yours', text: 'B' },
    { of: 'both', text: 'c' },
  ])
  assert.ok(diffLines('a\nb', 'a\nb').every((line) => line.of === 'both'))
})

const SCHEMA = {
  $defs: {
    Tool: { properties: { x_mm: { type: 'number', default: 0, minimum: -5, maximum: 5 }, fit: { enum: ['none', 'pose'], default: 'none' } } },
    Box: { properties: { x_mm: { type: 'array', prefixItems: [{ type: 'number' }, { type: 'number' }] } } },
    Region: { properties: { frame: { anyOf: [{ type: 'integer' }, { type: 'string' }, { type: 'null' }] } } },
    Report: { properties: { measured: { anyOf: [{ type: 'string', format: 'date' }, { type: 'null' }] } } },
  },
  properties: {
    tool: { $ref: '#/$defs/Tool' },
    obstacles: { additionalProperties: { $ref: '#/$defs/Box' } },
    region: { anyOf: [{ $ref: '#/$defs/Region' }, { type: 'null' }] },
    report: { $ref: '#/$defs/Report' },
  },
}

test('a key gets the control that its schema asks for', () => {
  const kind = (...path: string[]) => keySchema(SCHEMA, path).kind
  assert.equal(kind('tool', 'x_mm'), 'number')
  assert.equal(kind('tool', 'fit'), 'choice')
  assert.equal(kind('obstacles', 'any name', 'x_mm'), 'numbers')
  assert.equal(kind('report', 'measured'), 'date')
  assert.equal(kind('region', 'frame'), 'text')
  assert.equal(keySchema(SCHEMA, ['region', 'frame']).orWhole, true)
  const { min, max, default: value } = keySchema(SCHEMA, ['tool', 'x_mm'])
  assert.deepEqual([min, max, value], [-5, 5, 0])
})

test('a key that the schema does not know is a text', () => {
  assert.equal(keySchema(SCHEMA, ['none', 'at', 'all']).kind, 'text')
})

test('units are read from names of keys', () => {
  assert.deepEqual(
    ['x_mm', 'range_um', 'range_um_per_m', 'a_deg', 'rx_rad', 'max_rotation_mrad', 'temperature_C', 'dwell_s', 'fit'].map(unitOf),
    ['mm', 'µm', 'µm/m', '°', 'rad', 'mrad', '°C', 's', undefined],
  )
})
