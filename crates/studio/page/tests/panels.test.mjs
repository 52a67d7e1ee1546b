// Panels of a project: added, edited, broken, hanging and removed while a run goes on, which does not notice.

import assert from 'node:assert/strict';
import { spawnSync } from 'node:child_process';
import { copyFileSync, mkdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { after, before, test } from 'node:test';
import { bin, complaintsOf, open, root } from './server.mjs';

let studio, page, complaints, panels;
const write = (name, text) => writeFileSync(join(panels, `${name}.js`), text);
const area = name => page.locator(`[data-area=${name}]`);
const openIn = async (where, name, under = false) => {
  // A panel is listed half a second after its file was written.
  await area(where).getByRole('button', { name: 'Open a panel' }).click();
  await area(where).getByRole('button', { name: under ? `${name}: Open it under the others` : `${name} of the project`, exact: false }).first().click();
};

before(async () => {
  studio = await open('eight-two-laps.toml');
  ({ page } = studio);
  complaints = complaintsOf(page);
  panels = join(studio.folder, 'panels');
  mkdirSync(panels);
  await page.goto(studio.address);
  // So slow that the run of 25 s outlasts the tests on any machine.
  await studio.command({ do: 'speed', factor: 0.05 });
  await page.getByRole('button', { name: 'Play', exact: true }).click();
});
after(() => studio?.close());

test('one is added, and draws what it watches', async () => {
  copyFileSync(join(root, 'examples/panels/histogram.js'), join(panels, 'histogram.js'));
  await openIn('right', 'histogram', true);
  const frame = area('below').frameLocator('iframe');
  await frame.getByText('values, now').waitFor();
  assert.ok(await frame.locator('rect').count() === 40);
  await frame.getByLabel('signal').selectOption({ index: 0 });
  await area('below').getByRole('tab', { name: 'Histogram' }).waitFor();
});

test('one knows neither the token nor the network', async () => {
  write('curious', `export function connect(host) {
    return { async draw() {
      const found = [location.href, document.baseURI, document.referrer, origin];
      try { found.push(parent.location.href); } catch { found.push('no parent'); }
      try { await fetch('${studio.address}api/state'); found.push('fetched'); } catch { found.push('no network'); }
      try { localStorage.setItem('a', 'b'); found.push('stored'); } catch { found.push('no storage'); }
      host.root.textContent = found.join(' | ');
    } };
  }`);
  await openIn('main', 'curious', true);
  const words = await area('under').frameLocator('iframe').getByText('no storage').textContent();
  assert.ok(words.includes('no parent') && words.includes('no network') && words.includes('| null |'), words);
  assert.ok(!words.includes(new URL(studio.address).pathname.split('/')[1]), words);
});

test('one is edited: the new one is connected at once', async () => {
  write('edited', 'export const title = "Before"; export function connect(host) { host.root.textContent = "old"; return { draw() {} }; }');
  await openIn('main', 'edited', true);
  await area('under').frameLocator('iframe').getByText('old').waitFor();
  await area('under').getByRole('tab', { name: 'Before' }).waitFor();
  write('edited', 'export const title = "After"; export function connect(host) { host.root.textContent = "new"; return { draw() {} }; }');
  await area('under').frameLocator('iframe').getByText('new').waitFor();
  await area('under').getByRole('tab', { name: 'After' }).waitFor();
});

for (const [name, text, problem] of [
  ['throws', 'export function connect() { return { draw(frame) { if (frame.time > 0) throw new Error("no such wheel"); } }; }', 'no such wheel'],
  ['later', 'export function connect() { setTimeout(() => { throw new Error("a late mistake"); }, 50); return { draw() {} }; }', 'a late mistake'],
  ['syntax', 'export function connect( {', 'SyntaxError|Unexpected|destructuring'],
  ['nothing', 'export const title = "Nothing";', 'must export a function connect'],
  ['flood', 'export function connect(host) { for (let k = 0; k < 20000; k++) host.seek(k); return { draw() {} }; }', 'floods|messages'],
  ['away', 'export function connect() { setTimeout(() => { location.href = "about:blank"; }, 50); return { draw() {} }; }', 'left its frame|has not answered'],
]) test(`one that is broken (${name}) is closed with its message`, async () => {
  write(name, text);
  await openIn('main', name, true);
  const alert = area('under').getByRole('alert');
  await alert.waitFor();
  assert.match(await alert.textContent(), new RegExp(problem));
  await alert.getByRole('button', { name: 'Close' }).click();
  // To look at another instant holds time, as if by hand.
  if (!(await studio.state()).playing) await studio.command({ do: 'play' });
});

test('one that hangs is closed, and holds up neither the page nor another', { timeout: 120000 }, async () => {
  // A look at another instant that the flood asked for may have come late, and held time.
  await studio.command({ do: 'play' });
  write('hangs', 'export const title = "Hangs"; export function connect() { return { draw(frame) { if (frame.time > 0) for (;;); } }; }');
  await openIn('main', 'hangs', true);
  const alert = area('under').getByRole('alert');
  const told = area('below').frameLocator('iframe').getByText('values, now');
  const before = await told.textContent();
  // A page that is held up draws no picture, and this does not end.
  let pictures = 0, beats = 0, wentOn = false;
  while (!await alert.isVisible()) {
    pictures += await page.evaluate(() => new Promise(done => { let n = 0; const t = performance.now(); const next = () => { n++; if (performance.now() - t > 250) done(n); else requestAnimationFrame(next); }; next(); }));
    beats++;
    wentOn ||= await told.textContent() !== before;
  }
  console.log(`${(pictures / beats * 4).toFixed(0)} pictures a second while a panel hangs`);
  assert.match(await alert.textContent(), /has not answered for 4 s/);
  assert.ok(wentOn, `the other went on from ${before}, playing: ${(await studio.state()).playing}`);
  await alert.getByRole('button', { name: 'Close' }).click();
});

test('one is removed', async () => {
  rmSync(join(panels, 'edited.js'));
  // It is looked for twice a second.
  await page.waitForTimeout(1200);
  await area('under').getByRole('tab', { name: /After|edited/ }).click();
  await area('under').getByText('not there any more').waitFor();
});

test('the run was untouched, bit for bit', async () => {
  await studio.command({ do: 'speed', factor: 0 });
  const s = await studio.until('ends', s => s.lines[0].over);
  assert.equal(s.lines.length, 1);
  assert.deepEqual(s.changes, []);
  const robot = s.robots[0].name;
  const series = await fetch(`${studio.address}api/series?line=${s.active}&from=0&to=999&points=8192&signals=robot.${robot}.pose.x,robot.${robot}.pose.yaw`);
  const here = (await series.text()).trim().split('\n').slice(1);
  const out = join(studio.folder, 'out');
  const ran = spawnSync(bin('appell'), ['run', studio.file, '--csv', '--no-report', '--out', out], { encoding: 'utf8' });
  assert.equal(ran.status, 0, ran.stderr);
  const text = readFileSync(join(out, 'recording.csv'), 'utf8').trim().split('\n');
  const names = text[0].split(',').map(name => name.replace(/ .*| *\[.*/, ''));
  const [x, yaw] = ['pose.x', 'pose.yaw'].map(end => names.indexOf(`robot.${robot}.${end}`));
  assert.equal(here.length, text.length - 1);
  here.forEach((row, k) => {
    const [, a, b] = row.split(',').map(Number);
    const cells = text[k + 1].split(',').map(Number);
    assert.equal(Math.fround(cells[x]), Math.fround(a), `row ${k}`);
    assert.equal(Math.fround(cells[yaw]), Math.fround(b), `row ${k}`);
  });
});

test('the page itself has nothing to complain of', () => {
  // What the policy of a frame forbids is told by the browser, and that a panel that was removed is not there.
  assert.deepEqual(complaints.filter(text => !/Content Security Policy|violates|Fetch API cannot load|404.*panels\/edited\.js/.test(text)), []);
});
