// Measures the page in a browser under software rendering: `npm run measure` prints the table of the book,
// `npm run measure -- hundred` the row of that scenario.

import { writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { open } from './server.mjs';

const HEAD = name => `schema = 1\nname = "${name}"\ntitle = "${name}"\nseed = 1\n`;
const robot = (name, x, y) => `
[[robot]]
name = "${name}"
file = "../robots/bubble-base.toml"
pose = [${x}, ${y}, 0.0]
level = "${name === 'one' ? 'kinematic' : 'rolling'}"
[robot.controller]
kind = "signals"
period = 0.066
[[robot.controller.channel]]
to = "forward"
signal = { kind = "ramp", from_time = 0.0, to_time = 2.0, to = 0.2 }
[[robot.controller.channel]]
to = "yaw_rate"
signal = { kind = "ramp", from_time = 0.0, to_time = 2.0, to = 1.0 }
[robot.servo]
period = 0.01
`;
const arena = size => `[arena]\nsize = [${size}, ${size}]\n[[arena.beacon]]\nname = "mark"\nposition = [0.1, 0.1]\n`;
const hundred = HEAD('hundred') + '[time]\nstep = 0.001\nduration = 600.0\n' + arena(12) + Array.from({ length: 100 }, (_, k) => robot(`r${k}`, (0.6 + 1.2 * (k % 10)).toFixed(2), (0.4 + 1.2 * Math.floor(k / 10)).toFixed(2))).join('');
const million = HEAD('million') + '[time]\nstep = 0.001\nduration = 1000.0\n' + arena(2) + '[record]\nperiod = 0.001\n' + robot('one', 1.0, 0.8);

const quantile = (values, q) => [...values].sort((a, b) => a - b)[Math.min(values.length - 1, Math.floor(q * values.length))];

/** Times between pictures over some seconds, ms, and bytes a second meanwhile. */
async function frames(page, seconds) {
  let bytes = 0;
  const session = await page.context().newCDPSession(page);
  await session.send('Network.enable');
  // Binary payloads are told in base 64.
  session.on('Network.webSocketFrameReceived', ({ response }) => { bytes += response.opcode === 2 ? response.payloadData.length * 0.75 : response.payloadData.length; });
  const times = await page.evaluate(seconds => new Promise(done => {
    const times = [], begun = performance.now();
    let last = begun;
    const next = now => { times.push(now - last); last = now; if (now - begun < seconds * 1000) requestAnimationFrame(next); else done(times.slice(2)); };
    requestAnimationFrame(next);
  }), seconds);
  await session.detach();
  return { median: quantile(times, 0.5), slow: quantile(times, 0.95), bytes: bytes / seconds };
}

/** Time from a key on a slider to the picture that shows the change, ms. */
async function latency(page, count) {
  const slider = page.locator('.slider input').first();
  if (await slider.count() === 0) return NaN;
  await slider.focus();
  const times = [];
  for (let k = 0; k < count; k++) {
    // The page listens before the key is pressed: keys overtake what a busy page is asked for.
    await page.evaluate(() => {
      const marks = () => document.querySelectorAll('.mark[data-kind=change]').length;
      const before = marks();
      window.answered = new Promise(done => addEventListener('keydown', () => {
        const begun = performance.now();
        const next = () => { if (marks() > before) requestAnimationFrame(() => done(performance.now() - begun)); else if (performance.now() - begun > 15000) done(NaN); else requestAnimationFrame(next); };
        next();
      }, { once: true, capture: true }));
    });
    await page.keyboard.press(k % 2 ? 'ArrowLeft' : 'ArrowRight');
    times.push(await page.evaluate(() => window.answered));
    await page.waitForTimeout(450);
  }
  return quantile(times.filter(Number.isFinite), 0.5) ?? NaN;
}

console.log('| | time between pictures, median, ms | 95 %, ms | slider to picture, ms | kB/s to the page | |\n| --- | --- | --- | --- | --- | --- |');
const row = (name, f, slider, note) => console.log(`| ${name} | ${f.median.toFixed(1)} | ${f.slow.toFixed(1)} | ${Number.isFinite(slider) ? slider.toFixed(0) : '–'} | ${(f.bytes / 1000).toFixed(0)} | ${note} |`);

for (const [name, scenario, text] of [['1 robot, 1×', 'eight-two-laps.toml', null], ['100 robots, 1×', 'hundred.toml', hundred], ['1 robot, 1 000 000 rows', 'million.toml', million]]) {
  if (process.argv[2] && !scenario.startsWith(process.argv[2])) continue;
  const studio = await open('eight-two-laps.toml');
  const { page, command, folder, address } = studio;
  try {
    if (text) {
      writeFileSync(join(folder, 'scenarios', scenario), text);
      const said = await command({ do: 'open', name: scenario.replace('.toml', '') });
      if (said.problem) throw new Error(JSON.stringify(said));
    }
    if (scenario === 'million.toml') {
      await command({ do: 'speed', factor: 0 });
      const begun = performance.now();
      await command({ do: 'play' });
      for (;;) { const s = await studio.state(); if (s.lines[0].over || s.lines[0].end > 999.99) break; await new Promise(done => setTimeout(done, 200)); }
      const driven = (performance.now() - begun) / 1000;
      const opened = performance.now();
      await page.goto(address);
      await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
      const first = performance.now() - opened;
      const asked = performance.now();
      const answer = await fetch(`${address}api/series?line=${(await studio.state()).active}&from=0&to=1000&points=1200&signals=robot.one.pose.x,robot.one.pose.y,robot.one.twist.forward`);
      if ((await answer.text()).split('\n').length < 2400) throw new Error('the series are not there');
      const series = performance.now() - asked;
      await command({ do: 'speed', factor: 10 });
      await page.keyboard.press('Home');
      await page.keyboard.press('Space');
      row(name, await frames(page, 5), NaN, `driven in ${driven.toFixed(1)} s; first picture ${first.toFixed(0)} ms; three signals over all of it, thinned, ${series.toFixed(0)} ms; looked at again at 10×`);
    } else {
      await page.goto(address);
      const begun = performance.now();
      await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
      const first = performance.now() - begun;
      await command({ do: 'play' });
      await page.waitForTimeout(1000);
      const f = await frames(page, 5);
      row(name, f, await latency(page, 7), `first picture ${first.toFixed(0)} ms`);
    }
  } finally { await studio.close(); }
}
