// Uneven ground seen from above: shading by height, and contours.
//
// Pure functions from heights to SVG text, like all drawing.

import { multiples, niceStep, px } from './draw.js';

/** @typedef {{ kind: 'uneven', cell: number, columns: number, low: number, high: number, levels: number[] }} Relief heights in the middles of square cells, rows from the lowest y; 1000 levels from low to high, m */

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
 * Height at a point, m; between the middles of cells straight, beyond them as on the rim.
 * @param {Relief} relief
 * @param {number} x
 * @param {number} y
 */
export function heightOf({ cell, columns, low, high, levels }, x, y) {
  const rows = levels.length / columns;
  const along = (/** @type {number} */ v, /** @type {number} */ count) => Math.min(Math.max(v / cell - 0.5, 0), count - 1);
  const [u, v] = [along(x, columns), along(y, rows)];
  const [i, j] = [Math.min(Math.floor(u), Math.max(0, columns - 2)), Math.min(Math.floor(v), Math.max(0, rows - 2))];
  const [a, b] = [u - i, v - j];
  const at = (/** @type {number} */ di, /** @type {number} */ dj) => levels[Math.min(j + dj, rows - 1) * columns + Math.min(i + di, columns - 1)];
  const level = (1 - b) * ((1 - a) * at(0, 0) + a * at(1, 0)) + b * ((1 - a) * at(0, 1) + a * at(1, 1));
  return low + (level / 1000) * (high - low);
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
