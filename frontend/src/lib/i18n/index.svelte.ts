/**
 * Texts in English, German and Chinese: one file a page and language, `i18n/en/map.json`, with flat keys.
 *
 *   t('map.title')                         text of `title` in map.json
 *   t('map.shown', { n: number(5000) })    fills `{n}`
 *   tn('programs.targets', 3)              `targets.one` or `targets.other`, by the plural rules of the language
 *
 * Keys are typed by the English files. A key that German or Chinese lacks does not compile (see `de/index.ts`).
 */
import { fill, translated } from './fill'
import { stored } from '../settings'
import { en } from './en'
import type { Key, Messages, PluralKey } from './types'

export const LANGUAGES = { en: 'English', de: 'Deutsch', zh: '中文' } as const
export type Language = keyof typeof LANGUAGES

interface Texts {
  messages: Messages
  /** What the server says, by its English texts; `{}` stands for what it fills in, `{0}`, `{1}` … for that here. */
  said: Record<string, string>
}
const loaders: Record<Language, () => Promise<Texts>> = {
  en: () => Promise.resolve({ messages: en, said: {} }),
  de: () => import('./de').then(({ de, said }) => ({ messages: de as Messages, said })),
  zh: () => import('./zh').then(({ zh, said }) => ({ messages: zh as Messages, said })),
}

const setting = stored<Language | 'auto'>('language', ['auto', 'en', 'de', 'zh'])
const state = $state<Texts & { language: Language }>({ language: 'en', messages: en, said: {} })

export const i18n = {
  /** The language shown now (reactive). */
  get language(): Language {
    return state.language
  },
}

/** Load and show a language; the browser remembers the choice. */
export async function setLanguage(language: Language): Promise<void> {
  setting.set(language)
  await show(language)
}

/** Show the remembered language, or the first of the browser's that we have. */
export async function startLanguage(): Promise<void> {
  const chosen = setting.get()
  await show(chosen === 'auto' ? preferred() : chosen)
}

async function show(language: Language): Promise<void> {
  Object.assign(state, await loaders[language]())
  state.language = language
  document.documentElement.lang = language === 'zh' ? 'zh-Hans' : language
}

function preferred(): Language {
  const known = navigator.languages.map((tag) => tag.slice(0, 2)).find((tag) => tag in LANGUAGES)
  return (known as Language | undefined) ?? 'en'
}

/** The text of a key, with `{name}` replaced by the values. */
export function t(key: Key, values: Record<string, string | number> = {}): string {
  return fill(lookUp(key), values)
}

/** The plural form of a key for n; `{n}` shows n in the language's digits and groups. */
export function tn(key: PluralKey, n: number, values: Record<string, string | number> = {}): string {
  const form = new Intl.PluralRules(state.language).select(n) === 'one' ? 'one' : 'other'
  const text = lookUp(`${key}.${form}`) || lookUp(`${key}.other`)
  return fill(text, { n: new Intl.NumberFormat(state.language).format(n), ...values })
}

/** A title or a step, which the server says in English, in the language shown; one that is not known as it is. */
export function said(text: string): string {
  return translated(text, state.said)
}

function lookUp(key: string): string {
  const dot = key.indexOf('.')
  const page = (state.messages as Record<string, Record<string, string>>)[key.slice(0, dot)]
  return page?.[key.slice(dot + 1)] ?? ''
}
