import { svelte } from '@sveltejs/vite-plugin-svelte'
import { defineConfig } from 'vite'
import { compress } from './compress.js'
import { usedShaders } from './shaders.js'

const server = process.env.TRUEPOSE_SERVER ?? 'http://127.0.0.1:8765'

export default defineConfig({
  base: './',
  plugins: [svelte(), usedShaders(), compress({ limit: 300_000 })],
  build: {
    outDir: '../src/truepose/web/static',
    emptyOutDir: true,
    target: 'es2023',
    assetsInlineLimit: 0, // no data: URLs, which the Content-Security-Policy refuses
    modulePreload: { polyfill: false }, // nothing inline
    license: { fileName: 'assets/licenses.md' }, // of the packages whose code is in the files
    cssCodeSplit: false, // one style sheet
    reportCompressedSize: false, // compress.js prints the sizes
    chunkSizeWarningLimit: 1000,
  },
  server: { proxy: { '/api': server } },
})
