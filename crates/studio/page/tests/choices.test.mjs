// What is chosen from lists of what is found: robots, tasks, recordings, plug-ins, trials of a batch.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { copyFileSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';

import { bin, complaintsOf, open, root } from './server.mjs';

let studio, page, complaints;
const active = s => s.lines.find(line => line.id === s.active);
const tab = name => page.getByRole('tab', { name, exact: true });

before(async () => {
  studio = await open('slalom.toml');
  ({ page } = studio);
  const ran = spawnSync(bin('appell'), ['run', join(studio.folder, 'scenarios/slalom.toml'), '--level', 'kinematic', '--no-report', '--out', join(studio.folder, 'runs/level')], { encoding: 'utf8' });
  assert.equal(ran.status, 0, ran.stderr);
  complaints = complaintsOf(page);
  await page.goto(studio.address);
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
});
after(() => studio?.close());

test('files that appear, change and go are listed so, while nothing is done', async () => {
  const scenarios = join(studio.folder, 'scenarios');
  const named = name => page.locator('[data-panel=plugins] li', { hasText: name });
  await tab('Plug-ins').click();
  copyFileSync(join(root, 'examples/plugins/slalom.py'), join(scenarios, 'slalom.py'));
  await named('slalom.py').waitFor();
  const before = await named('slalom.py').locator('code').textContent();
  writeFileSync(join(scenarios, 'slalom.py'), readFileSync(join(scenarios, 'slalom.py'), 'utf8') + '\n');
  await page.waitForFunction(before => document.querySelector('[data-panel=plugins] li:has(.acts) code')?.textContent !== before, before);
  copyFileSync(join(scenarios, 'slalom.toml'), join(scenarios, 'zigzag.toml'));
  copyFileSync(join(studio.folder, 'robots/bubble-base.toml'), join(studio.folder, 'robots/another.toml'));
  await page.locator('header option', { hasText: 'zigzag.toml' }).waitFor({ state: 'attached' });
  await page.getByLabel('platform', { exact: true }).locator('option', { hasText: 'another' }).waitFor({ state: 'attached' });
  rmSync(join(scenarios, 'zigzag.toml'));
  await page.locator('header option', { hasText: 'zigzag.toml' }).waitFor({ state: 'detached' });
  assert.equal((await studio.state()).lines[0].end, 0);
});

test('a recording is laid beside the line', async () => {
  await page.getByLabel('Lay a recording beside').selectOption('level');
  const s = await studio.until('is there', s => s.lines.length === 2);
  assert.equal(s.lines[1].kind, 'recorded');
  assert.equal(active(s).name, 'A');
  await page.locator('.who').getByText('level, recorded').waitFor();
  await page.getByRole('button', { name: 'Leave out level' }).click();
  await studio.until('is gone', s => s.lines.length === 1);
});

test('a plug-in tells what its steps take', async () => {
  await tab('Plug-ins').click();
  const panel = page.locator('[data-panel=plugins]');
  await panel.locator('li', { hasText: 'slalom.py' }).getByRole('button', { name: 'Load' }).click();
  await panel.locator('li', { hasText: 'slalom.py' }).getByRole('button', { name: 'Take over' }).click();
  await studio.until('drives', s => s.robots[0].driving === 'slalom');
  await studio.command({ do: 'play' });
  const s = await studio.until('is measured', s => s.plugins.named[0]?.cost?.steps > 3);
  const { mean, longest } = s.plugins.named[0].cost;
  assert.ok(mean > 1e-6 && longest >= mean && longest < 1, `${mean} s, ${longest} s`);
  await panel.getByText(/a step [\d.]+ (µs|ms), ≤ /).waitFor();
  await studio.command({ do: 'pause' });
  await studio.until('holds', s => !s.playing);
});

test('another robot and another task are chosen', async () => {
  const platform = page.getByLabel('platform', { exact: true });
  await platform.selectOption('pioneer-3dx');
  await studio.until('is another', s => /pioneer/i.test(s.robots[0].platform));
  assert.match(await platform.locator('option').first().textContent(), /pioneer/i);
  const task = page.getByLabel('task', { exact: true });
  await task.selectOption('of:eight');
  const s = await studio.until('is another', s => s.robots[0].task === 'eight' && s.beacons.length === 2);
  assert.ok(s.undo.includes('eight.toml'), s.undo);
  await page.waitForFunction(() => document.querySelectorAll('svg .beacon').length === 2);
  await task.selectOption('gate');
  await studio.until('is another', s => s.robots[0].task === 'gate');
  // What does not fit says why, and leaves all as it was.
  await task.selectOption('of:parked');
  await page.getByRole('alert').getByText('no robot with a task').waitFor();
  assert.equal((await studio.state()).robots[0].task, 'gate');
  await page.keyboard.press('Control+z');
  await studio.until('is back', s => s.robots[0].task === 'eight');
});

test('a trial of a batch is saved as a scenario, which repeats it bit for bit', async () => {
  const out = join(studio.folder, 'batch');
  const ran = spawnSync(bin('appell'), ['batch', join(root, 'scenarios/noisy.toml'), '--trials', '8', '--vary', 'robot.burger.platform.body.mass=uniform(0.8, 1.2)', '--out', out], { encoding: 'utf8' });
  assert.equal(ran.status, 0, ran.stderr);
  const other = await open(out);
  try {
    await other.command({ do: 'trial', trial: 5 });
    const line = (await other.state()).active;
    const here = await (await fetch(`${other.address}api/lines/${line}/recording.csv`)).text();
    await other.command({ do: 'save', name: 'five' });
    const repeated = spawnSync(bin('appell'), ['run', join(out, 'five.toml'), '--csv', '--no-report', '--out', join(out, 'five')], { encoding: 'utf8' });
    assert.equal(repeated.status, 0, repeated.stderr);
    assert.ok(here.split('\n').length > 100);
    assert.ok(here === readFileSync(join(out, 'five/recording.csv'), 'utf8'), 'all rows');
  } finally { await other.close(); }
}, { timeout: 60000 });

test('the console is silent', () => assert.deepEqual(complaints, []));
