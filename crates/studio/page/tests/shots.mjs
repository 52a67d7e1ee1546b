// Takes the pictures that are looked at before a change of the page is called done, at two sizes and in both
// themes: `npm run shots -- FOLDER`.

import { spawnSync } from 'node:child_process';
import { copyFileSync, mkdirSync } from 'node:fs';
import { join } from 'node:path';

import { bin, open, root } from './server.mjs';

const out = process.argv[2] ?? 'shots';
const wanted = process.argv.slice(3);
mkdirSync(out, { recursive: true });
const SIZES = [[1280, 800], [1920, 1080]];

/** Drives to the end, and looks at an instant. */
const driven = async ({ page, command, until }, t) => {
  await command({ do: 'speed', factor: 0 });
  await command({ do: 'play' });
  const s = await until('ends', s => s.lines.find(line => line.id === s.active).over);
  // The page has all of it, too.
  await page.waitForFunction(t => document.querySelector('[data-time]').textContent === t, s.lines.find(line => line.id === s.active).end.toFixed(2));
  await page.keyboard.press('Home');
  for (let k = 0; k < t; k++) await page.keyboard.press('Shift+ArrowRight');
};

const SCENES = {
  slalom: async studio => {
    await studio.command({ do: 'ghost', level: 'kinematic', on: true });
    await studio.command({ do: 'ghost', level: 'slip', on: true });
    await driven(studio, 6);
  },
  forces: async studio => {
    // Steep enough that arrows are seen.
    await studio.command({ do: 'edit', set: [['terrain.slope_deg', '17.0']] });
    await driven(studio, 8);
    await studio.page.keyboard.press('f');
  },
  eight: async studio => { await driven(studio, 9); },
  plugins: async studio => {
    const { page } = studio;
    copyFileSync(join(root, 'examples/plugins/slalom.py'), join(studio.folder, 'scenarios/slalom.py'));
    await studio.command({ do: 'step' });
    await page.getByRole('tab', { name: 'Plug-ins' }).click();
    await studio.command({ do: 'play' });
    await page.waitForTimeout(2500);
    await studio.command({ do: 'load', robot: 'tri', file: 'slalom.py' });
    await studio.command({ do: 'swap', robot: 'tri', to: 'slalom' });
    await page.waitForTimeout(1500);
    await studio.command({ do: 'pause' });
  },
  legged: async ({ page }) => {
    await page.getByRole('tab', { name: 'From the side' }).click();
    await page.getByRole('button', { name: 'Wheel-legged robot' }).click();
    await page.getByText('step of 0.2 m: climb').waitFor();
    const time = page.locator('.obstacle input[type=range]').last();
    await time.fill(String(0.45 * Number(await time.getAttribute('max'))));
  },
  hills: async studio => {
    await studio.command({ do: 'speed', factor: 0 });
    await studio.command({ do: 'play' });
    while ((await studio.state()).lines[0].end < 6) await studio.page.waitForTimeout(300);
    await studio.command({ do: 'pause' });
    await studio.page.getByRole('tab', { name: '3-D' }).click();
    await studio.page.waitForTimeout(2500);
  },
  batch: async ({ page }) => { await page.getByText('passed', { exact: false }).first().waitFor(); await page.waitForTimeout(500); },
};
const OPENED = { slalom: 'slalom.toml', forces: 'slope.toml', eight: 'eight.toml', plugins: 'slalom.toml', legged: 'slope.toml', hills: 'hills.toml' };

for (const [name, scene] of Object.entries(SCENES)) {
  if (wanted.length > 0 && !wanted.includes(name)) continue;
  let file = OPENED[name];
  if (name === 'batch') {
    file = join(out, 'batch');
    const ran = spawnSync(bin('appell'), ['batch', join(root, 'scenarios/noisy.toml'), '--trials', '600', '--vary', 'robot.burger.platform.body.mass=uniform(0.7, 1.4)', '--vary', 'robot.burger.controller.speed=uniform(0.15, 0.6)', '--out', file], { encoding: 'utf8' });
    if (ran.status !== 0) throw new Error(ran.stderr);
  }
  const studio = await open(file);
  try {
    const { page } = studio;
    await page.goto(studio.address);
    await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
    await scene(studio);
    for (const [width, height] of SIZES) for (const theme of ['light', 'dark']) {
      await page.setViewportSize({ width, height });
      if (await page.evaluate(() => document.documentElement.dataset.theme) !== theme) await page.keyboard.press('t');
      await page.mouse.move(width / 2, 20);
      await page.waitForTimeout(1200);
      await page.screenshot({ path: join(out, `${name}-${width}-${theme}.png`) });
    }
  } finally { await studio.close(); }
}
