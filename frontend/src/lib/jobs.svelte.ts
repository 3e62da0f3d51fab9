/**
 * Long work: an endpoint answers 202 with a job, which runs in a process of its own.
 *
 *   const job = await runJob(post('/api/v1/maps', { body }), { onProgress: (job) => (shown = job) })
 *   job.result    // what the command printed as JSON
 *
 * A job that fails throws the `ApiError` of its problem; a cancelled one throws `JobStopped`.
 */
import { commandLine } from './command'
import { address, ApiError, del, get, post, type Problem, type Schemas } from './api'

export type Job = Schemas['Job']

/** Browsers open six connections to a server; progress may hold some of them, the rest is asked for. */
const MOST_STREAMS = 2
const ACTIVE = new Set(['queued', 'running'])
const list = $state<{ jobs: Job[] }>({ jobs: [] })
const followed = new Set<string>()
let streams = 0

/** All jobs of the workspace, newest first (reactive). */
export const jobs = {
  get list(): Job[] {
    return list.jobs
  },
  get active(): Job[] {
    return list.jobs.filter(isActive)
  },
}

export class JobStopped extends Error {
  readonly job: Job

  constructor(job: Job) {
    super(job.title)
    this.name = 'JobStopped'
    this.job = job
  }
}

export function isActive(job: Job): boolean {
  return ACTIVE.has(job.state)
}

/** Progress from 0 to 1; null while the total is unknown. */
export function share(job: Job): number | null {
  return job.total ? Math.min(1, (job.done ?? 0) / job.total) : null
}

/** Read the list of jobs again. */
export async function loadJobs(): Promise<void> {
  list.jobs = await get('/api/v1/jobs')
}

/** Follow a job that was just started until it ends. Cancelled through `signal`, the job is stopped too. */
export async function runJob(
  started: Promise<Job>,
  { onProgress, signal }: { onProgress?: (job: Job) => void; signal?: AbortSignal } = {},
): Promise<Job> {
  const job = await started
  const stop = () => void cancelJob(job)
  signal?.addEventListener('abort', stop)
  try {
    const ended = await follow(job, onProgress)
    if (ended.state === 'done') return ended
    if (ended.problem) throw new ApiError(ended.problem as unknown as Problem)
    throw new JobStopped(ended)
  } finally {
    signal?.removeEventListener('abort', stop)
  }
}

/** Whether a page waits for this job and tells its end itself. */
export function isFollowed(job: Job): boolean {
  return followed.has(job.id)
}

/** Report a job's states until it ends; resolves with the ended job. */
export async function follow(job: Job, onProgress?: (job: Job) => void): Promise<Job> {
  const take = (news: Job) => {
    remember(news)
    onProgress?.(news)
  }
  followed.add(job.id)
  take(job)
  if (!isActive(job)) return job
  return streams < MOST_STREAMS ? listen(job, take) : poll(job, take)
}

function listen(job: Job, take: (job: Job) => void): Promise<Job> {
  streams++
  const source = new EventSource(address('/api/v1/jobs/{job}/events', { path: { job: job.id } }))
  const ended = new Promise<Job>((resolve, reject) => {
    source.onmessage = (event: MessageEvent<string>) => {
      const news = JSON.parse(event.data) as Job
      take(news)
      if (!isActive(news)) resolve(news)
    }
    source.onerror = () => {
      // the browser connects again on its own, unless the server refused or stopped
      if (source.readyState === EventSource.CLOSED) poll(job, take).then(resolve, reject)
    }
  })
  return ended.finally(() => {
    source.close()
    streams--
  })
}

async function poll(job: Job, take: (job: Job) => void): Promise<Job> {
  for (;;) {
    const news = await get('/api/v1/jobs/{job}', { path: { job: job.id } })
    take(news)
    if (!isActive(news)) return news
    await new Promise((resolve) => setTimeout(resolve, 1000))
  }
}

export async function cancelJob(job: Job): Promise<void> {
  remember(await del('/api/v1/jobs/{job}', { path: { job: job.id } }))
}

/** Run a finished, failed, cancelled or interrupted job again, as a new job. */
export async function runAgain(job: Job): Promise<Job> {
  const fresh = await post('/api/v1/jobs/{job}/run', { path: { job: job.id } })
  return fresh
}

/** The command line of a job, as it could be typed in its folder. */
export function commandOf(job: Job): string {
  return commandLine(job.command)
}

function remember(job: Job): void {
  const index = list.jobs.findIndex((other) => other.id === job.id)
  if (index >= 0) list.jobs[index] = job
  else list.jobs.unshift(job)
}
