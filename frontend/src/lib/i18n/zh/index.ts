import common from './common.json'
import shell from './shell.json'
import cell from './cell.json'
import measure from './measure.json'
import map from './map.json'
import meshes from './meshes.json'
import programs from './programs.json'
import verify from './verify.json'
import report from './report.json'
import history from './history.json'
import release from './release.json'
import users from './users.json'
import said from './said.json'
import type { Messages, Surplus } from '../types'

export const zh = { common, shell, cell, measure, map, meshes, programs, verify, report, history, release, users } satisfies Messages

// a text that English does not have is an error here
type None<T extends never> = T
export type Checked = None<Surplus<typeof zh>>

export { said }
