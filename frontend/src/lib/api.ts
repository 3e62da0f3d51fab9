/**
 * Typed client of the server. The types come from its OpenAPI document, so a wrong path, parameter or body does not compile:
 *
 *   const cells = await get('/api/v1/cells')
 *   const job = await post('/api/v1/maps', { body: { cell, samples } })
 *   const arrows = await bytes('/api/v1/maps/{sha}/arrows.bin', { path: { sha }, query: { n: 5000 } })
 *
 * An answer that is not 2xx throws an `ApiError`, which holds the problem document (RFC 9457).
 */
import type { components, paths } from './contract'

export type Schemas = components['schemas']

/** The problem document of the server: what is wrong, where, and what to do. */
export interface Problem {
  type?: string
  title: string
  status: number
  detail?: string
  file?: string | null
  line?: number | null
  row?: number | null
  target?: string | null
  remedy?: string | null
  [extension: string]: unknown
}

export class ApiError extends Error {
  readonly problem: Problem

  constructor(problem: Problem) {
    super(problem.detail || problem.title)
    this.name = 'ApiError'
    this.problem = problem
  }

  get status(): number {
    return this.problem.status
  }
}

type Verb = 'get' | 'post' | 'put' | 'patch' | 'delete'
type Operation<P extends keyof paths, V extends Verb> = NonNullable<paths[P][V]>
export type PathWith<V extends Verb> = {
  [P in keyof paths]: [Operation<P, V>] extends [never] ? never : P
}[keyof paths]

type Parameters<Op, Where extends 'path' | 'query'> = Op extends { parameters: infer All }
  ? Where extends keyof All
    ? NonNullable<All[Where]>
    : never
  : never
type Content<Body> = Body extends { content: infer Types } ? Types[keyof Types] : undefined
type Body<Op> = Op extends { requestBody?: infer B } ? Content<NonNullable<B>> : undefined
type Answers<Op> = Op extends { responses: infer R } ? R : never
type Success<R> = { [S in keyof R]: S extends 200 | 201 | 202 ? Content<R[S]> : never }[keyof R]
export type AnswerOf<P extends keyof paths, V extends Verb> = Success<Answers<Operation<P, V>>>

type Part<Name extends string, T> = [T] extends [never] ? object : Record<never, never> extends T ? { [K in Name]?: T } : { [K in Name]: T }
export type Options<P extends keyof paths, V extends Verb> = Part<'path', Parameters<Operation<P, V>, 'path'>> &
  Part<'query', Parameters<Operation<P, V>, 'query'>> & {
    /** JSON, or a FormData for a multipart body. */
    body?: Body<Operation<P, V>> | FormData
    /** The version of a resource for `If-Match`: a change by somebody else is answered with 412. */
    etag?: string
    signal?: AbortSignal
  }
type Rest<O> = Record<never, never> extends O ? [options?: O] : [options: O]

export interface Answer<T> {
  data: T
  status: number
  etag: string | null
}

interface AnyOptions {
  path?: Record<string, unknown>
  query?: Record<string, unknown>
  body?: unknown
  etag?: string
  signal?: AbortSignal
}

let asked: Promise<Schemas['Session']> | undefined

/** The session of this page (asked for once). */
export function session(): Promise<Schemas['Session']> {
  asked ??= send('GET', '/api/v1/session', {})
    .then((response) => response.json() as Promise<Schemas['Session']>)
    .catch((error: unknown) => {
      asked = undefined
      throw error
    })
  return asked
}

/** Whether this browser has a session, and whether users log in; nothing else is asked for before. */
export async function entry(): Promise<Schemas['Version']> {
  return (await send('GET', '/version', {})).json() as Promise<Schemas['Version']>
}

/** The value of the header that shows that a request comes from this page. */
export async function csrf(): Promise<string> {
  return (await session()).csrf
}

/** Log in; afterwards the page is loaded again. */
export async function logIn(name: string, password: string): Promise<void> {
  const headers = { 'Content-Type': 'application/json', 'X-Truepose-CSRF': 'log-in' }
  await send('POST', '/api/v1/login', { headers, body: JSON.stringify({ name, password }) })
}

/** The host of the OpenID Connect provider by which users may log in; null without one. */
export async function loginProvider(): Promise<string | null> {
  const answer = await send('GET', '/api/v1/login', { headers: { 'X-Truepose-CSRF': 'log-in' } })
  return ((await answer.json()) as Schemas['LogIns']).provider
}

/** Go to the page of the provider, which comes back to this one. */
export async function logInByProvider(): Promise<void> {
  const answer = await send('POST', '/api/v1/login/oidc', { headers: { 'X-Truepose-CSRF': 'log-in' } })
  location.assign(((await answer.json()) as Schemas['Destination']).url)
}

/** Call an operation and return its data, status and ETag. */
export async function call<V extends Verb, P extends PathWith<V>>(
  verb: V,
  path: P,
  ...rest: Rest<Options<P, V>>
): Promise<Answer<AnswerOf<P, V>>> {
  const response = await request(verb, path, rest[0])
  const text = await response.text()
  const data = (text ? JSON.parse(text) : undefined) as AnswerOf<P, V>
  return { data, status: response.status, etag: response.headers.get('etag') }
}

export async function get<P extends PathWith<'get'>>(path: P, ...rest: Rest<Options<P, 'get'>>) {
  return (await call('get', path, ...rest)).data
}

export async function post<P extends PathWith<'post'>>(path: P, ...rest: Rest<Options<P, 'post'>>) {
  return (await call('post', path, ...rest)).data
}

export async function put<P extends PathWith<'put'>>(path: P, ...rest: Rest<Options<P, 'put'>>) {
  return (await call('put', path, ...rest)).data
}

export async function patch<P extends PathWith<'patch'>>(path: P, ...rest: Rest<Options<P, 'patch'>>) {
  return (await call('patch', path, ...rest)).data
}

export async function del<P extends PathWith<'delete'>>(path: P, ...rest: Rest<Options<P, 'delete'>>) {
  return (await call('delete', path, ...rest)).data
}

/** Get a binary answer (arrows.bin, slices.bin). */
export async function bytes<P extends PathWith<'get'>>(path: P, ...rest: Rest<Options<P, 'get'>>): Promise<ArrayBuffer> {
  return (await request('get', path, rest[0])).arrayBuffer()
}

/** The address of an operation, for links of downloads and `src` of frames. */
export function address<P extends PathWith<'get'>>(path: P, ...rest: Rest<Options<P, 'get'>>): string {
  return fill(path, rest[0] as AnyOptions | undefined)
}

/**
 * Send a multipart body with progress (0 to 1), which `fetch` cannot report.
 * Files keep their relative path as file name: the server uses it as a label only.
 */
export async function upload<P extends PathWith<'post'>>(
  path: P,
  options: Options<P, 'post'> & { body: FormData; onProgress?: (share: number) => void },
): Promise<AnswerOf<P, 'post'>> {
  const secret = await csrf()
  return new Promise((resolve, reject) => {
    const http = new XMLHttpRequest()
    http.open('POST', fill(path, options as AnyOptions))
    http.setRequestHeader('X-Truepose-CSRF', secret)
    http.upload.onprogress = (event) => {
      if (event.lengthComputable) options.onProgress?.(event.loaded / event.total)
    }
    http.onload = () => {
      if (http.status >= 200 && http.status < 300) resolve(JSON.parse(http.responseText) as AnswerOf<P, 'post'>)
      else reject(new ApiError(parseProblem(http.status, http.responseText)))
    }
    http.onerror = () => reject(unreachable())
    http.onabort = () => reject(new DOMException('aborted', 'AbortError'))
    options.signal?.addEventListener('abort', () => http.abort())
    http.send(options.body)
  })
}

async function request(verb: Verb, path: string, options: unknown): Promise<Response> {
  const given = (options ?? {}) as AnyOptions
  const headers: Record<string, string> = {}
  if (verb !== 'get') headers['X-Truepose-CSRF'] = await csrf()
  if (given.etag) headers['If-Match'] = given.etag
  let body: BodyInit | undefined
  if (given.body instanceof FormData) body = given.body
  else if (given.body !== undefined) {
    headers['Content-Type'] = 'application/json'
    body = JSON.stringify(given.body)
  }
  return send(verb.toUpperCase(), fill(path, given), { headers, body, signal: given.signal })
}

async function send(method: string, url: string, init: RequestInit): Promise<Response> {
  let response: Response
  try {
    response = await fetch(url, { ...init, method, credentials: 'same-origin' })
  } catch (error) {
    if (error instanceof DOMException && error.name === 'AbortError') throw error
    throw unreachable()
  }
  if (!response.ok) throw new ApiError(parseProblem(response.status, await response.text()))
  return response
}

function fill(path: string, options: AnyOptions | undefined): string {
  const filled = path.replace(/\{(\w+)\}/g, (_, name: string) => encodeURIComponent(String(options?.path?.[name])))
  const query = new URLSearchParams()
  for (const [name, value] of Object.entries(options?.query ?? {})) {
    for (const item of Array.isArray(value) ? (value as unknown[]) : [value]) {
      if (item !== undefined && item !== null) query.append(name, String(item))
    }
  }
  const text = query.toString()
  return text ? `${filled}?${text}` : filled
}

function parseProblem(status: number, text: string): Problem {
  try {
    const problem = JSON.parse(text) as Partial<Problem>
    return { ...problem, status, title: problem.title ?? `HTTP ${status}` }
  } catch {
    return { status, title: `HTTP ${status}`, detail: text.slice(0, 500) }
  }
}

/** Status 0: no answer at all, since the server stopped or the machine sleeps. */
function unreachable(): ApiError {
  return new ApiError({ type: 'unreachable', status: 0, title: 'The server does not answer' })
}
