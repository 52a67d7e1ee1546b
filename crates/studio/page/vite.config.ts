import { defineConfig } from 'vite';

export default defineConfig({
  // Relative: the page lies below a token.
  base: './',
  build: { target: 'es2022', assetsInlineLimit: 0, modulePreload: { polyfill: false } },
  oxc: { jsx: { runtime: 'automatic', importSource: 'preact' } },
});
