import assert from 'node:assert/strict'
import { test } from 'node:test'
import { fieldText, parseField } from '../src/lib/fields.ts'

test('a number is read back from its own text', () => {
  for (const value of [0, -0.001, 12.5, 1e-9, 6.02e23, -1234567.891]) assert.equal(parseField(fieldText(value)), value)
})

test('what could be read in two ways is no number', () => {
  for (const text of ['1,5', '1.234,5', '1 000', '1.2.3', '', ' ', 'NaN', 'Infinity', '0x10', '1e', '.', '--1']) {
    assert.equal(parseField(text), null, text)
  }
})

test('a value that is missing or not finite is an empty field', () => {
  for (const value of [null, undefined, NaN, Infinity]) assert.equal(fieldText(value), '')
})
