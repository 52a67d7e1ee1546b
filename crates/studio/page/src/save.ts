// Pictures and tables that are taken along as files.

import { renderArena } from '../../../sim/web/arena.js';
import { find } from './carrier';
import type { Line } from './net';

export function saveFile(name: string, content: Blob | string, type = 'text/plain'): void {
  const address = URL.createObjectURL(typeof content === 'string' ? new Blob([content], { type }) : content);
  const link = document.createElement('a');
  link.href = address;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

/** Hands over what lies at an address. */
export async function takeFile(address: string, name: string): Promise<void> {
  const found = await find(address);
  if (found.ok) saveFile(name, await found.blob());
}

export function saveSvg(name: string, svg: string): void { saveFile(`${name}.svg`, svg, 'image/svg+xml'); }

/** Draws an SVG text of its own as PNG, twice as fine. */
export async function savePng(name: string, svg: string): Promise<void> {
  const picture = new Image();
  picture.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;
  await picture.decode();
  const canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [picture.naturalWidth * 2, picture.naturalHeight * 2];
  canvas.getContext('2d')?.drawImage(picture, 0, 0, canvas.width, canvas.height);
  const blob = await new Promise<Blob | null>(done => canvas.toBlob(done, 'image/png'));
  if (blob) saveFile(`${name}.png`, blob);
}

export function saveArena(line: Line, theme: 'light' | 'dark'): void {
  saveSvg(`${line.scene.name}-arena`, renderArena(line.run, { theme }));
}
