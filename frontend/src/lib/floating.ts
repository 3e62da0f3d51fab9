/**
 * Place an element of the top layer (`popover="manual"`) at another: below it, or above where there is more room.
 * It follows while the page scrolls; the result stops that.
 */
export function placeAt(floating: HTMLElement, anchor: HTMLElement, { gap = 4, above = false, wide = false } = {}): () => void {
  const MARGIN = 8
  const place = () => {
    const at = anchor.getBoundingClientRect()
    if (wide) floating.style.minWidth = `${at.width}px`
    const room = { above: at.top - gap - MARGIN, below: innerHeight - at.bottom - gap - MARGIN }
    floating.style.maxHeight = ''
    const height = floating.offsetHeight
    const over = above ? height <= room.above || room.above > room.below : height > room.below && room.above > room.below
    const space = over ? room.above : room.below
    floating.style.maxHeight = `min(${Math.max(48, space)}px, ${getComputedStyle(floating).maxHeight})`
    const shown = floating.offsetHeight
    const left = Math.max(MARGIN, Math.min(at.left, innerWidth - floating.offsetWidth - MARGIN))
    floating.style.left = `${left}px`
    floating.style.top = `${over ? at.top - gap - shown : at.bottom + gap}px`
  }
  place()
  addEventListener('scroll', place, { capture: true, passive: true })
  addEventListener('resize', place)
  return () => {
    removeEventListener('scroll', place, { capture: true })
    removeEventListener('resize', place)
  }
}
