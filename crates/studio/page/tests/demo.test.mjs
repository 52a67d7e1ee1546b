// The demo, from a server that knows nothing but files: the slalom is driven in the page to its end, and every
// number of its recording is that of the program's run.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { tmpdir } from 'node:os';
import { extname, join, normalize } from 'node:path';
import { after, before, test } from 'node:test';

import { chromium } from 'playwright-core';
import { axe, bin, complaintsOf, root } from './server.mjs';

const demo = join(root, 'target/studio-demo');
const KINDS = { '.html': 'text/html', '.js': 'text/javascript', '.css': 'text/css', '.json': 'application/json', '.wasm': 'application/wasm' };
let server, browser, page, complaints, address, folder;

before(async () => {
  assert.ok(existsSync(join(demo, 'appell.wasm')), 'cargo xtask demo builds it');
  server = createServer((request, response) => {
    const path = normalize(new URL(request.url, 'http://files').pathname.replace(/^\/some\/place\//, '/'));
    const file = join(demo, path.endsWith('/') ? `${path}index.html` : path);
    if (!existsSync(file)) { response.writeHead(404).end(); return; }
    response.writeHead(200, { 'content-type': KINDS[extname(file)] ?? 'application/octet-stream' }).end(readFileSync(file));
  });
  await new Promise(done => server.listen(0, '127.0.0.1', done));
  // Not at the root of the server.
  address = `http://127.0.0.1:${server.address().port}/some/place/`;
  folder = mkdtempSync(join(tmpdir(), 'appell-demo-'));
  browser = await chromium.launch({ executablePath: '/usr/bin/chromium', args: ['--no-sandbox'] });
  page = await browser.newPage({ viewport: { width: 1280, height: 800 } });
  page.setDefaultTimeout(20000);
  complaints = complaintsOf(page);
});
after(async () => {
  await browser?.close();
  server?.close();
  rmSync(folder, { recursive: true, force: true });
});

/** What a download holds. */
const taken = async act => {
  const [download] = await Promise.all([page.waitForEvent('download'), act()]);
  return { name: download.suggestedFilename(), text: readFileSync(await download.path()) };
};
/** The recording of the program's run of a scenario, as CSV, to the last digit of each number. */
const native = (scenario, name) => {
  const out = join(folder, name);
  const ran = spawnSync(bin('appell'), ['run', scenario, '--csv', '--no-report', '--out', out], { encoding: 'utf8' });
  assert.equal(ran.status, 0, ran.stderr);
  return readFileSync(join(out, 'recording.csv'), 'utf8');
};
const rows = () => page.evaluate(async () => (await window.appell.find('api/lines/1/recording.csv')).text());

test('the slalom is driven in the page, and passed', async () => {
  const begun = performance.now();
  await page.goto(address);
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  console.log(`first picture after ${Math.round(performance.now() - begun)} ms`);
  assert.equal(await page.locator('svg .beacon').count(), 5);
  await page.getByLabel('speed', { exact: true }).selectOption('0');
  const driven = performance.now();
  await page.keyboard.press('Space');
  await page.getByRole('status').getByText(/✓ A passed/).waitFor({ timeout: 120000 });
  console.log(`driven in ${Math.round(performance.now() - driven)} ms`);
}, { timeout: 180000 });

test('its recording has the bits of the program\'s run, row for row', async () => {
  const here = await rows();
  const there = native(join(root, 'scenarios/slalom.toml'), 'slalom');
  assert.ok(there.split('\n').length > 500);
  // Shortest decimals that read back as the same bits: texts are equal where bits are.
  assert.deepEqual(here.split('\n').at(-2), there.split('\n').at(-2), 'the final state');
  assert.ok(here === there, 'all rows');
}, { timeout: 120000 });

test('a recording and a scenario are handed over, and repeat what was done', async () => {
  await page.keyboard.press('Home');
  for (let k = 0; k < 3; k++) await page.keyboard.press('Shift+ArrowRight');
  await page.locator('.slider input[aria-label="controller.lookahead"]').focus();
  for (let k = 0; k < 8; k++) await page.keyboard.press('ArrowRight');
  await page.locator('.names button[aria-pressed=true]', { hasText: 'B' }).waitFor();
  await page.locator('body').click({ position: { x: 700, y: 20 } });
  await page.keyboard.press('Space');
  await page.getByRole('status').getByText(/B passed/).waitFor({ timeout: 120000 });
  await page.keyboard.press('Control+s');
  await page.getByRole('textbox', { name: 'Name' }).fill('mine');
  const saved = await taken(() => page.getByRole('button', { name: 'Save', exact: true }).click());
  assert.equal(saved.name, 'mine.toml');
  writeFileSync(join(folder, saved.name), saved.text);
  const line = await page.evaluate(() => window.appell.state.active);
  const here = await page.evaluate(async line => (await window.appell.find(`api/lines/${line}/recording.csv`)).text(), line);
  assert.ok(here === native(join(folder, saved.name), 'mine'), 'all rows');
  const recording = await taken(() => page.evaluate(() => document.querySelector('header a.button').click()));
  assert.match(recording.name, /\.mcap$/);
  // The program reads it.
  writeFileSync(join(folder, 'page.mcap'), recording.text);
  const drawn = spawnSync(bin('appell'), ['plot', join(folder, 'page.mcap')], { encoding: 'utf8' });
  assert.equal(drawn.status, 0, drawn.stderr);
  assert.match(drawn.stdout, /pose\.yaw/);
}, { timeout: 240000 });

test('every scenario of the demo opens, and what it cannot do is not offered', async () => {
  const names = await page.evaluate(() => window.appell.state.scenarios.filter(name => name !== 'mine'));
  assert.ok(names.length > 25, String(names));
  for (const name of names) await page.evaluate(name => window.appell.do({ do: 'open', name }), name);
  await page.getByRole('tab', { name: 'Plug-ins' }).click();
  await page.getByText('need the program').waitFor();
  await page.getByRole('button', { name: 'Open a panel' }).first().click();
  assert.equal(await page.getByRole('button', { name: /^Batch/ }).count(), 0);
  await page.keyboard.press('Escape');
  await page.getByRole('tab', { name: 'From the side' }).click();
  await page.getByRole('button', { name: 'Wheel-legged robot' }).click();
  await page.getByText('step of 0.2 m: climb').waitFor();
}, { timeout: 300000 });

test('axe finds nothing serious, and the console is silent', async () => {
  await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run());
  assert.deepEqual(found.violations.filter(v => ['serious', 'critical'].includes(v.impact)).map(v => v.id), []);
  assert.deepEqual(complaints, []);
});
