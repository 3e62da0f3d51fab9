import assert from 'node:assert/strict'
import { test } from 'node:test'
import { address, PAGES, parseAddress } from '../src/lib/addresses.ts'

const NOW = { page: 'map', cell: 'c0ffee' } as const

test('an address is read back as it was made', () => {
  const names = ['plain', 'a/b', 'a?b', 'a#b', '50 %', 'Prüfstück', '误差', '..', '%2F']
  for (const page of PAGES) {
    for (const name of names) {
      const route = parseAddress(address({ page, cell: name, rest: [name, 'x'], query: { q: name, n: 3 } }, NOW))
      assert.deepEqual(route, { page, cell: name, rest: [name, 'x'], query: { q: name, n: '3' } })
    }
  }
})

test('page and cell stay unless others are given', () => {
  assert.equal(address({}, NOW), '#/map/c0ffee')
  assert.equal(address({ cell: null }, NOW), '#/map/-')
  assert.equal(parseAddress('#/map/-').cell, null)
})

test('what nobody made is the first page', () => {
  for (const hash of ['', '#', '#/', '#/nothing', '#/%']) assert.equal(parseAddress(hash).page, 'cell')
  assert.deepEqual(parseAddress('#/map/%E0%A4%A').cell, '%E0%A4%A')
})
