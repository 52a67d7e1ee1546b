// Uneven ground seen from above: shading by height, and contours.
//
// Pure functions from heights to SVG text, like all drawing.

import { multiples, niceStep, px } from './draw.js';

/**
 * A feature whose height jumps, in the words of its file: a step or ramp without length, a block, a square wave.
 * @typedef {{ kind: 'step' | 'ramp' | 'block' | 'wave', at: [number, number], heading_deg: number, rise?: number, length?: number, width?: number, amplitude?: number, period?: number, phase_deg?: number }} Jump
 */
/** @typedef {{ kind: 'uneven', cell: number, columns: number, low: number, high: number, levels: number[], jumps?: Jump[] }} Relief heights in the middles of square cells, rows from the lowest y; 1000 levels from low to high, m; and what jumps between them */

const RELIEF_SHADES = 20;

/**
 * Shading and contours. `step` is the height between two contours, m.
 * @param {import('./arena.js').View} view
 * @param {Relief} relief
 */
export function drawRelief(view, relief) {
  if (!(relief.high > relief.low)) return { svg: '', step: 0 };
  const step = niceStep(relief.high - relief.low, 6);
  return { svg: shadeRelief(view, relief) + contourRelief(view, relief, step), step };
}

/**
 * What jumps at a point, m: `heightOf` without all that is smooth.
 * @param {Relief} relief
 * @param {number} x
 * @param {number} y
 */
export function jumpAt({ jumps = [] }, x, y) {
  let sum = 0;
  for (const { kind, at, heading_deg, rise = 0, length = 0, width = 0, amplitude = 0, period = 1, phase_deg = 0 } of jumps) {
    const [cos, sin] = [Math.cos(heading_deg * Math.PI / 180), Math.sin(heading_deg * Math.PI / 180)];
    const [dx, dy] = [x - at[0], y - at[1]];
    const [along, across] = [dx * cos + dy * sin, dy * cos - dx * sin];
    if (kind === 'block') sum += Math.abs(along) <= length / 2 && Math.abs(across) <= width / 2 ? rise : 0;
    else if (kind === 'wave') {
      const turns = along / period + phase_deg / 360;
      if (along >= 0 && along <= length) sum += turns - Math.floor(turns) < 0.5 ? amplitude : -amplitude;
    } else sum += along >= 0 ? rise : 0;
  }
  return sum;
}

/**
 * Height at a point, m: between the middles of cells straight but for what jumps, beyond them as on the rim.
 * @param {Relief} relief
 * @param {number} x
 * @param {number} y
 */
export function heightOf(relief, x, y) {
  const { cell, columns, low, high, levels } = relief;
  const rows = levels.length / columns;
  const along = (/** @type {number} */ v, /** @type {number} */ count) => Math.min(Math.max(v / cell - 0.5, 0), count - 1);
  const [u, v] = [along(x, columns), along(y, rows)];
  const [i, j] = [Math.min(Math.floor(u), Math.max(0, columns - 2)), Math.min(Math.floor(v), Math.max(0, rows - 2))];
  const [a, b] = [u - i, v - j];
  const at = (/** @type {number} */ di, /** @type {number} */ dj) => {
    const [column, row] = [Math.min(i + di, columns - 1), Math.min(j + dj, rows - 1)];
    return low + (levels[row * columns + column] / 1000) * (high - low) - jumpAt(relief, (column + 0.5) * cell, (row + 0.5) * cell);
  };
  return (1 - b) * ((1 - a) * at(0, 0) + a * at(1, 0)) + b * ((1 - a) * at(0, 1) + a * at(1, 1)) + jumpAt(relief, x, y);
}

/**
 * Darker is lower; neighbors of one shade are one rectangle.
 * @param {import('./arena.js').View} view
 * @param {Relief} relief
 */
function shadeRelief(view, { cell, columns, levels }) {
  const shadeOf = (/** @type {number} */ k) => Math.min(RELIEF_SHADES - 1, Math.floor((levels[k] / 1000) * RELIEF_SHADES));
  const paths = Array.from({ length: RELIEF_SHADES }, () => '');
  for (let row = 0; row * columns < levels.length; row++) {
    const top = px(view.y((row + 1) * cell));
    const bottom = px(view.y(row * cell));
    for (let from = 0; from < columns;) {
      const shade = shadeOf(row * columns + from);
      let to = from + 1;
      while (to < columns && shadeOf(row * columns + to) === shade) to++;
      // By corners, which neighbors share to the digit, so that no line shows between them.
      const left = px(view.x(from * cell));
      paths[shade] += `M${left} ${top}H${px(view.x(to * cell))}V${bottom}H${left}z`;
      from = to;
    }
  }
  const opacity = (/** @type {number} */ shade) => (0.012 + 0.15 * (1 - shade / (RELIEF_SHADES - 1))).toFixed(3);
  return paths.map((path, shade) => (path ? `<path d="${path}" class="slope" shape-rendering="crispEdges" fill-opacity="${opacity(shade)}"/>` : '')).join('');
}

/**
 * Lines of equal height, cell by cell between four middles (marching squares).
 * @param {import('./arena.js').View} view
 * @param {Relief} relief
 * @param {number} step
 */
function contourRelief(view, { cell, columns, low, high, levels }, step) {
  const rows = levels.length / columns;
  // Levels of the contours, in the units of `levels`.
  const span = (high - low) / 1000;
  const first = Math.ceil(low / step) * step;
  const ticks = multiples(low, high, step).map(level => (level - low) / span);
  const start = (first - low) / span;
  const every = step / span;
  let path = '';
  // Where a level cuts the side from one corner to the next, as words; nothing where it does not.
  const cut = (/** @type {number} */ level, /** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ dx, /** @type {number} */ dy, /** @type {number} */ a, /** @type {number} */ b) => {
    if (a < level === b < level) return '';
    const part = (level - a) / (b - a);
    return `${px(view.x((x + 0.5 + dx * part) * cell))} ${px(view.y((y + 0.5 + dy * part) * cell))}`;
  };
  for (let y = 0; y + 1 < rows; y++) {
    for (let x = 0; x + 1 < columns; x++) {
      const k = y * columns + x;
      const a = levels[k];
      const b = levels[k + 1];
      const c = levels[k + columns + 1];
      const d = levels[k + columns];
      const least = Math.min(a, b, c, d);
      const most = Math.max(a, b, c, d);
      if (Math.ceil((least - start) / every) === Math.ceil((most - start) / every)) continue;
      for (const level of ticks) {
        if (level < least || level > most) continue;
        const points = [cut(level, x, y, 1, 0, a, b), cut(level, x + 1, y, 0, 1, b, c), cut(level, x + 1, y + 1, -1, 0, c, d), cut(level, x, y + 1, 0, -1, d, a)].filter(Boolean);
        for (let i = 0; i + 1 < points.length; i += 2) path += `M${points[i]}L${points[i + 1]}`;
      }
    }
  }
  return `<path d="${path}" class="contour"/>`;
}
