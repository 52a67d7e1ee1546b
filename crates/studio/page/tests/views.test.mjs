// The built-in panels in a real browser: space, side, plots of other kinds, table, plug-ins, batch, and the languages.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { axe, bin, complaintsOf, open, root } from './server.mjs';

let studio, page, complaints;
const serious = async () => {
  await page.evaluate(axe);
  const found = await page.evaluate(() => window.axe.run());
  return found.violations.filter(v => ['serious', 'critical'].includes(v.impact)).map(v => `${v.id}: ${v.nodes.map(n => n.target.join(' ') + ' ' + (n.any[0]?.message ?? '')).slice(0, 4).join(' | ')}`);
};
const tab = name => page.getByRole('tab', { name, exact: true });

before(async () => {
  studio = await open('slope.toml');
  ({ page } = studio);
  complaints = complaintsOf(page);
  await page.goto(studio.address);
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  await studio.command({ do: 'ghost', level: 'kinematic', on: true });
  await studio.command({ do: 'speed', factor: 0 });
  await studio.command({ do: 'play' });
  await studio.until('ends', s => s.lines[0].over);
});
after(() => studio?.close());

test('the trail takes the color of any signal, with its scale', async () => {
  const legend = page.locator('[data-shade]');
  await page.getByLabel('Color of the trail').selectOption({ label: 'wheel.left.load' });
  await legend.getByText('N', { exact: true }).waitFor();
  await page.waitForFunction(() => { const [low, high] = [...document.querySelectorAll('[data-shade] b')].map(b => Number(b.textContent)); return low > 10 && high > low && high < 60; });
  // A signal that the page has no rows of, and that has two signs.
  await page.getByLabel('Color of the trail').selectOption({ label: 'wheel.left.voltage' });
  await page.waitForFunction(() => { const [low, high] = [...document.querySelectorAll('[data-shade] b')].map(b => Number(b.textContent.replace('−', '-'))); return low === -high && high > 1; });
  assert.ok(await page.locator('[data-layer=trail] path').count() > 10);
  // The time, from 0 to a round number that is no less than the end.
  await page.getByLabel('Color of the trail').selectOption({ label: 'time' });
  const end = (await studio.state()).lines[0].end;
  await page.waitForFunction(end => { const [low, high] = [...document.querySelectorAll('[data-shade] b')].map(b => Number(b.textContent)); return low === 0 && high >= end && high < 3 * end; }, end);
  await page.getByLabel('Color of the trail').selectOption({ label: 'speed on the path' });
});

test('velocity and forces are to a scale that is told', async () => {
  const moving = page.locator('[data-layer=moving]');
  const robot = (await studio.state()).robots[0].name;
  const t = await page.locator('[data-time]').textContent();
  const at = await fetch(`${studio.address}api/series?line=1&from=${Number(t) - 0.005}&to=${Number(t) + 0.005}&points=10&signals=robot.${robot}.twist.forward`);
  const forward = Number((await at.text()).trim().split('\n')[1].split(',')[1]);
  // Half a second of way, by the scale bar.
  const { length, metre } = await page.evaluate(() => {
    const [bar] = document.querySelectorAll('[data-bar]');
    const words = bar.textContent.match(/([\d.]+) (m|cm)/);
    const metre = (Number(bar.getAttribute('width')) - 4) / (Number(words[1]) * (words[2] === 'm' ? 1 : 0.01));
    const [head] = document.querySelectorAll('[data-layer=moving] .velocity + path');
    const start = document.querySelector('[data-layer=moving] .velocity').getPointAtLength(0), tip = head.getPointAtLength(0);
    return { length: Math.hypot(tip.x - start.x, tip.y - start.y), metre };
  });
  assert.ok(forward > 0.1, String(forward));
  assert.ok(Math.abs(length / metre - 0.5 * forward) < 0.02 * forward, `${length} px at ${metre} px/m for ${forward} m/s`);
  const newtons = page.locator('[data-newtons] b');
  assert.match(await newtons.textContent(), /^\d+(\.\d+)? N$/);
  await page.getByRole('button', { name: 'Forces' }).click();
  await moving.locator('.velocity').waitFor({ state: 'detached' });
  assert.equal(await newtons.count(), 0);
  await page.getByRole('button', { name: 'Forces' }).click();
});

test('three clicks measure an angle', async () => {
  await page.getByRole('button', { name: 'Measure' }).click();
  const box = await page.locator('.arena').boundingBox();
  const at = [[0.3, 0.5], [0.5, 0.5], [0.5, 0.7]].map(([x, y]) => [box.x + x * box.width, box.y + y * box.height]);
  for (const [x, y] of at) { await page.mouse.click(x, y); await page.waitForTimeout(120); }
  await page.locator('[data-layer=rim]').getByText('∠ 90.0°').waitFor();
  await page.keyboard.press('Escape');
});

test('a plot turns into a spectrum, and into one signal against another', async () => {
  const plot = k => page.locator('.plots section').nth(k);
  await plot(1).hover();
  await plot(1).getByRole('button', { name: /: more/ }).click();
  await plot(1).getByRole('button', { name: 'Spectrum' }).click();
  await plot(1).getByText(/Hz/).first().waitFor();
  await page.waitForFunction(() => /\d Hz/.test(document.querySelectorAll('.plots section')[1].querySelector('.readout').textContent));
  await plot(2).hover();
  await plot(2).getByRole('button', { name: /: more/ }).click();
  await plot(2).getByLabel('Against').selectOption({ label: 'twist.yaw_rate' });
  await plot(2).getByText('twist.yaw_rate, rad/s').waitFor();
  await page.waitForFunction(() => document.querySelectorAll('.plots section')[2].querySelector('path.line')?.getAttribute('d').length > 500);
});

test('pointing at a plot reads it off', async () => {
  const plot = page.locator('.plots section').first();
  const value = () => plot.locator('.readout .v').first().textContent();
  const now = await value();
  const box = await plot.locator('.u-over').boundingBox();
  await page.mouse.move(box.x + 3, box.y + box.height / 2);
  await page.waitForFunction(now => document.querySelector('.plots section .readout .v').textContent !== now, now);
  // It stood at the beginning.
  assert.ok(Math.abs(Number((await value()).replace('−', '-'))) < 0.05, await value());
  await page.mouse.move(5, 5);
});

test('what is plotted is taken along as CSV, SVG and PNG', async () => {
  const files = {};
  for (const kind of ['CSV', 'SVG', 'PNG']) {
    const [download] = await Promise.all([page.waitForEvent('download'), page.locator('.plots-view .bar').getByRole('button', { name: kind }).click()]);
    files[kind] = readFileSync(await download.path());
  }
  const rows = String(files.CSV).trim().split('\n');
  assert.match(rows[0], /^t \[s\],robot\.tri\.\S+ \[m\/s\]/);
  assert.equal(rows.length - 1, active(await studio.state()).end * 100 + 1);
  assert.match(String(files.SVG), /^<svg[^]*<\/svg>\s*$/);
  assert.equal(files.PNG.subarray(1, 4).toString(), 'PNG');
});
const active = s => s.lines.find(line => line.id === s.active);

test('spectra and plots against a signal are taken along as pictures', async () => {
  const plot = k => page.locator('.plots section').nth(k);
  for (const [k, words] of [[1, 'frequency, Hz'], [2, 'twist.yaw_rate, rad/s']]) {
    for (const kind of ['SVG', 'PNG']) {
      await plot(k).hover();
      await plot(k).getByRole('button', { name: /: more/ }).click();
      const [download] = await Promise.all([page.waitForEvent('download'), plot(k).getByRole('button', { name: `Save as ${kind}` }).click()]);
      const file = readFileSync(await download.path());
      if (kind === 'PNG') { assert.equal(file.subarray(1, 4).toString(), 'PNG'); assert.ok(file.length > 10000); continue; }
      assert.match(String(file), /^<svg[^]*<\/svg>\s*$/);
      assert.ok(String(file).includes(words), words);
      assert.ok(/class="line [^"]*"/.test(String(file)) && String(file).length > 5000);
      assert.doesNotMatch(String(file), /NaN/);
    }
  }
});

test('figures stand beside those of the other level', async () => {
  await tab('Table').click();
  const table = page.locator('[data-panel=table] table').first();
  await table.getByRole('columnheader', { name: /kinematic/ }).waitFor();
  assert.ok(await table.getByRole('row').count() > 8);
  assert.match(await table.getByRole('row', { name: /^time/ }).textContent(), /15\.\d+.*[+−]/);
  assert.deepEqual(await serious(), []);
});

test('another law takes over from the list of plug-ins', async () => {
  await page.keyboard.press('Home');
  await page.keyboard.press('ArrowRight');
  await tab('Plug-ins').click();
  assert.deepEqual(await serious(), []);
  await page.locator('[data-panel=plugins] li', { hasText: 'stanley' }).getByRole('button', { name: 'Take over' }).click();
  await studio.until('takes over', s => s.robots[0].driving === 'stanley');
  await page.locator('[data-panel=plugins] li[data-state=drives]', { hasText: 'stanley' }).waitFor();
  await page.getByRole('button', { name: 'Unload stanley' }).waitFor({ state: 'detached' });
});

test('the arena in space is drawn', async () => {
  await tab('3-D').click();
  await page.getByRole('img', { name: 'Arena in space: slope' }).waitFor();
  await page.waitForTimeout(1500);
  const picture = await page.locator('[data-panel=space]').screenshot();
  // Not one color: floor, grid and beacons are there.
  assert.ok(picture.length > 8000, `${picture.length} bytes`);
  assert.equal(await page.locator('[data-panel=space]').getByRole('alert').count(), 0);
});

test('a wheel-legged robot climbs a step, crosses a trench, and turns from what is too high', async () => {
  await tab('From the side').click();
  await page.getByRole('img', { name: 'From the side: slope' }).waitFor();
  await page.getByRole('button', { name: 'Wheel-legged robot' }).click();
  const told = page.locator('.obstacle .told').first();
  await page.getByText('step of 0.2 m: climb').waitFor();
  assert.match(await told.textContent(), /crossed/);
  await page.getByRole('button', { name: 'trench' }).click();
  await page.locator('.obstacle .told b', { hasText: 'trench' }).waitFor();
  await page.getByRole('button', { name: 'step up' }).click();
  await page.getByRole('slider', { name: 'height' }).fill('0.6');
  await page.getByText('The robot does not try it.').waitFor();
  assert.deepEqual(await serious(), []);
});

test('the page speaks four languages', async () => {
  for (const [code, play] of [['ru', 'Пуск'], ['zh', '播放'], ['pl', 'Start'], ['en', 'Play']]) {
    await page.locator('select.language').selectOption(code);
    await page.locator('.tp').getByRole('button', { name: play, exact: true }).waitFor();
    assert.equal(await page.evaluate(() => document.documentElement.lang), code);
    assert.deepEqual(await serious(), []);
    // Nothing leaves its place.
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 1280);
  }
});

test('a point of a batch is driven again', async () => {
  const out = join(studio.folder, 'batch');
  const ran = spawnSync(bin('appell'), ['batch', join(root, 'scenarios/noisy.toml'), '--trials', '40', '--out', out], { encoding: 'utf8' });
  assert.equal(ran.status, 0, ran.stderr);
  const other = await open(out);
  try {
    const view = other.page;
    const said = complaintsOf(view);
    await view.goto(other.address);
    await view.getByText('40 of 40 passed').waitFor();
    const figures = await (await fetch(other.address + 'api/batch')).json();
    // The nearest point to a place is driven, whichever it is.
    const box = await view.locator('.scatter').boundingBox();
    let driven = null;
    for (let k = 0; k < 200 && !driven; k++) {
      await view.mouse.move(box.x + 80 + (k % 20) * (box.width - 160) / 20, box.y + 70 + Math.floor(k / 20) * (box.height - 120) / 10);
      const tip = view.locator('.tip');
      if (!await tip.isVisible()) continue;
      // It may still be that of the place before.
      await view.waitForTimeout(200);
      if (!await tip.isVisible()) continue;
      const trial = Number((await tip.textContent()).match(/trial (\d+)/)[1]);
      if (trial === 0) continue;
      await view.mouse.down();
      await view.mouse.up();
      driven = trial;
    }
    assert.ok(driven !== null, 'some point is near');
    const s = await other.until('is driven', s => s.lines.some(line => line.trial === driven));
    const line = s.lines.find(line => line.trial === driven);
    const column = figures.columns.findIndex(one => one.name === 'time');
    assert.equal(line.metrics[0].metrics.find(m => m.name === 'time').value, figures.variants[0].values[column][driven]);
    assert.deepEqual(said, []);
  } finally { await other.close(); }
});

test('the console is silent', () => assert.deepEqual(complaints.filter(text => !text.includes('GL Driver Message')), []));
