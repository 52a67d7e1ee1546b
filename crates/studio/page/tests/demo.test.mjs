// The demo, from a server that knows nothing but files: the slalom is driven in the page to its end, and every
// number of its recording is that of the program's run.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { createHash } from 'node:crypto';
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
const native = (scenario, name, status = 0, more = []) => {
  const out = join(folder, name);
  const ran = spawnSync(bin('appell'), ['run', scenario, '--csv', '--no-report', '--out', out, ...more], { encoding: 'utf8' });
  if (status !== null) assert.equal(ran.status, status, ran.stderr);
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

const plugin = name => page.locator('[data-panel=plugins] li', { hasText: name });
const state = () => page.evaluate(() => window.appell.state);

test('a module takes over while it drives, is taken anew, and has the bits of the program', async () => {
  await page.evaluate(() => window.appell.do({ do: 'open', name: 'slalom' }));
  await page.getByRole('tab', { name: 'Plug-ins' }).click();
  await plugin('pursuit.wasm').getByRole('button', { name: 'Load' }).click();
  await plugin('pursuit.wasm').getByText('ready').waitFor();
  await page.getByLabel('speed', { exact: true }).selectOption('1');
  await page.keyboard.press('Escape');
  await page.evaluate(() => window.appell.do({ do: 'play' }));
  await page.waitForFunction(() => window.appell.state.playing && Number(document.querySelector('[data-time]').textContent) > 1);
  await plugin('pursuit.wasm').getByRole('button', { name: 'Take over' }).click();
  await plugin('pursuit.wasm').getByText('drives').waitFor();
  await plugin('pursuit.wasm').getByText(/a step [\d.]+ (ns|µs|ms), ≤ /).waitFor();
  // Another module under the same name: one byte of its custom sections differs.
  const module = readFileSync(join(demo, 'scenarios/pursuit.wasm'));
  const other = Buffer.concat([module, Buffer.from([0, 2, 1, 0x61])]);
  await page.locator('input[type=file]').setInputFiles({ name: 'pursuit.wasm', mimeType: 'application/wasm', buffer: other });
  const hash = createHash('sha256').update(other).digest('hex');
  await page.waitForFunction(hash => window.appell.state.plugins.named[0].hash === hash, hash);
  await plugin('pursuit.wasm').getByRole('button', { name: 'Reload' }).click();
  await plugin('pursuit-v1.wasm').getByText('drives').waitFor();
  await page.getByLabel('speed', { exact: true }).selectOption('0');
  await page.waitForFunction(() => window.appell.state.lines.find(line => line.id === window.appell.state.active).over, null, { timeout: 120000 });
  await page.keyboard.press('Control+s');
  await page.getByRole('textbox', { name: 'Name' }).fill('swapped');
  const handed = [];
  page.on('download', download => handed.push(download));
  await page.getByRole('button', { name: 'Save', exact: true }).click();
  for (let k = 0; k < 100 && handed.length < 3; k++) await page.waitForTimeout(100);
  page.removeAllListeners('download');
  assert.deepEqual(handed.map(one => one.suggestedFilename()).sort(), ['pursuit-v1.wasm', 'pursuit.wasm', 'swapped.toml']);
  for (const one of handed) writeFileSync(join(folder, one.suggestedFilename()), readFileSync(await one.path()));
  assert.ok(readFileSync(join(folder, 'pursuit-v1.wasm')).equals(other));
  const active = (await state()).active;
  const here = await page.evaluate(async line => (await window.appell.find(`api/lines/${line}/recording.csv`)).text(), active);
  assert.ok(here.split('\n').length > 300);
  assert.ok(here === native(join(folder, 'swapped.toml'), 'swapped', null), 'all rows');
}, { timeout: 240000 });

test('a module that hangs, traps or reads what is not its own is a fault of its own, at the step of the program', async () => {
  const source = join(folder, 'bad.c');
  writeFileSync(source, `
    #include "appell_plugin.h"
    static int steps;
    static const char text[] = "{\\"protocol\\": 1, \\"name\\": \\"bad\\", \\"inputs\\": [{\\"name\\": \\"pose.x\\", \\"unit\\": \\"m\\"}], \\"outputs\\": [{\\"name\\": \\"command.forward\\", \\"unit\\": \\"m/s\\"}, {\\"name\\": \\"command.yaw_rate\\", \\"unit\\": \\"rad/s\\"}]}";
    uint32_t appell_abi(void) { return APPELL_ABI; }
    const char *appell_describe(void) { return text; }
    void *appell_create(const double *p, const char *c) { (void)p; (void)c; return &steps; }
    void appell_destroy(void *m) { (void)m; }
    int32_t appell_step(void *m, double t, double dt, const double *in, double *out)
    {
      (void)m; (void)dt; (void)in;
      out[0] = 0.3; out[1] = 0;
      if (++steps < 20) return 0;
      WRONG
      return t < 0;
    }`);
  for (const [name, wrong, told] of [['hangs', 'for (volatile int k = 0; ; k++);', /used up its fuel of 100000000 instructions/], ['traps', '__builtin_trap();', /trapped/], ['reads', 'out[0] = *(volatile double *)0xfffffff0u;', /trapped/]]) {
    const text = readFileSync(source, 'utf8').replace('WRONG', wrong);
    writeFileSync(join(folder, `${name}.c`), text);
    const compiled = spawnSync('clang', ['--target=wasm32', '-mbulk-memory', '-nostdlib', '-Wl,--no-entry,--export-dynamic', '-O2', '-ffp-contract=off', '-I', join(root, 'sdk/c'), '-o', join(folder, `${name}.wasm`), join(folder, `${name}.c`)], { encoding: 'utf8' });
    assert.equal(compiled.status, 0, compiled.stderr);
    await page.evaluate(() => window.appell.do({ do: 'open', name: 'slalom' }));
    await page.locator('input[type=file]').setInputFiles(join(folder, `${name}.wasm`));
    await plugin(`${name}.wasm`).getByRole('button', { name: 'Load' }).click();
    await plugin(`${name}.wasm`).getByRole('button', { name: 'Take over' }).click();
    await page.evaluate(() => window.appell.do({ do: 'play' }));
    const failed = plugin(`${name}.wasm`).getByText(told);
    await failed.waitFor();
    const fault = (await state()).lines[0].events.find(event => event.kind === 'fault');
    await page.evaluate(() => window.appell.do({ do: 'save', name: 'wrong', replace: true }));
    const scenario = await page.evaluate(async () => (await window.appell.find('scenarios/wrong.toml')).text());
    writeFileSync(join(folder, 'wrong.toml'), scenario);
    // It is stopped for good, so only a limit of time ends the run.
    const there = native(join(folder, 'wrong.toml'), 'wrong', null, ['--set', 'time.duration=3']);
    assert.ok(there.length > 0);
    const summary = JSON.parse(readFileSync(join(folder, 'wrong/summary.json'), 'utf8'));
    assert.equal(summary.failures[0].t, fault.t, name);
    assert.match(summary.failures[0].problem, told);
  }
}, { timeout: 240000 });

test('every scenario of the demo opens, and what it cannot do is not offered', async () => {
  const names = await page.evaluate(() => window.appell.state.scenarios.filter(name => name !== 'mine'));
  assert.ok(names.length > 25, String(names));
  for (const name of names) await page.evaluate(name => window.appell.do({ do: 'open', name }), name);
  await page.getByRole('tab', { name: 'Plug-ins' }).click();
  await page.getByText('Other languages need the program').waitFor();
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
