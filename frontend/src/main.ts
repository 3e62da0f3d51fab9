import { mount } from 'svelte'
import App from './App.svelte'
import { startLanguage } from './lib/i18n/index.svelte'
import './lib/theme.svelte'
import './styles.css'

await startLanguage()
mount(App, { target: document.getElementById('app') as HTMLElement })
