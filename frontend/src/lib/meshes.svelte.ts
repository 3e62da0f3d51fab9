/**
 * The meshes of the arms of cells, shared by the pictures of all pages.
 *
 *   $effect(() => scene?.setMeshes(meshesOf(cell)))   // null until they are loaded, and where there are none
 */
import { bytes, del, get, upload, type Schemas } from './api'
import { formOf, type PathFile } from './files'
import { showProblem } from './notices.svelte'

export type ArmMeshes = Schemas['ArmMeshes']

/** Meshes with their points and indices. */
export interface LoadedMeshes {
  about: ArmMeshes
  data: ArrayBuffer
}

interface Entry {
  about: ArmMeshes | null
  loaded: LoadedMeshes | null
}

let entries = $state.raw<Readonly<Record<string, Entry>>>({})
const asked = new Set<string>()

/** The meshes of a cell, to be drawn; asks the server at the first call. */
export function meshesOf(cell: string | null): LoadedMeshes | null {
  return entryOf(cell)?.loaded ?? null
}

/** What is known of the meshes of a cell; null until the server has answered. */
export function aboutMeshes(cell: string | null): ArmMeshes | null {
  return entryOf(cell)?.about ?? null
}

/** Ask the server again, for example after a change of the robot. */
export async function loadMeshes(cell: string): Promise<void> {
  asked.add(cell)
  await show(cell, await get('/api/v1/cells/{cell}/meshes', { path: { cell } }))
}

/** Send a URDF folder or .zip, and show its meshes. */
export async function sendMeshes(cell: string, files: readonly PathFile[], onProgress: (share: number) => void): Promise<ArmMeshes> {
  const about = await upload('/api/v1/cells/{cell}/meshes', { path: { cell }, body: formOf(files), onProgress })
  await show(cell, about)
  return about
}

/** Show the shells again. */
export async function removeMeshes(cell: string): Promise<void> {
  await del('/api/v1/cells/{cell}/meshes', { path: { cell } })
  await loadMeshes(cell)
}

function entryOf(cell: string | null): Entry | undefined {
  if (cell !== null && !asked.has(cell)) {
    asked.add(cell)
    loadMeshes(cell).catch((error: unknown) => {
      asked.delete(cell)
      showProblem(error)
    })
  }
  return cell === null ? undefined : entries[cell]
}

async function show(cell: string, about: ArmMeshes): Promise<void> {
  const { hash } = about
  const before = entries[cell]?.loaded
  let loaded: LoadedMeshes | null = null
  if (hash && before?.about.hash === hash) loaded = before
  else if (hash) {
    loaded = { about, data: await bytes('/api/v1/cells/{cell}/meshes.bin', { path: { cell }, query: { version: hash } }) }
  }
  entries = { ...entries, [cell]: { about, loaded } }
}
