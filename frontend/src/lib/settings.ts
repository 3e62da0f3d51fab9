/** A choice that the browser remembers. The first of `values` holds until the user chooses. */
export function stored<T extends string>(name: string, values: readonly T[]): { get(): T; set(value: T): void } {
  const key = `truepose.${name}`
  return {
    get() {
      try {
        const found = localStorage.getItem(key)
        return values.find((value) => value === found) ?? (values[0] as T)
      } catch {
        return values[0] as T // storage is refused: the choice lasts as long as the page
      }
    },
    set(value) {
      try {
        localStorage.setItem(key, value)
      } catch {
        // see above
      }
    },
  }
}
