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

export const en = { common, shell, cell, measure, map, meshes, programs, verify, report, history, release, users }
