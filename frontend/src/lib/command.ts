/** The command line `truepose …` of words, as it can be pasted into a shell. */
export function commandLine(words: readonly string[]): string {
  return ['truepose', ...words].map(quoted).join(' ')
}

/** Quote a word for a POSIX shell if it needs it. */
export function quoted(word: string): string {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`
}
