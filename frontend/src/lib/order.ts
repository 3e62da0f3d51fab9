/** The order and the filter of rows that the page holds. */

type Value = string | number | null | undefined

export interface Ordered<Row> {
  key: string
  /** What is shown, sorted and filtered. */
  value: (row: Row) => Value
}

export interface Sorting {
  key: string
  descending: boolean
}

/** The rows that pass the filter (all its words in some column), in order; rows without a value come last. */
export function arrange<Row>(
  rows: readonly Row[],
  columns: readonly Ordered<Row>[],
  filter: string,
  sorting: Sorting | null,
): readonly Row[] {
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean)
  const found = words.length
    ? rows.filter((row) => {
        const texts = columns.map((column) => String(column.value(row) ?? '').toLowerCase())
        return words.every((word) => texts.some((text) => text.includes(word)))
      })
    : rows
  const column = columns.find((candidate) => candidate.key === sorting?.key)
  if (!column || !sorting) return found
  const sign = sorting.descending ? -1 : 1
  return found
    .map((row) => ({ row, value: column.value(row) }))
    .sort((a, b) => Number(isMissing(a.value)) - Number(isMissing(b.value)) || sign * compare(a.value, b.value))
    .map(({ row }) => row)
}

function isMissing(value: Value): boolean {
  return value === null || value === undefined || (typeof value === 'number' && Number.isNaN(value))
}

const collator = new Intl.Collator(undefined, { numeric: true })

function compare(a: Value, b: Value): number {
  if (isMissing(a) || isMissing(b)) return 0
  if (typeof a === 'number' && typeof b === 'number') return a - b
  return collator.compare(String(a), String(b))
}
