/** Lines that two texts have in common, and those of one only. */
export interface DiffLine {
  of: 'both' | 'current' | 'yours'
  text: string
}

/** The lines of both texts in order, by a longest common subsequence. */
export function diffLines(current: string, yours: string): DiffLine[] {
  const a = current.split('\n')
  const b = yours.split('\n')
  let start = 0
  while (start < a.length && start < b.length && a[start] === b[start]) start++
  let end = 0
  while (end < a.length - start && end < b.length - start && a[a.length - 1 - end] === b[b.length - 1 - end]) end++
  const both = (lines: string[]): DiffLine[] => lines.map((text) => ({ of: 'both', text }))
  const middle = between(a.slice(start, a.length - end), b.slice(start, b.length - end))
  return [...both(a.slice(0, start)), ...middle, ...both(a.slice(a.length - end))]
}

function between(a: string[], b: string[]): DiffLine[] {
  const length = Array.from({ length: a.length + 1 }, () => new Uint32Array(b.length + 1))
  for (let i = a.length - 1; i >= 0; i--) {
    for (let j = b.length - 1; j >= 0; j--) {
      length[i]![j] = a[i] === b[j] ? length[i + 1]![j + 1]! + 1 : Math.max(length[i + 1]![j]!, length[i]![j + 1]!)
    }
  }
  const found: DiffLine[] = []
  let i = 0
  let j = 0
  while (i < a.length || j < b.length) {
    if (i < a.length && j < b.length && a[i] === b[j]) {
      found.push({ of: 'both', text: a[i++]! })
      j++
    } else if (j >= b.length || (i < a.length && length[i + 1]![j]! >= length[i]![j + 1]!)) {
      found.push({ of: 'current', text: a[i++]! })
    } else found.push({ of: 'yours', text: b[j++]! })
  }
  return found
}
