// Pictures of studies rather than of runs: figures side by side, and maps of kinds over two quantities.
//
// Pure functions from numbers to SVG text.

import { clamp, escapeText, label, multiples, plain, px, textWidth, tickText } from './draw.js';
import { standalone } from './arena.js';
import { drawPlots } from './plot.js';

/** @typedef {import('./plot.js').Panel} Panel */
/** @typedef {{ title: string, unit: string, lines: { name: string, values: number[] }[] }} Figure */

/** Lines of a comparison: class and dash, in the order in which they are drawn. */
const STYLES = [['reference', '6 4'], ['blue', ''], ['green', '7 3'], ['vermilion', '']];

/**
 * Figures in two columns over one time each: the first half left, the second right.
 * @param {{ title: string, time: number[], columns: Figure[] }} data
 */
export function renderFigures(data) {
  const margin = 16;
  const gap = 28;
  const width = 1180;
  const half = (width - 2 * margin - gap) / 2;
  const count = Math.ceil(data.columns.length / 2);
  let svg = label(margin, 34, data.title, 'title');
  let bottom = 0;
  for (const side of [0, 1]) {
    const panels = data.columns.slice(side * count, (side + 1) * count).map(figure => /** @type {Panel} */ ({
      title: figure.title, unit: figure.unit, limits: [], markMin: false, markMax: false, more: 0,
      lines: figure.lines.map((line, k) => ({ label: line.name, color: STYLES[k][0], dash: STYLES[k][1], time: data.time, values: line.values })),
    }));
    const picture = drawPlots(panels, { width: half, height: 150, id: side === 0 ? 'left' : 'right' });
    svg += `<g transform="translate(${px(margin + side * (half + gap))} 48)">${picture.svg}</g>`;
    bottom = Math.max(bottom, picture.height);
  }
  return standalone(svg, width, 48 + bottom + margin, data.title);
}

/** A power of ten in words. @param {number} power */
function tenTo(power) {
  return '10' + [...String(power)].map(digit => digit === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[Number(digit)]).join('');
}

/**
 * How a distance falls with stiffness, both by their logarithms, beside the line of the first power.
 * @param {{ title: string, points: [number, number][], order: number }} data
 */
export function renderConvergence(data) {
  const frame = { left: 84, right: 600, top: 76, bottom: 396 };
  const decades = data.points.map(point => Math.log10(point[1]));
  const low = Math.floor(Math.min(...decades) - 0.15);
  const high = Math.ceil(Math.max(...decades) + 0.15);
  const most = Math.log2(data.points[data.points.length - 1][0]);
  const x = (/** @type {number} */ factor) => frame.left + (Math.log2(factor) + 0.3) / (most + 0.6) * (frame.right - frame.left);
  const y = (/** @type {number} */ distance) => frame.bottom - (Math.log10(distance) - low) / (high - low) * (frame.bottom - frame.top);
  let svg = label(24, 34, data.title, 'title');
  svg += `<text x="${frame.left}" y="${frame.top - 12}"><tspan class="bold">largest distance from rolling</tspan><tspan class="note f-ink2">, m</tspan></text>`;
  for (let power = low; power <= high; power++) {
    const at = y(Math.pow(10, power));
    svg += `<path d="M${frame.left} ${px(at)}H${frame.right}" class="grid"/>` + label(frame.left - 8, at + 4, tenTo(power), 'tick', 'end');
  }
  for (const [factor] of data.points) svg += `<path d="M${px(x(factor))} ${frame.top}V${frame.bottom}" class="grid"/>` + label(x(factor), frame.bottom + 18, `${plain(factor)}×`, 'tick', 'middle');
  svg += label((frame.left + frame.right) / 2, frame.bottom + 38, 'stiffness of all tires', 'tick', 'middle');
  // The first power, through the last point.
  const [end, least] = data.points[data.points.length - 1];
  const first = Math.min(least * end, Math.pow(10, high));
  svg += `<path d="M${px(x(least * end / first))} ${px(y(first))}L${px(x(end))} ${px(y(least))}" class="chord" stroke-dasharray="6 4"/>`;
  for (const [factor, distance] of data.points) svg += `<circle cx="${px(x(factor))}" cy="${px(y(distance))}" r="4" class="f-blue"/>`;
  svg += label(frame.right - 12, frame.top + 22, `order ${data.order.toFixed(2)}`, 'bold', 'end') + label(frame.right - 12, frame.top + 42, 'dashed: the first power', 'note', 'end');
  svg += `<rect x="${frame.left}" y="${frame.top}" width="${frame.right - frame.left}" height="${frame.bottom - frame.top}" class="frame"/>`;
  return standalone(svg, 640, frame.bottom + 56, data.title);
}

/** Kinds of order: key, class of the fill, opacity, words. */
const KINDS = /** @type {[string, string, number, string][]} */ ([
  ['impulses', 'f-sky', 0.3, 'square > sine > triangle'],
  ['triangle-first', 'f-vermilion', 1, 'triangle first (the paper’s text)'],
  ['sine-last', 'f-orange', 0.9, 'square > triangle > sine (its abstract)'],
  ['other', 'f-purple', 0.45, 'another order'],
  ['equal', 'f-ink2', 0.6, 'two are equal'],
]);

/**
 * Which wave moves each column most, over phase and a second quantity: a row of maps for each scan.
 * @param {{ title: string, columns: string[], scans: { name: string, values: number[], orders: string[][][] }[] }} data
 */
export function renderOrders(data) {
  const margin = 16;
  const left = margin + 44;
  const gap = 14;
  const width = 1180;
  const size = (width - left - margin - gap * (data.columns.length - 1)) / data.columns.length;
  let svg = label(margin, 34, data.title, 'title');
  let x = margin;
  for (const [, fill, opacity, words] of KINDS) {
    svg += `<rect x="${px(x)}" y="48" width="13" height="13" class="${fill}" fill-opacity="${opacity}"/>` + label(x + 19, 59, words);
    x += 19 + textWidth(words, 12.4) + 26;
  }
  let top = 100;
  const height = 170;
  for (const scan of data.scans) {
    const step = scan.values.length > 1 ? scan.values[1] - scan.values[0] : 1;
    const low = scan.values[0] - step / 2;
    const high = scan.values[scan.values.length - 1] + step / 2;
    const y = (/** @type {number} */ v) => top + height - (v - low) / (high - low) * height;
    data.columns.forEach((title, column) => {
      const x0 = left + column * (size + gap);
      svg += label(x0, top - 8, title, 'bold');
      scan.orders.forEach((phases, row) => {
        const cell = size / phases.length;
        // Neighbors of one kind are one rectangle.
        for (let k = 0; k < phases.length;) {
          let end = k + 1;
          while (end < phases.length && phases[end][column] === phases[k][column]) end++;
          const kind = KINDS.find(known => known[0] === phases[k][column]) || KINDS[3];
          const upper = y(scan.values[row] + step / 2);
          svg += `<rect x="${px(x0 + k * cell)}" y="${px(upper)}" width="${px((end - k) * cell)}" height="${px(y(scan.values[row] - step / 2) - upper)}" class="${kind[1]}" fill-opacity="${kind[2]}" shape-rendering="crispEdges"/>`;
          k = end;
        }
      });
      svg += `<rect x="${px(x0)}" y="${top}" width="${px(size)}" height="${height}" class="frame"/>`;
      for (const degrees of [0, 90, 180, 270]) svg += label(x0 + degrees / 360 * size, top + height + 16, `${degrees}°`, 'tick', degrees === 0 ? 'start' : 'middle');
      if (column === 0) {
        const ticks = (high - low) / 5 < 0.15 ? 0.1 : 0.2;
        for (const v of multiples(scan.values[0], high, ticks)) svg += label(x0 - 7, y(v) + 4, tickText(v, ticks), 'tick', 'end');
      }
    });
    svg += `<text transform="translate(${margin + 11} ${px(top + height / 2)}) rotate(-90)" text-anchor="middle" class="note">${escapeText(scan.name)}</text>`;
    svg += label(left + size * data.columns.length + gap * (data.columns.length - 1), top + height + 34, 'phase of all three waves', 'note', 'end');
    top += height + 76;
  }
  return standalone(svg, width, top - 76 + 46, data.title);
}

/** Strategies: class of the fill, opacity. */
const STRATEGIES = /** @type {Record<string, [string, number]>} */ ({
  direct: ['f-green', 0.22], climb_step: ['f-blue', 0.26], bridge_trench: ['f-sky', 0.42],
  descend_climb: ['f-orange', 0.38], turn: ['f-vermilion', 0.34],
});

/**
 * @typedef {object} StrategyMap
 * @property {string} title
 * @property {[number, number, string, string][]} steps from and to a height, m; strategy; words
 * @property {[number, number, number, number, string, string][]} trenches from and to a width, a depth, m
 * @property {{ value: number, name: string }[]} heights limits of heights and depths
 * @property {{ value: number, name: string }[]} widths limits of widths
 * @property {number} height_max upper end of heights and depths, m
 * @property {number} width_max upper end of widths, m
 * @property {{ kind: string, width: number, height: number, words: string[] } | null} obstacle what it is and what is done, and why
 */

/**
 * What a wheel-legged robot does about steps, and about trenches.
 * @param {StrategyMap} data
 */
export function renderStrategies(data) {
  const width = 1000;
  const height = 330;
  const top = 84;
  const bar = { left: 84, right: 330 };
  const map = { left: 470, right: width - 40 };
  const y = (/** @type {number} */ v) => top + height - v / data.height_max * height;
  const x = (/** @type {number} */ v) => map.left + v / data.width_max * (map.right - map.left);
  const area = (/** @type {number} */ x0, /** @type {number} */ x1, /** @type {number} */ y0, /** @type {number} */ y1, /** @type {string} */ key, /** @type {string} */ words) => {
    const [fill, opacity] = STRATEGIES[key];
    // Words keep off the lines of the limits.
    const middle = (y0 + y1) / 2;
    const shift = data.heights.some(limit => Math.abs(y(limit.value) - middle) < 12) ? -22 : 0;
    const text = x1 - x0 > textWidth(words, 12) + 8 && y0 - y1 > 16 ? label((x0 + x1) / 2, middle + shift + 4, words, 'bold', 'middle') : '';
    return `<rect x="${px(x0)}" y="${px(y1)}" width="${px(x1 - x0)}" height="${px(y0 - y1)}" class="${fill}" fill-opacity="${opacity}"/>${text}`;
  };
  let svg = label(24, 38, data.title, 'title');
  svg += `<text x="${bar.left}" y="${top - 14}"><tspan class="bold">step</tspan><tspan class="note f-ink2">, height H, m</tspan></text>`;
  svg += `<text x="${map.left}" y="${top - 14}"><tspan class="bold">trench</tspan><tspan class="note f-ink2">, depth h, m</tspan></text>`;
  for (const [from, to, key, words] of data.steps) svg += area(bar.left, bar.right, y(from), y(to), key, words);
  for (const [s0, s1, h0, h1, key, words] of data.trenches) svg += area(x(s0), x(s1), y(h0), y(h1), key, words);
  const step = 0.05 * Math.max(1, Math.round(data.height_max / 0.4));
  const wide = 0.1 * Math.max(1, Math.round(data.width_max / 0.6));
  for (const frame of [bar, map]) {
    svg += `<rect x="${px(frame.left)}" y="${top}" width="${px(frame.right - frame.left)}" height="${height}" class="frame"/>`;
    for (const v of multiples(0, data.height_max, step)) svg += label(frame.left - 8, y(v) + 4, tickText(v, step), 'tick', 'end');
    for (const limit of data.heights) {
      svg += `<path d="M${px(frame.left)} ${px(y(limit.value))}H${px(frame.right)}" class="chord"/>`;
      if (frame === bar) svg += label(frame.right + 8, y(limit.value) + 4, `${limit.name} = ${plain(limit.value)}`, 'note');
    }
  }
  for (const v of multiples(0, data.width_max, wide)) svg += label(x(v), top + height + 18, tickText(v, wide), 'tick', 'middle');
  svg += label((map.left + map.right) / 2, top + height + 36, 'width s, m', 'tick', 'middle');
  for (const limit of data.widths) svg += `<path d="M${px(x(limit.value))} ${top}V${px(top + height)}" class="chord"/>` + label(x(limit.value) + 7, top + 18, `${limit.name} = ${plain(limit.value)}`, 'note');
  let bottom = top + height + 48;
  const at = data.obstacle;
  if (at) {
    // What is off the scale sits on its edge.
    const cx = at.kind === 'step' ? (bar.left + bar.right) / 2 : x(clamp(at.width, 0, data.width_max));
    const cy = y(clamp(at.height, 0, data.height_max));
    const dx = at.kind === 'step' ? -70 : 0;
    svg += `<circle cx="${px(cx + dx)}" cy="${px(cy)}" r="6" class="start"/><circle cx="${px(cx + dx)}" cy="${px(cy)}" r="2.5" class="dot"/>`;
    svg += label(24, bottom + 16, at.words[0], 'bold') + label(24, bottom + 35, at.words[1]);
    bottom += 48;
  }
  return standalone(svg, width, bottom + 4, data.title);
}
