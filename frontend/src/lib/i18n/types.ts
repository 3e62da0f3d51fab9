import type { en } from './en'

type English = typeof en
type Keys<Page extends keyof English> = keyof English[Page] & string

/** `page.key` of every English text. */
export type Key = { [Page in keyof English]: `${Page}.${Keys<Page>}` }[keyof English]
/** Keys that have the plural forms `.one` and `.other`. */
export type PluralKey = Key extends infer K ? (K extends `${infer Stem}.other` ? Stem : never) : never

/** The texts of a language. Chinese has no plural, so `.one` may be left out. */
export type Messages = {
  [Page in keyof English]: { [K in Exclude<Keys<Page>, `${string}.one`>]: string } & {
    [K in Extract<Keys<Page>, `${string}.one`>]?: string
  }
}

/** Texts that English does not have: `never` when there is none. */
export type Surplus<Other> = {
  [Page in keyof Other]: Page extends keyof English ? Exclude<keyof Other[Page], keyof English[Page]> : Page
}[keyof Other]
