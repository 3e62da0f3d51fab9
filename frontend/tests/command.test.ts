import assert from 'node:assert/strict'
import { execFileSync } from 'node:child_process'
import { test } from 'node:test'
import { commandLine } from '../src/lib/command.ts'

test('a shell reads the words as they are', { skip: process.platform === 'win32' }, () => {
  const words = ['fit', 'a b.csv', "it's", '$HOME', '`id`', '"', '*', '', '\\', 'a\nb', '--n=3', '误差.csv', '-', ';']
  const script = commandLine(words).replace('truepose', "printf '%s\\0'")
  assert.deepEqual(execFileSync('sh', ['-c', script]).toString().split('\0').slice(0, -1), words)
})
