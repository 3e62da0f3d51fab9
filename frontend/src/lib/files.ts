/** Files as the user gives them, with their path relative to what was dropped or chosen. */
export interface PathFile {
  file: File
  /** "KRC/R1/main.src" of a folder; the file's name otherwise. A label: the server never takes it as a path. */
  path: string
}

/** The multipart body of files; each has its relative path as file name. */
export function formOf(files: readonly PathFile[], fields: Record<string, string> = {}, name = 'files'): FormData {
  const form = new FormData()
  for (const [key, value] of Object.entries(fields)) form.append(key, value)
  for (const { file, path } of files) form.append(name, file, path)
  return form
}

/** The files of a file dialog. */
export function chosenFiles(input: HTMLInputElement): PathFile[] {
  return [...(input.files ?? [])].map((file) => ({ file, path: file.webkitRelativePath || file.name }))
}

/** The files of a drop; with `folders` those inside dropped folders too. */
export async function droppedFiles(transfer: DataTransfer, { folders = false } = {}): Promise<PathFile[]> {
  // entries must be taken before the first await: the browser empties the transfer then
  const entries = [...transfer.items].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null)
  if (!folders || !entries.length) return [...transfer.files].map((file) => ({ file, path: file.name }))
  return (await Promise.all(entries.map((entry) => filesOf(entry, '')))).flat()
}

async function filesOf(entry: FileSystemEntry, above: string): Promise<PathFile[]> {
  const path = above + entry.name
  if (entry.isFile) {
    const file = await new Promise<File>((resolve, reject) => (entry as FileSystemFileEntry).file(resolve, reject))
    return [{ file, path }]
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader()
  const found: PathFile[] = []
  for (;;) {
    // a call returns some of the entries; none means all were read
    const some = await new Promise<FileSystemEntry[]>((resolve, reject) => reader.readEntries(resolve, reject))
    if (!some.length) return found
    for (const inner of some) found.push(...(await filesOf(inner, `${path}/`)))
  }
}
