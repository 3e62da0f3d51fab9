/** Texts with places to fill in. */

/** A text with `{name}` replaced by the values. */
export function fill(text: string, values: Record<string, string | number>): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => (name in values ? String(values[name]) : whole))
}

/** An English text by a table of texts with `{}`, the longest that fits; what is filled in is looked up, too. */
export function translated(text: string, texts: Record<string, string>): string {
  const known = texts[text]
  if (known) return known
  for (const english of Object.keys(texts).filter((one) => one.includes('{}')).sort((a, b) => b.length - a.length)) {
    const parts = english.split('{}').map((part) => part.replace(/[.*+?^${}()|[\]\\]/g, '\\$&'))
    const found = new RegExp(`^${parts.join('(.+?)')}$`, 's').exec(text)
    if (found) return fill(texts[english] ?? '', Object.fromEntries(found.slice(1).map((part, k) => [k, translated(part, texts)])))
  }
  return text
}
