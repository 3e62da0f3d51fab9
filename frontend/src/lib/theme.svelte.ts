/** Light, dark, or as the system has it. `theme.dark` is what charts and scenes ask. */
import { stored } from './settings'

export type ThemeChoice = 'system' | 'light' | 'dark'

const system = matchMedia('(prefers-color-scheme: dark)')
const state = $state({ choice: stored<ThemeChoice>('theme', ['system', 'light', 'dark']).get(), systemDark: system.matches })
system.addEventListener('change', (event) => {
  state.systemDark = event.matches
  apply()
})

export const theme = {
  get choice(): ThemeChoice {
    return state.choice
  },
  set choice(value: ThemeChoice) {
    state.choice = value
    stored<ThemeChoice>('theme', ['system', 'light', 'dark']).set(value)
    apply()
  },
  get dark(): boolean {
    return state.choice === 'dark' || (state.choice === 'system' && state.systemDark)
  },
}

/** The value of a CSS variable, for canvases: `cssColor('--accent')`. Read it again when `theme.dark` changes. */
export function cssColor(name: `--${string}`): string {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim()
}

function apply(): void {
  document.documentElement.dataset['theme'] = theme.dark ? 'dark' : 'light'
}

apply()
