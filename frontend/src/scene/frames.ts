/** How long frames take: JavaScript, and the graphics by a fence, which blocks nothing. */

export class FrameClock {
  frames = 0
  scriptMs = 0
  frameMs = Number.NaN
  /** From `mark` until the graphics finished the next frame, in ms. */
  markedMs = Number.NaN
  private started = 0
  private marked: number | null = null
  private fence: WebGLSync | null = null
  private timer = 0

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /** Time the next frame from now. */
  mark(): void {
    this.marked = performance.now()
    this.markedMs = Number.NaN
  }

  begin(): void {
    this.started = performance.now()
  }

  /** End a frame's script; `done` gets the time of the whole frame when the graphics finished it. */
  end(done: (ms: number) => void): void {
    this.frames += 1
    this.scriptMs = performance.now() - this.started
    if (this.fence) return // the one before is still under way
    const { gl, started } = this
    const marked = this.marked
    this.marked = null
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0)
    gl.flush()
    const look = () => {
      if (!this.fence) return
      const status = gl.getSyncParameter(this.fence, gl.SYNC_STATUS) as number
      if (status !== gl.SIGNALED) {
        this.timer = window.setTimeout(look, 2)
        return
      }
      gl.deleteSync(this.fence)
      this.fence = null
      const now = performance.now()
      this.frameMs = now - started
      if (marked !== null) this.markedMs = now - marked
      done(this.frameMs)
    }
    this.timer = window.setTimeout(look, 0)
  }

  /** Forget a fence of a context that was lost. */
  forget(): void {
    clearTimeout(this.timer)
    this.fence = null
  }

  dispose(): void {
    this.forget()
  }
}
