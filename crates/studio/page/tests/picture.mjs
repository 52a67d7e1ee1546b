// Makes the picture of the front page: `npm run picture` writes docs/images/studio.png.

import { join } from 'node:path';
import { open, root } from './server.mjs';

const studio = await open('slalom.toml', { width: 1280, height: 800, theme: 'light' });
const { page, command } = studio;
try {
  await page.goto(studio.address);
  await page.getByRole('button', { name: 'Play', exact: true }).waitFor();
  // The number that changes on the way makes a branch; the line of before stays beside it.
  await command({ do: 'speed', factor: 0 });
  await command({ do: 'play' });
  await studio.until('ends', s => s.lines[0].over);
  await command({ do: 'change', path: 'robot.tri.controller.lookahead', value: 0.52, at: 4.2 });
  await command({ do: 'ghost', level: 'slip', on: true });
  await command({ do: 'play' });
  await studio.until('ends', s => s.lines.find(line => line.id === s.active).over);
  await page.keyboard.press('Home');
  for (let k = 0; k < 6; k++) await page.keyboard.press('Shift+ArrowRight');
  await page.keyboard.press('f');
  await page.mouse.move(640, 20);
  await page.waitForTimeout(1200);
  await page.screenshot({ path: join(root, 'docs/images/studio.png') });
} finally { await studio.close(); }
