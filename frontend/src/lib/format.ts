/**
 * Numbers and units as text. Numbers that are shown follow the language (1.234,500 in German); numbers that are typed
 * or copied into files always have a decimal point. Units stand in headers, not beside each number.
 */
import { i18n } from './i18n/index.svelte'

export const NOTHING = '–'

/** A number with fixed decimals; a dash for null, NaN and infinity. */
export function number(value: number | null | undefined, decimals = 0): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NOTHING
  const rounded = Math.abs(value) < 0.5 * 10 ** -decimals ? 0 : value // no "-0.000"
  return formatter(i18n.language, decimals).format(rounded)
}

/** A length in mm, to the micrometre. */
export const mm = (value: number | null | undefined): string => number(value, 3)
/** An angle in degrees. */
export const degrees = (value: number | null | undefined): string => number(value, 4)
/** A share (0 to 1) in per cent. */
export const percent = (share: number | null | undefined, decimals = 1): string =>
  typeof share === 'number' && Number.isFinite(share) ? `${number(100 * share, decimals)} %` : NOTHING

/** A number with as many significant digits as given, for values whose size is unknown. */
export function significant(value: number | null | undefined, digits = 4): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NOTHING
  return new Intl.NumberFormat(i18n.language, { maximumSignificantDigits: digits }).format(value)
}

/** A date and time (ISO text or seconds since 1970) in the language's form. */
export function dateTime(value: string | number | null | undefined): string {
  if (value === null || value === undefined || value === '') return NOTHING
  const date = new Date(typeof value === 'number' ? value * 1000 : value)
  if (Number.isNaN(date.getTime())) return String(value)
  return new Intl.DateTimeFormat(i18n.language, { dateStyle: 'medium', timeStyle: 'short' }).format(date)
}

/** A day (seconds since 1970) in the language's form. */
export const date = (seconds: number): string =>
  new Intl.DateTimeFormat(i18n.language, { dateStyle: 'medium' }).format(new Date(seconds * 1000))

/** A duration such as "8 s" or "2 min 05 s". */
export function duration(seconds: number): string {
  if (seconds < 60) return `${number(seconds, seconds < 10 ? 1 : 0)} s`
  const whole = Math.round(seconds)
  return `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, '0')} s`
}

/** A size of a file: "640 B", "12.3 kB", "4.1 MB". */
export function fileSize(bytes: number): string {
  const units = ['B', 'kB', 'MB', 'GB']
  const power = Math.min(units.length - 1, Math.floor(Math.log10(Math.max(1, bytes)) / 3))
  return `${number(bytes / 1000 ** power, power ? 1 : 0)} ${units[power]}`
}

const formatters = new Map<string, Intl.NumberFormat>()

function formatter(language: string, decimals: number): Intl.NumberFormat {
  const key = `${language} ${decimals}`
  let found = formatters.get(key)
  if (!found) {
    found = new Intl.NumberFormat(language, { minimumFractionDigits: decimals, maximumFractionDigits: decimals })
    formatters.set(key, found)
  }
  return found
}
