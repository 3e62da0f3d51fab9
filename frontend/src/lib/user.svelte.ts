/** The user who has logged in; null on a server without users, and before it is known. */
import { session, type Schemas } from './api'

export type User = NonNullable<Schemas['Session']['user']>
export const ROLES = ['read', 'measure', 'program', 'release', 'admin'] as const

const state = $state<{ user: User | null }>({ user: null })

export const user = {
  get current(): User | null {
    return state.user
  },
}

export async function loadUser(): Promise<void> {
  state.user = (await session()).user ?? null
}

/** Whether the user has a role; everybody has all on a server without users. */
export function hasRole(role: User['roles'][number]): boolean {
  return state.user === null || state.user.roles.includes(role)
}
