// The page in a real browser: everything that people do first, on a server of its own.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { axe, bin, complaintsOf, open, root } from './server.mjs';

let studio, folder, address, page, complaints;
const state = () => studio.state();
const until = (what, holds) => studio.until(what, holds);
const active = s => s.lines.find(line => line.id === s.active);

before(async () => {
  studio = await open('slalom.toml');
  ({ folder, address, page } = studio);
  complaints = complaintsOf(page);
});
after(() => studio?.close());

test('the page opens within a second or so, and tells what runs', async () => {
  const begun = performance.now();
  await page.goto(address);
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  console.log(`first picture after ${Math.round(performance.now() - begun)} ms`);
  assert.equal(await page.locator('svg .beacon').count(), 5);
  assert.equal(await page.getByLabel('controller', { exact: true }).inputValue(), 'controller');
});

test('play, pause, step, scrub', async () => {
  await page.keyboard.press('Space');
  await until('runs', s => active(s).end > 0.5);
  await page.getByRole('button', { name: 'Pause' }).click();
  const paused = await until('holds', s => !s.playing);
  await page.waitForTimeout(200);
  assert.equal(active(await state()).end, active(paused).end);
  await page.keyboard.press('ArrowRight');
  const stepped = await until('steps', s => active(s).end > active(paused).end);
  assert.ok(Math.abs(active(stepped).end - active(paused).end - 0.01) < 1e-9);
  await page.keyboard.press('Home');
  await page.waitForFunction(() => document.querySelector('[data-time]').textContent === '0.00');
  await page.keyboard.press('End');
  const last = active(stepped).end.toFixed(2);
  await page.waitForFunction(text => document.querySelector('[data-time]').textContent === text, last);
});

test('a slider changes a number while it drives, and undo takes it back', async () => {
  const slider = page.getByRole('slider', { name: 'controller.lookahead' });
  await slider.focus();
  for (let k = 0; k < 10; k++) await page.keyboard.press('ArrowRight');
  const changed = await until('changes', s => s.changes.length > 0);
  assert.equal(changed.changes[0][1], 'robot.tri.controller.lookahead');
  while ((await state()).undo) {
    await page.keyboard.press('Control+z');
    await page.waitForTimeout(100);
  }
  const back = await until('is undone', s => s.changes.length === 0);
  assert.ok(active(back).end > 0.5, 'it is where it was');
});

test('a change in the past makes a branch', async () => {
  const before = await state();
  await page.keyboard.press('Shift+ArrowLeft');
  await page.keyboard.press('b');
  const branched = await until('branches', s => s.lines.length === before.lines.length + 1);
  assert.equal(active(branched).parent[0], 'A');
});

test('a law takes over while it drives, and a beacon is dragged', async () => {
  await page.getByLabel('controller', { exact: true }).selectOption('stanley');
  await until('swaps', s => s.robots[0].controllers.some(c => c.name === 'stanley'));
  // At once, though time does not run.
  await until('drives', s => s.robots[0].driving === 'stanley');
  assert.equal(await page.getByLabel('controller', { exact: true }).inputValue(), 'stanley');
  // The line was driven anew: its picture is drawn first.
  await page.waitForTimeout(500);
  const box = await page.locator('svg .beacon').nth(4).boundingBox();
  await page.mouse.move(box.x + box.width / 2, box.y + box.height / 2);
  await page.mouse.down();
  await page.mouse.move(box.x + 10, box.y - 30, { steps: 6 });
  await page.mouse.up();
  const moved = await until('moves', s => s.beacons[4].position[1] > 2.1);
  assert.equal(moved.beacons.length, 5);
});

test('hands drive by keys', async () => {
  await page.getByLabel('controller', { exact: true }).selectOption('hand');
  await until('stands by', s => s.robots[0].controllers.some(c => c.name === 'hand'));
  await page.locator('body').click({ position: { x: 700, y: 20 } });
  await page.keyboard.press('Space');
  await until('drives', s => s.robots[0].driving === 'hand');
  await page.keyboard.down('w');
  await page.waitForTimeout(700);
  await page.keyboard.down('a');
  await page.waitForTimeout(500);
  await page.keyboard.up('a');
  await page.keyboard.up('w');
  const driven = await until('is told', s => s.changes.filter(c => c[1].includes('hand')).length >= 4);
  assert.ok(driven.changes.some(c => c[1].endsWith('forward.signal.value') && c[2] > 0));
  await page.keyboard.press('Space');
  await until('holds', s => !s.playing);
});

test('a gamepad drives, and lets go', async () => {
  await page.evaluate(() => { window.stick = [-0.5, -1]; navigator.getGamepads = () => [{ axes: window.stick, buttons: [] }]; });
  await page.keyboard.press('Space');
  const last = (s, channel) => s.changes.filter(c => c[1].includes(`${channel}.signal.value`)).at(-1)?.[2];
  const driven = await until('is told', s => last(s, 'forward') === 0.5 && last(s, 'yaw_rate') > 0);
  assert.ok(Math.abs(last(driven, 'yaw_rate') - 0.6) < 1e-9);
  await page.evaluate(() => { window.stick = [0.04, 0.02]; });
  await until('lets go', s => last(s, 'forward') === 0 && last(s, 'yaw_rate') === 0);
  await page.keyboard.press('Space');
  await until('holds', s => !s.playing);
  await page.evaluate(() => { navigator.getGamepads = () => []; });
});

test('what was saved repeats from the command line, bit for bit', async () => {
  const line = (await state()).active;
  await page.keyboard.press('Control+s');
  await page.getByRole('textbox', { name: 'Name' }).fill('mine');
  await page.getByRole('button', { name: 'Save', exact: true }).click();
  await until('saves', s => s.saved === 'mine');
  const rows = async () => {
    const end = active(await state()).end;
    const asked = `api/series?line=${line}&from=0&to=${end}&points=8192&signals=robot.tri.pose.x,robot.tri.pose.yaw,robot.tri.wheel.left.voltage`;
    return (await (await fetch(address + asked)).text()).trim().split('\n').slice(1);
  };
  const here = await rows();
  // 1: the task is not passed by hand.
  const ran = spawnSync(bin('appell'), ['run', join(folder, 'scenarios/mine.toml'), '--csv', '--no-report', '--out', join(folder, 'out')], { encoding: 'utf8' });
  assert.ok(ran.status === 0 || ran.status === 1, ran.stderr);
  const text = readFileSync(join(folder, 'out/recording.csv'), 'utf8').trim().split('\n');
  const names = text[0].split(',').map(name => name.replace(/ .*| *\[.*/, ''));
  const columns = ['t', 'robot.tri.pose.x', 'robot.tri.pose.yaw', 'robot.tri.wheel.left.voltage'].map(name => names.findIndex(n => n === name));
  assert.ok(columns.every(k => k >= 0), text[0]);
  assert.ok(here.length > 50);
  here.forEach((row, k) => {
    const mine = row.split(',').map(Number);
    const theirs = columns.map(c => Number(text[k + 1].split(',')[c]));
    assert.equal(mine[0], theirs[0]);
    for (let i = 1; i < 4; i++) assert.equal(Math.fround(theirs[i]), Math.fround(mine[i]), `row ${k}`);
  });
}, { timeout: 60000 });

test('a page that reloads, and a second one, see the same run', async () => {
  const before = active(await state()).end;
  await page.reload();
  const second = await studio.browser.newPage();
  await second.goto(address);
  for (const one of [page, second]) {
    await one.locator('[data-time]').waitFor();
    assert.equal(await one.locator('[data-time]').textContent(), before.toFixed(2));
  }
  await second.close();
});

for (const theme of ['light', 'dark']) test(`axe finds nothing serious in ${theme}`, async () => {
  if (await page.evaluate(() => document.documentElement.dataset.theme) !== theme) await page.keyboard.press('t');
  await page.waitForTimeout(200);
  await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run());
  const serious = found.violations.filter(v => ['serious', 'critical'].includes(v.impact)).map(v => `${v.id}: ${v.nodes.map(n => n.target.join(' ') + ' ' + (n.any[0]?.message ?? '')).slice(0, 4).join(' | ')}`);
  assert.deepEqual(serious, []);
});

test('the console is silent', () => assert.deepEqual(complaints, []));
