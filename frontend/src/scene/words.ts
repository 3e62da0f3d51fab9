/** The texts of a scene in the language of the page: `mountScene(element, { words: sceneWords(t('cell.picture')) })`. */
import { number, significant } from '../lib/format'
import { t } from '../lib/i18n/index.svelte'
import type { SceneWords } from './types'

/** The texts; `label` says what the picture shows. Call it in an effect that follows the language. */
export function sceneWords(label: string): SceneWords {
  return {
    label,
    keys: t('map.scene_keys'),
    noWebGl: t('map.scene_no_webgl'),
    contextLost: t('map.scene_lost'),
    error: t('map.scene_error'),
    grid: (step) => t('map.scene_grid', { step: number(step) }),
    shown: (shown, total) => t('map.scene_shown', { shown: number(shown), total: number(total) }),
    magnified: (factor) => t('map.scene_magnified', { factor: significant(factor, 3) }),
    orMore: (value) => t('map.scene_or_more', { value: significant(value, 3) }),
    number: (value) => significant(value, 3),
  }
}
