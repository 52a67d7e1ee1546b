// What happens to pages does not happen to the run: they crash, sleep, come late and lose their sockets, and its
// recording is, byte for byte, that of a run that nobody looked at.

import assert from 'node:assert/strict';
import { randomBytes } from 'node:crypto';
import { connect, createServer } from 'node:net';
import { after, before, test } from 'node:test';

import { open } from './server.mjs';

/** Time for which a page sleeps, ms: long enough that the run fills what lies between (half a megabyte a second),
 * and that both sides have more to say than they can send. A page that sleeps for longer than a minute is hung up
 * on, and joins anew, as after a cut. */
const SLEEP = 5000;
const CUTS = 100;

/** Numbers in [0, 1) that are the same each time. */
const random = (seed => () => { seed = (seed * 1103515245 + 12345) % 2147483648; return seed / 2147483648; })(7);

let undisturbed;
const end = s => s.lines.find(line => line.id === s.active);
const recording = async (studio, line = 1) => Buffer.from(await (await fetch(`${studio.address}api/lines/${line}/recording.mcap`)).arrayBuffer());
const begin = async studio => {
  await studio.page.goto(studio.address);
  await studio.page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  await studio.command({ do: 'play' });
};
const finish = async studio => {
  await studio.command({ do: 'speed', factor: 0 });
  await studio.until('ends', s => end(s).over);
  assert.ok(undisturbed.equals(await recording(studio)), 'the recording is that of a run that nobody looked at');
};

before(async () => {
  const studio = await open('slalom.toml');
  await studio.command({ do: 'speed', factor: 0 });
  await studio.command({ do: 'play' });
  await studio.until('ends', s => end(s).over);
  undisturbed = await recording(studio);
  await studio.close();
  assert.ok(undisturbed.length > 10000);
});

test('a page that is killed, and one that comes after it', async () => {
  const studio = await open('slalom.toml');
  try {
    await begin(studio);
    const crashed = new Promise(done => studio.page.once('crash', done));
    // Its renderer ends at once, and so does not answer.
    const session = await studio.page.context().newCDPSession(studio.page);
    session.send('Page.crash').catch(() => {});
    await crashed;
    const then = end(await studio.state()).end;
    await studio.until('goes on', s => end(s).end > then + 0.3);
    const next = await studio.browser.newPage();
    await next.goto(studio.address);
    await next.waitForFunction(t => Number(document.querySelector('[data-time]')?.textContent) > t, then);
    await finish(studio);
    await next.getByRole('status').getByText(/passed/).waitFor();
  } finally { await studio.close(); }
}, { timeout: 60000 });

test('a page that sleeps', async () => {
  const studio = await open('slalom.toml');
  try {
    await studio.command({ do: 'speed', factor: 1 });
    await begin(studio);
    const session = await studio.page.context().newCDPSession(studio.page);
    await studio.until('runs', s => end(s).end > 0.2);
    await session.send('Page.setWebLifecycleState', { state: 'frozen' });
    const then = end(await studio.state()).end;
    await new Promise(done => setTimeout(done, SLEEP));
    const slept = end(await studio.state()).end;
    assert.ok(slept > then + 0.5 * SLEEP / 1000, `${then} to ${slept}: time went on`);
    await session.send('Page.setWebLifecycleState', { state: 'active' });
    await studio.page.waitForFunction(t => Number(document.querySelector('[data-time]')?.textContent) >= t, slept);
    await finish(studio);
    await studio.page.getByRole('status').getByText(/passed/).waitFor();
  } finally { await studio.close(); }
}, { timeout: 60000 });

test(`${CUTS} sockets that are cut at random, a page's among them`, async () => {
  const studio = await open('slalom.toml');
  const { port, pathname } = new URL(studio.address);
  // What lies between the page and the studio, and breaks.
  const pairs = new Set();
  const between = createServer(near => {
    const far = connect(Number(port), '127.0.0.1');
    const pair = { near, far };
    pairs.add(pair);
    for (const [one, other] of [[near, far], [far, near]]) {
      one.pipe(other);
      one.on('error', () => other.destroy());
      one.on('close', () => { other.destroy(); pairs.delete(pair); });
    }
  });
  await new Promise(done => between.listen(0, '127.0.0.1', done));
  try {
    await studio.command({ do: 'speed', factor: 0.5 });
    await studio.page.goto(`http://127.0.0.1:${between.address().port}${pathname}`);
    await studio.page.getByRole('button', { name: 'Play', exact: true }).waitFor();
    await studio.command({ do: 'play' });
    let cuts = 0, ofThePage = 0;
    for (; cuts < CUTS; cuts++) {
      if (cuts % 10 === 5) {
        for (const { near, far } of pairs) { near.resetAndDestroy(); far.resetAndDestroy(); ofThePage++; }
        continue;
      }
      // A program's socket: cut while it greets, or after so many bytes.
      await new Promise(done => {
        const socket = connect(Number(port), '127.0.0.1', () => {
          const greeting = `GET ${pathname}socket HTTP/1.1\r\nHost: 127.0.0.1:${port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: ${randomBytes(16).toString('base64')}\r\n\r\n`;
          socket.write(greeting.slice(0, random() < 0.2 ? Math.floor(random() * greeting.length) : undefined));
        });
        const patience = Math.floor(random() * 150), bytes = Math.floor(random() * 40000);
        let got = 0;
        const cut = () => { clearTimeout(timer); socket.resetAndDestroy(); done(); };
        const timer = setTimeout(cut, patience);
        socket.on('data', data => { got += data.length; if (got > bytes) cut(); });
        socket.on('error', cut);
      });
    }
    assert.ok(ofThePage >= 5, `${ofThePage} sockets of the page were cut`);
    const s = await studio.state();
    assert.ok(s.playing && !end(s).over, 'the run was going on meanwhile');
    // The page joins again by itself.
    await studio.page.waitForFunction(t => Number(document.querySelector('[data-time]')?.textContent) > t, end(s).end);
    await finish(studio);
    await studio.page.getByRole('status').getByText(/passed/).waitFor();
  } finally {
    await studio.close();
    between.close();
  }
}, { timeout: 120000 });
