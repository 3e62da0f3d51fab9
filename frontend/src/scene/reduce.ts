/** Which arrows to show where all are too many. Arrows are rows that start with p and e. */

const CELLS = 16

/** Squares of the lengths of e; −1 where one is not known. */
export function squares(rows: Float32Array, row: number): Float32Array {
  const found = new Float32Array(rows.length / row)
  for (let k = 0, at = 3; k < found.length; k++, at += row) {
    const [x, y, z] = [rows[at]!, rows[at + 1]!, rows[at + 2]!]
    const square = x * x + y * y + z * z
    found[k] = square >= 0 ? square : -1
  }
  return found
}

/** The value that stands at a place when all are in rising order; NaN if there is none. */
export function nth(values: Float32Array, place: number): number {
  const own = values.slice()
  let [low, high] = [0, own.length - 1]
  while (low < high) {
    const pivot = own[(low + high) >> 1]!
    let [i, j] = [low, high]
    while (i <= j) {
      while (own[i]! < pivot) i++
      while (own[j]! > pivot) j--
      if (i > j) break
      const swapped = own[i]!
      own[i++] = own[j]!
      own[j--] = swapped
    }
    if (place <= j) high = j
    else if (place >= i) low = i
    else break
  }
  return own[place] ?? Number.NaN
}

/**
 * Rows of the longest vectors, and of others spread over the space: half of each, without duplicates, in rising order.
 * `size` is what `squares` returns.
 */
export function most(rows: Float32Array, row: number, count: number, size = squares(rows, row)): Int32Array {
  const n = size.length
  if (n <= count) return Int32Array.from({ length: n }, (_, k) => k)
  const half = count >> 1
  const limit = nth(size, n - half)
  const taken = new Uint8Array(n)
  let left = half
  for (let k = 0; k < n && left > 0; k++) if (size[k]! > limit) left -= taken[k] = 1
  for (let k = 0; k < n && left > 0; k++) if (size[k] === limit && !taken[k]) left -= taken[k] = 1
  spread(rows, row, taken, count - half)
  const found = new Int32Array(count)
  let next = 0
  for (let k = 0; k < n && next < count; k++) if (taken[k]) found[next++] = k
  return found.subarray(0, next)
}

/** Take more rows, one of each occupied cell of a grid in turn, until enough are taken. */
function spread(rows: Float32Array, row: number, taken: Uint8Array, count: number): void {
  const cell = cells(rows, row, taken)
  const starts = new Int32Array(CELLS ** 3 + 1)
  for (const one of cell) if (one >= 0) starts[one + 1]!++
  for (let k = 0; k < CELLS ** 3; k++) starts[k + 1]! += starts[k]!
  const next = starts.slice()
  const order = new Int32Array(starts.at(-1)!)
  for (let k = 0; k < cell.length; k++) if (cell[k]! >= 0) order[next[cell[k]!]!++] = k
  const occupied = Int32Array.from({ length: CELLS ** 3 }, (_, k) => k).filter((k) => starts[k + 1]! > starts[k]!)
  for (let turn = 0, left = Math.min(count, order.length); left > 0; turn++) {
    for (const one of occupied) {
      const at = starts[one]! + turn
      if (at >= starts[one + 1]! || left === 0) continue
      taken[order[at]!] = 1
      left -= 1
    }
  }
}

/** The cell of each row in a grid over all of them; −1 for rows that are taken, or have no place. */
function cells(rows: Float32Array, row: number, taken: Uint8Array): Int16Array {
  const n = taken.length
  const low = [Infinity, Infinity, Infinity]
  const high = [-Infinity, -Infinity, -Infinity]
  for (let c = 0; c < 3; c++) {
    for (let at = c; at < rows.length; at += row) {
      const value = rows[at]!
      if (value < low[c]!) low[c] = value
      if (value > high[c]!) high[c] = value
    }
  }
  const found = new Int16Array(n)
  for (let c = 0; c < 3; c++) {
    const [first, scale] = [low[c]!, CELLS / (high[c]! - low[c]! || 1)]
    for (let k = 0, at = c; k < n; k++, at += row) {
      const place = Math.min(CELLS - 1, Math.floor(scale * (rows[at]! - first)))
      found[k] = place >= 0 && found[k]! >= 0 && !taken[k] ? CELLS * found[k]! + place : -1
    }
  }
  return found
}
