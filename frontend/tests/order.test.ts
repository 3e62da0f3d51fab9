import assert from 'node:assert/strict'
import { test } from 'node:test'
import { arrange } from '../src/lib/order.ts'

interface Row {
  name: string
  error: number | null
}

const columns = [
  { key: 'name', value: (row: Row) => row.name },
  { key: 'error', value: (row: Row) => row.error },
]
const rows: Row[] = [
  { name: 'P10', error: 0.2 },
  { name: 'P9', error: null },
  { name: 'p2 home', error: -0.5 },
  { name: 'P1', error: NaN },
]
const names = (found: readonly Row[]) => found.map((row) => row.name)

test('numbers in names count as numbers', () => {
  assert.deepEqual(names(arrange(rows, columns, '', { key: 'name', descending: false })), ['P1', 'p2 home', 'P9', 'P10'])
})

test('rows without a value are last in both directions', () => {
  for (const descending of [false, true]) {
    const found = names(arrange(rows, columns, '', { key: 'error', descending }))
    assert.deepEqual(found, [...(descending ? ['P10', 'p2 home'] : ['p2 home', 'P10']), 'P9', 'P1'])
  }
})

test('every word of a filter must be in some column', () => {
  assert.deepEqual(names(arrange(rows, columns, 'HOME p2', null)), ['p2 home'])
  assert.deepEqual(names(arrange(rows, columns, 'home p9', null)), [])
  assert.equal(arrange(rows, columns, '  ', null), rows)
})

test('the given rows stay in their order', () => {
  const before = [...rows]
  arrange(rows, columns, '', { key: 'name', descending: true })
  assert.deepEqual(rows, before)
})
