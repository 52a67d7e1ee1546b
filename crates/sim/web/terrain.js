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
 * Darker is lower; neighbors of one shade are one rectangle.
 * @param {import('./arena.js').View} view
 * @param {Relief} relief
 */
function shadeRelief(view, { cell, columns, levels }) {
  const shadeOf = (/** @type {number} */ k) => Math.min(RELIEF_SHADES - 1, Math.floor((levels[k] / 1000) * RELIEF_SHADES));
  const paths = Array.from({ length: RELIEF_SHADES }, () => '');
  for (let row = 0; row * columns < levels.length; row++) {
    const top = px(view.y((row + 1) * cell));
    const high = px(view.y(row * cell) - view.y((row + 1) * cell));
    for (let from = 0; from < columns;) {
      const shade = shadeOf(row * columns + from);
      let to = from + 1;
      while (to < columns && shadeOf(row * columns + to) === shade) to++;
      const wide = px((to - from) * cell * view.scale);
      paths[shade] += `M${px(view.x(from * cell))} ${top}h${wide}v${high}h-${wide}z`;
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
  const height = (/** @type {number} */ k) => low + (levels[k] / 1000) * (high - low);
  const rows = levels.length / columns;
  let path = '';
  for (const level of multiples(low, high, step)) {
    if (!(level > low && level < high)) continue;
    for (let row = 0; row + 1 < rows; row++) {
      for (let column = 0; column + 1 < columns; column++) {
        const k = row * columns + column;
        // Corners in the order of a round, with the sides between them.
        const corners = [[0, 0, k], [1, 0, k + 1], [1, 1, k + columns + 1], [0, 1, k + columns]];
        const points = [];
        for (let side = 0; side < 4; side++) {
          const [ax, ay, a] = corners[side];
          const [bx, by, b] = corners[(side + 1) % 4];
          const [ha, hb] = [height(a), height(b)];
          if (ha < level === hb < level) continue;
          const part = (level - ha) / (hb - ha);
          points.push([column + 0.5 + ax + (bx - ax) * part, row + 0.5 + ay + (by - ay) * part]);
        }
        for (let i = 0; i + 1 < points.length; i += 2) {
          const [from, to] = [points[i], points[i + 1]].map(([x, y]) => `${px(view.x(x * cell))} ${px(view.y(y * cell))}`);
          path += `M${from}L${to}`;
        }
      }
    }
  }
  return `<path d="${path}" class="contour"/>`;
}
