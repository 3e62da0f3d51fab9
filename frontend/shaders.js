const MATERIALS = ['meshlambert', 'meshbasic'] // those of src/scene that are not ShaderMaterials; lines have the second
const OF_RENDERER = ['colorspace_pars_fragment', 'tonemapping_pars_fragment'] // every program begins with them

/** Leave the shaders of other materials out of three.js: it holds all of them as text, which no build tool removes. */
export function usedShaders() {
  return {
    name: 'used-shaders',
    apply: 'build',
    transform(code, id) {
      return id.includes('three.module') ? { code: withoutUnused(code), map: null } : null
    },
  }
}

function withoutUnused(code) {
  const start = code.indexOf('const ShaderChunk = {')
  const table = code.slice(start, code.indexOf('};', start))
  const variables = new Map([...table.matchAll(/(\w+): ([\w$]+)/g)].map(([, chunk, variable]) => [chunk, variable]))
  const texts = new Map([...code.matchAll(/^(?:var|const) ([\w$]+) = ("(?:[^"\\]|\\.)*");$/gm)].map(([, name, text]) => [name, text]))
  const used = new Set()
  const use = (chunk) => {
    const text = texts.get(variables.get(chunk))
    if (text === undefined) throw new Error(`three.js has no shader ${chunk} any more; mend shaders.js`)
    if (used.has(chunk)) return
    used.add(chunk)
    for (const [, included] of JSON.parse(text).matchAll(/#include +<([\w\d./]+)>/g)) use(included)
  }
  for (const chunk of [...MATERIALS.flatMap((one) => [`${one}_vert`, `${one}_frag`]), ...OF_RENDERER]) use(chunk)
  let shorter = code
  for (const [chunk, variable] of variables) {
    if (!used.has(chunk)) shorter = shorter.replace(`${variable} = ${texts.get(variable)};`, `${variable} = "";`)
  }
  return shorter
}
