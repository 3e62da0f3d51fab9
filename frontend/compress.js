import { readdirSync, readFileSync, writeFileSync } from 'node:fs'
import { extname, join, relative } from 'node:path'
import { brotliCompressSync, constants, gzipSync } from 'node:zlib'

const COMPRESSED = new Set(['.css', '.html', '.js', '.json', '.svg'])

/**
 * Write a .br and a .gz file beside each text file of the build, print their sizes,
 * and fail when all of them together (brotli) are larger than `limit` bytes.
 */
export function compress({ limit }) {
  let folder
  return {
    name: 'compress',
    apply: 'build',
    configResolved(config) {
      folder = join(config.root, config.build.outDir)
    },
    closeBundle() {
      const rows = readdirSync(folder, { recursive: true, withFileTypes: true })
        .filter((entry) => entry.isFile() && COMPRESSED.has(extname(entry.name)))
        .map((entry) => compressFile(join(entry.parentPath, entry.name), folder))
        .sort((a, b) => b.brotli - a.brotli)
      const total = rows.reduce((sum, row) => ({ gzip: sum.gzip + row.gzip, brotli: sum.brotli + row.brotli }), {
        gzip: 0,
        brotli: 0,
      })
      for (const row of [...rows, { name: 'total', ...total }]) {
        console.log(`${row.name.padEnd(44)} gzip ${kilobytes(row.gzip)}  brotli ${kilobytes(row.brotli)}`)
      }
      if (total.brotli > limit) throw new Error(`the build has ${total.brotli} bytes compressed; the limit is ${limit}`)
    },
  }
}

function compressFile(path, folder) {
  const content = readFileSync(path)
  const gzip = gzipSync(content, { level: 9 })
  const brotli = brotliCompressSync(content, { params: { [constants.BROTLI_PARAM_QUALITY]: 11 } })
  writeFileSync(`${path}.gz`, gzip)
  writeFileSync(`${path}.br`, brotli)
  return { name: relative(folder, path), gzip: gzip.length, brotli: brotli.length }
}

function kilobytes(bytes) {
  return `${(bytes / 1000).toFixed(1).padStart(6)} kB`
}
