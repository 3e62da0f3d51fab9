/** Which arrows to show where all are too many. */

const CELLS = 16

/**
 * Rows of the longest vectors, and of others spread over the space: half of each, without duplicates, in rising order.
 * A row starts with p and e.
 */
export function most(rows: Float32Array, row: number, count: number): Int32Array {
  const n = rows.length / row
  if (n <= count) return Int32Array.from({ length: n }, (_, k) => k)
  const size = new Float32Array(n) // squares: only their order counts
  for (let k = 0; k < n; k++) {
    const at = row * k + 3
    const square = rows[at]! ** 2 + rows[at + 1]! ** 2 + rows[at + 2]! ** 2
    size[k] = square >= 0 ? square : -1
  }
  const half = count >> 1
  const limit = size.slice().sort()[n - half]!
  const taken = new Uint8Array(n)
  let left = count
  for (let k = 0; k < n && left > count - half; k++) {
    if (size[k]! > limit) left -= taken[k] = 1
  }
  for (let k = 0; k < n && left > count - half; k++) {
    if (size[k] === limit && !taken[k]) left -= taken[k] = 1
  }
  spread(rows, row, taken, left)
  const found = new Int32Array(count)
  let next = 0
  for (let k = 0; k < n && next < count; k++) if (taken[k]) found[next++] = k
  return found.subarray(0, next)
}

/** Take more rows, one of each occupied cell of a grid in turn, until enough are taken. */
function spread(rows: Float32Array, row: number, taken: Uint8Array, count: number): void {
  const n = taken.length
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]]
  for (let k = 0; k < n; k++) {
    for (let c = 0; c < 3; c++) {
      const value = rows[row * k + c]!
      if (value < low[c]!) low[c] = value
      if (value > high[c]!) high[c] = value
    }
  }
  const cells = new Map<number, number[]>()
  for (let k = 0; k < n; k++) {
    if (taken[k]) continue
    let cell = 0
    for (let c = 0; c < 3; c++) {
      const share = (rows[row * k + c]! - low[c]!) / (high[c]! - low[c]! || 1)
      cell = CELLS * cell + Math.min(CELLS - 1, Math.floor(CELLS * share))
    }
    const held = cells.get(cell)
    if (held) held.push(k)
    else cells.set(cell, [k])
  }
  let left = count
  const lists = [...cells.values()]
  for (let turn = 0; left > 0; turn++) {
    const before = left
    for (const list of lists) {
      // a step that is prime to most lengths spreads the choice inside of a cell
      const k = list[(turn * 7919) % list.length]!
      if (turn < list.length && left > 0 && !taken[k]) left -= taken[k] = 1
    }
    if (left === before && turn > n) return
  }
}
