import assert from 'node:assert/strict'
import { test } from 'node:test'
import { translated } from '../src/lib/i18n/fill.ts'

const TEXTS = {
  'Check {}': '{0} prüfen',
  'Fitting {}': '{0} anpassen',
  'Correcting {}': '{0} wird korrigiert',
  'Correcting {} ({} of {})': '{0} wird korrigiert ({1} von {2})',
  '{} (compiling)': '{0} (wird kompiliert)',
  'Cross-validation: {} of {} fits, {}': '{1}: {0}, {2}',
}

test('what is filled in stays, in the order of the language', () => {
  assert.equal(translated('Check a{0} (b).src', TEXTS), 'a{0} (b).src prüfen')
  assert.equal(translated('Cross-validation: 3 of 9 fits, a, b', TEXTS), '9: 3, a, b')
})

test('the longest text that fits is taken, and inner texts are found', () => {
  assert.equal(translated('Correcting a.src (2 of 3)', TEXTS), 'a.src wird korrigiert (2 von 3)')
  assert.equal(translated('Correcting a.src', TEXTS), 'a.src wird korrigiert')
  assert.equal(translated('Fitting kriging (compiling)', TEXTS), 'kriging anpassen (wird kompiliert)')
})

test('what is not known stays as it is', () => {
  for (const text of ['', 'Checking', 'report.html', 'Check ']) assert.equal(translated(text, TEXTS), text)
})
