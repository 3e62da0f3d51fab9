import assert from 'node:assert/strict'
import test from 'node:test'
import { most, nth } from '../src/scene/reduce.ts'

const ROW = 7

function rows(points: { p: number[]; size: number }[]): Float32Array {
  const made = new Float32Array(ROW * points.length)
  points.forEach(({ p, size }, k) => made.set([...p, size, 0, 0, 0], ROW * k))
  return made
}

test('all rows stay where they are few enough', () => {
  const few = rows(Array.from({ length: 5 }, (_, k) => ({ p: [k, 0, 0], size: k })))
  assert.deepEqual([...most(few, ROW, 5)], [0, 1, 2, 3, 4])
})

test('the longest stay, and of the others some of every place', () => {
  // 9,000 in one corner, 30 lonely ones elsewhere; the longest are those with k % 100 == 7
  const points = Array.from({ length: 9030 }, (_, k) => ({
    p: k < 9000 ? [k % 30, Math.floor(k / 30) % 30, Math.floor(k / 900)] : [1000 + 37 * (k - 9000), 500, 800],
    size: k % 100 === 7 ? 5 : 0.1,
  }))
  const found = most(rows(points), ROW, 400)
  assert.equal(found.length, 400)
  assert.equal(new Set(found).size, 400)
  assert.deepEqual([...found], [...found].sort((a, b) => a - b))
  const kept = new Set(found)
  points.forEach(({ size }, k) => {
    if (size === 5) assert.ok(kept.has(k), `the long row ${k} is missing`)
  })
  const lonely = [...found].filter((k) => k >= 9000)
  assert.equal(lonely.length, 30)
})

test('rows of equal length, unknown ones among them, fill the number exactly', () => {
  const points = Array.from({ length: 1000 }, (_, k) => ({ p: [k % 10, k % 7, k], size: k % 3 ? 1 : Number.NaN }))
  const found = most(rows(points), ROW, 100)
  assert.equal(found.length, 100)
})

test('the value at a place is that of the sorted values', () => {
  const values = Float32Array.from({ length: 2001 }, (_, k) => (k * 7919) % 613)
  const sorted = values.slice().sort()
  for (const place of [0, 1, 500, 1000, 1999, 2000]) assert.equal(nth(values, place), sorted[place])
  assert.ok(Number.isNaN(nth(new Float32Array(0), 0)))
})

test('rows without a place are not spread', () => {
  const points = Array.from({ length: 300 }, (_, k) => ({ p: k < 200 ? [k, 0, 0] : [Number.NaN, 0, 0], size: k < 10 ? 2 : 1 }))
  const found = most(rows(points), ROW, 20)
  assert.ok([...found].every((k) => k < 200))
})
