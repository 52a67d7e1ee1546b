// A studio of its own for a test, with a browser that looks at it.

import assert from 'node:assert/strict';
import { spawn } from 'node:child_process';
import { cpSync, mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { chromium } from 'playwright-core';

export const root = resolve(import.meta.dirname, '../../../..');
export const bin = name => join(root, 'target/release', name);
export const axe = readFileSync(createRequire(import.meta.url).resolve('axe-core/axe.min.js'), 'utf8');

/** Opens a scenario of the repository, in a folder of its own, and the page. */
export async function open(scenario, { width = 1280, height = 800, theme = 'light' } = {}) {
  const folder = mkdtempSync(join(tmpdir(), 'appell-studio-'));
  for (const part of ['scenarios', 'robots']) cpSync(join(root, part), join(folder, part), { recursive: true });
  const file = scenario.includes('/') ? scenario : join(folder, 'scenarios', scenario);
  const child = spawn(bin('appell-studio'), [file, '--no-browser'], { stdio: ['ignore', 'pipe', 'ignore'], env: { ...process.env, APPELL_PYTHON_PATH: join(root, 'sdk/python') } });
  const address = await new Promise(done => child.stdout.once('data', bytes => done(String(bytes).trim())));
  const browser = await chromium.launch({ executablePath: '/usr/bin/chromium', args: ['--no-sandbox'] });
  const page = await browser.newPage({ viewport: { width, height }, colorScheme: theme });
  page.setDefaultTimeout(10000);
  const state = async () => (await fetch(address + 'api/state')).json();
  return {
    folder, file, child, address, browser, page, state,
    command: async command => (await fetch(address + 'api/command', { method: 'POST', body: JSON.stringify(command) })).json(),
    until: async (what, holds) => {
      for (let k = 0; k < 100; k++) {
        const s = await state();
        if (holds(s)) return s;
        await new Promise(done => setTimeout(done, 100));
      }
      assert.fail(`${what}: ${JSON.stringify(await state()).slice(0, 600)}`);
    },
    close: async () => {
      await browser.close();
      child.kill();
      rmSync(folder, { recursive: true, force: true });
    },
  };
}

/** What a page complains of from now on. */
export function complaintsOf(page) {
  const complaints = [];
  page.on('console', message => { if (['error', 'warning'].includes(message.type())) complaints.push(`${message.text()} ${message.location().url}`); });
  page.on('pageerror', error => complaints.push(String(error)));
  return complaints;
}
