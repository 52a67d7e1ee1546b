// Plots over time, stacked on one axis.
//
// Pure functions from signals to SVG text; the report's player draws cursors over them with the
// frame that `drawPlots` returns.

import { DASHES, DATA_COLORS, clamp, eventMark, escapeText, label, multiples, pathText, px, roundUp, significant, textWidth, tickText } from './draw.js';
import { standalone } from './arena.js';
import { indexAt, valuesOf } from './run.js';

/** @typedef {import('./draw.js').Point} Point */
/** @typedef {import('./run.js').Run} Run */
/** @typedef {import('./run.js').PlotSpec} PlotSpec */
/** @typedef {{ label: string, color: string, dash: string, time: number[], values: (number | null)[], style?: string }} Line `color` is a class; values in the panel's unit */
/** @typedef {{ title: string, unit: string, note?: string, lines: Line[], limits: { value: number, label: string }[], markMin: boolean, markMax: boolean, more: number }} Panel */
/** @typedef {{ top: number, height: number, low: number, high: number, title: number, factor: number }} PanelFrame `title`: where the words above end, px; `factor`: from values to the numbers on the axis */
/** @typedef {{ left: number, right: number, top: number, bottom: number, t0: number, t1: number, panels: PanelFrame[] }} PlotFrame */
/** @typedef {{ svg: string, width: number, height: number, frame: PlotFrame }} PlotPicture */
/**
 * @typedef {object} PlotOptions
 * @property {number} [width]
 * @property {number} [height] of each panel, px
 * @property {number} [t0] start of the time axis
 * @property {number} [t1] end of the time axis
 * @property {{ n: number, t: number }[]} [events]
 * @property {string} [id] prefix of ids inside the picture
 */

/** The most lines one panel shows. */
export const LINES_MAX = 6;

/**
 * A plot with its signals looked up, scaled and colored. Signals that were not recorded are left
 * out; a panel without lines is null.
 * @param {Run} run
 * @param {PlotSpec} spec
 * @returns {Panel | null}
 */
export function panelOf(run, spec) {
  const found = spec.lines.filter(line => valuesOf(run, line.signal));
  if (found.length === 0) return null;
  const scale = spec.scale === undefined ? 1 : spec.scale;
  /** @type {Record<string, number>} */
  const used = {};
  // Unnamed roles avoid the colors that have a meaning in the same panel.
  const free = found.some(l => l.role === 'left' || l.role === 'right') ? DATA_COLORS.slice(2) : DATA_COLORS;
  let other = 0;
  const lines = found.slice(0, LINES_MAX).map(line => {
    let color = { left: 'blue', right: 'vermilion', main: 'ink', command: 'reference', reference: 'reference' }[line.role];
    if (!color) color = free[other++ % free.length];
    const nth = used[color] || 0;
    used[color] = nth + 1;
    const dash = color === 'reference' ? ['6 4', '2 3', '9 3 2 3'][nth % 3] : DASHES[(nth + Math.floor(other / (free.length + 1))) % DASHES.length];
    const values = /** @type {(number | null)[]} */ (valuesOf(run, line.signal));
    return { label: line.label, color, dash, time: run.time, values: scale === 1 ? values : values.map(v => v === null ? null : v * scale) };
  });
  const limits = (spec.limits || []).flatMap(l => spec.symmetric_limit && l.value !== 0 ? [l, { value: -l.value, label: '' }] : [l]);
  // Gray lines go below, so that the robot's own line is seen where they agree.
  lines.sort((a, b) => Number(b.color === 'reference') - Number(a.color === 'reference'));
  return { title: spec.title, unit: spec.unit === '1' ? '' : spec.unit, lines, limits, markMin: Boolean(spec.mark_min), markMax: Boolean(spec.mark_max), more: found.length - lines.length };
}

/**
 * A line in px between two times, thinned to the extremes of each pixel column.
 * @param {Line} line
 * @param {number} t0
 * @param {number} t1
 * @param {(t: number) => number} x
 * @param {(value: number) => number} y
 * @returns {Point[]}
 */
export function linePoints(line, t0, t1, x, y) {
  const { time, values } = line;
  const first = Math.max(0, indexAt(time, t0) - 1);
  const last = Math.min(values.length, time.length, indexAt(time, t1) + 2) - 1;
  const columns = Math.max(1, x(t1) - x(t0));
  /** @type {Point[]} */
  const points = [];
  const point = (/** @type {number} */ k) => /** @type {Point} */ ([x(time[k]), values[k] === null ? NaN : y(Number(values[k]))]);
  if (last - first < 3 * columns) {
    for (let k = first; k <= last; k++) points.push(point(k));
    return thin(points, 0.12);
  }
  for (let k = first; k <= last;) {
    const column = Math.floor(x(time[k]));
    let least = k;
    let most = k;
    let end = k;
    let gap = false;
    for (; end <= last && Math.floor(x(time[end])) === column; end++) {
      if (values[end] === null) gap = true;
      else if (Number(values[end]) < Number(values[least])) least = end;
      else if (Number(values[end]) > Number(values[most])) most = end;
    }
    let before = -1;
    for (const i of [k, Math.min(least, most), Math.max(least, most), end - 1]) {
      if (i !== before) points.push(point(i));
      before = i;
    }
    if (gap) points.push([NaN, NaN]);
    k = Math.max(end, k + 1);
  }
  return thin(points, 0.2);
}

/**
 * The points of a curve over time that keep every other within `tolerance` px of the chords; x
 * must not decrease. Gaps are kept.
 * @param {Point[]} points
 * @param {number} tolerance
 */
export function thin(points, tolerance) {
  /** @type {Point[]} */
  const out = [];
  /** @type {Point | null} */
  let anchor = null;
  /** @type {Point | null} */
  let before = null;
  let low = -Infinity;
  let high = Infinity;
  for (const p of points) {
    if (!Number.isFinite(p[0]) || !Number.isFinite(p[1])) {
      if (before) out.push(before);
      out.push(p);
      anchor = before = null;
      continue;
    }
    if (!anchor) { anchor = p; out.push(p); before = null; low = -Infinity; high = Infinity; continue; }
    // The chord from the anchor may swing between `low` and `high` and stay near all points so far.
    const dx = Math.max(p[0] - anchor[0], 1e-6);
    const slope = (p[1] - anchor[1]) / dx;
    if (before && (slope < low || slope > high)) {
      out.push(before);
      anchor = before;
      const step = Math.max(p[0] - anchor[0], 1e-6);
      low = (p[1] - anchor[1] - tolerance) / step;
      high = (p[1] - anchor[1] + tolerance) / step;
    } else {
      low = Math.max(low, slope - tolerance / dx);
      high = Math.min(high, slope + tolerance / dx);
    }
    before = p;
  }
  if (before) out.push(before);
  return out;
}

/**
 * Least and greatest finite value of lines between two times; where each is.
 * @param {Line[]} lines
 * @param {number} t0
 * @param {number} t1
 */
function extremes(lines, t0, t1) {
  const least = { value: Infinity, t: 0 };
  const most = { value: -Infinity, t: 0 };
  for (const { time, values } of lines) {
    for (let k = indexAt(time, t0); k < values.length && time[k] <= t1 + 1e-9; k++) {
      const v = values[k];
      if (v === null || !Number.isFinite(v)) continue;
      if (v < least.value) { least.value = v; least.t = time[k]; }
      if (v > most.value) { most.value = v; most.t = time[k]; }
    }
  }
  return { least, most };
}

/**
 * Range of an axis with round ends and its step; limits join when they are near enough to matter.
 * @param {Panel} panel
 * @param {number} low
 * @param {number} high
 * @param {number} parts the most intervals
 */
function axisOf(panel, low, high, parts) {
  if (!(high >= low)) { low = 0; high = 1; }
  const limits = panel.limits.map(l => l.value);
  if (low > 0 && low < 0.6 * high) low = 0;
  if (high < 0 && high > 0.6 * low) high = 0;
  // A nearly constant value must not look like a mountain range.
  const size = Math.max(Math.abs(low), Math.abs(high));
  if (high - low <= 1e-3 * size || size === 0) {
    const pad = size * 0.01 || 1;
    low = size === 0 ? 0 : low - pad;
    high += pad;
  }
  const range = high - low;
  for (const v of limits) if (v > low - 1.1 * range && v < high + 1.1 * range) { low = Math.min(low, v); high = Math.max(high, v); }
  let step = roundUp((high - low) / parts);
  while (Math.ceil(high / step - 1e-6) - Math.floor(low / step + 1e-6) > parts) step = roundUp(step * 1.01);
  // Ends are round, unless the data pass the last tick but by a little.
  const floor = Math.floor(low / step + 1e-6) * step;
  const ceiling = Math.ceil(high / step - 1e-6) * step;
  const pad = (high - low) * 0.05;
  const from = low - floor > 0.65 * step ? low - pad : floor;
  const to = ceiling - high > 0.65 * step ? high + pad : ceiling;
  return { low: limits.includes(from) ? from - pad : from, high: to + pad, step, ticks: multiples(from, to, step) };
}

/**
 * SI prefix for the numbers of an axis in a plain unit.
 * @param {string} unit
 * @param {number} size the largest number
 */
export function prefixOf(unit, size) {
  const plain = ['m', 'm/s', 's', 'N', 'N·m', 'V', 'A', 'W', 'J', 'rad', 'rad/s', 'm/s²', 'Ω'].includes(unit);
  if (!plain || !(size > 0) || (size >= 0.01 && size < 1e4)) return { factor: 1, prefix: '' };
  if (size >= 1e6) return { factor: 1e-6, prefix: 'M' };
  if (size >= 1e4) return unit.startsWith('m') || unit.startsWith('rad') || unit === 's' ? { factor: 1, prefix: '' } : { factor: 1e-3, prefix: 'k' };
  return size >= 1e-5 ? { factor: 1e3, prefix: 'm' } : size >= 1e-8 ? { factor: 1e6, prefix: 'µ' } : { factor: 1e9, prefix: 'n' };
}

/**
 * Moves labels apart, keeping their order, within [low, high].
 * @template {{ y: number }} T
 * @param {T[]} labels
 * @param {number} gap
 * @param {number} low
 * @param {number} high
 */
function spread(labels, gap, low, high) {
  labels.sort((a, b) => a.y - b.y);
  labels.forEach((l, i) => { l.y = Math.max(i > 0 ? labels[i - 1].y + gap : low, l.y); });
  for (let i = labels.length - 1; i >= 0; i--) labels[i].y = Math.min(i < labels.length - 1 ? labels[i + 1].y - gap : high, labels[i].y);
  return labels;
}

/**
 * Panels in a stack over one time axis.
 * @param {Panel[]} panels
 * @param {PlotOptions} [options]
 * @returns {PlotPicture}
 */
export function drawPlots(panels, options = {}) {
  const { width = 1120, height = 78, events = [], id = 'plots' } = options;
  const times = panels.flatMap(p => p.lines.map(l => l.time)).filter(t => t.length > 0);
  const t0 = options.t0 === undefined ? Math.min(...times.map(t => t[0]), times.length > 0 ? Infinity : 0) : options.t0;
  let t1 = options.t1 === undefined ? Math.max(...times.map(t => t[t.length - 1]), times.length > 0 ? -Infinity : 1) : options.t1;
  if (!(t1 > t0)) t1 = t0 + 1;
  const words = panels.flatMap(p => [...p.lines.map(l => l.label), ...p.limits.map(l => l.label)]);
  const measured = panels.map(panel => {
    const { least, most } = extremes(panel.lines, t0, t1);
    const axis = axisOf(panel, least.value, most.value, Math.max(2, Math.floor(height / 19)));
    const scaled = prefixOf(panel.unit, Math.max(Math.abs(axis.low), Math.abs(axis.high)));
    return { least, most, axis, ...scaled, names: axis.ticks.map(v => tickText(v * scaled.factor, axis.step * scaled.factor)) };
  });
  const left = Math.max(36, ...measured.map(m => Math.max(...m.names.map(n => textWidth(n, 12))) + 12));
  const right = width - clamp(Math.max(textWidth('time, s', 12) + 22, ...words.map(w => textWidth(w, 12) + 12)), 40, Math.max(70, width * 0.2));
  const x = (/** @type {number} */ t) => left + (t - t0) / (t1 - t0) * (right - left);
  const shown = events.filter(e => e.t >= t0 - 1e-9 && e.t <= t1 + 1e-9);
  let svg = `<clipPath id="${id}-time"><rect x="${left - 1}" y="0" width="${px(right - left + 2)}" height="100000"/></clipPath>`;
  // Numbers of events in as many as three rows; more would hide one another.
  const rows = [-Infinity, -Infinity, -Infinity];
  let depth = 0;
  const marks = shown.map(e => {
    const row = rows.findIndex(end => x(e.t) - end >= 20);
    if (row < 0) return '';
    rows[row] = x(e.t);
    depth = Math.max(depth, row + 1);
    return eventMark(x(e.t), 10 + row * 21, e.n);
  }).join('');
  let y0 = depth * 21 + (depth > 0 ? 6 : 0);
  const tStep = roundUp((t1 - t0) / clamp(Math.floor((right - left) / 62), 2, 12));
  const tTicks = multiples(t0, t1, tStep);
  /** @type {PanelFrame[]} */
  const frames = [];
  panels.forEach((panel, index) => {
    const top = y0 + 28;
    const { least, most, axis, factor, prefix, names } = measured[index];
    const y = (/** @type {number} */ v) => top + height - (v - axis.low) / (axis.high - axis.low) * height;
    const inside = panel.limits.filter(l => l.value >= axis.low && l.value <= axis.high);
    const outside = panel.limits.filter(l => l.label && !inside.includes(l));
    const unit = panel.unit ? `, ${prefix}${panel.unit}` : '';
    const notes = [panel.note, ...outside.map(l => `${l.label}, off the scale`), panel.more > 0 ? `${panel.more} more not shown` : ''].filter(Boolean).map(n => ` · ${n}`).join('');
    const room = right - left;
    const note = textWidth(panel.title + unit + notes, 12.3) < room ? notes : '';
    svg += `<text x="${left}" y="${px(top - 8)}"><tspan class="bold">${escapeText(panel.title)}</tspan><tspan class="note f-ink2">${escapeText(unit + note)}</tspan></text>`;
    svg += `<path d="${axis.ticks.map(v => `M${left} ${px(y(v))}H${px(right)}`).join('')}" class="grid"/><path d="${tTicks.map(t => `M${px(x(t))} ${px(top)}v${px(height)}`).join('')}" class="grid"/>`;
    if (axis.low < 0 && axis.high > 0) svg += `<path d="M${left} ${px(y(0))}H${px(right)}" class="grid-major"/>`;
    svg += axis.ticks.map((v, i) => label(left - 7, y(v) + 4, names[i], 'tick', 'end')).join('');
    if (shown.length > 0) svg += `<path d="${shown.map(e => `M${px(x(e.t))} ${px(top)}v${px(height)}`).join('')}" class="event"/>`;
    svg += inside.map(l => `<path d="M${left} ${px(y(l.value))}H${px(right)}" class="limit"/>`).join('');
    svg += `<g clip-path="url(#${id}-time)">` + panel.lines.map(l => {
      const dash = l.dash ? ` stroke-dasharray="${l.dash}"` : '';
      return `<path d="${pathText(linePoints(l, t0, t1, x, y))}" class="line s-${l.color}"${dash}${l.style ? ` style="${escapeText(l.style)}"` : ''}/>`;
    }).join('') + '</g>';
    for (const mark of [panel.markMin ? least : null, panel.markMax ? most : null]) {
      if (!mark || !Number.isFinite(mark.value)) continue;
      const text = `${significant(mark.value * factor, 3)}${panel.unit ? ` ${prefix}${panel.unit.replace(/ of .*/, '')}` : ''}`;
      const half = textWidth(text, 12) / 2;
      const mx = clamp(x(mark.t), left + half + 2, right - half - 2);
      const above = mark === most ? y(mark.value) - 9 > top + 8 : y(mark.value) + 18 > top + height;
      svg += `<circle cx="${px(x(mark.t))}" cy="${px(y(mark.value))}" r="3.2" class="dot"/>${label(mx, above ? y(mark.value) - 8 : y(mark.value) + 17, text, 'bold halo', 'middle')}`;
    }
    /** @type {{ y: number, text: string, color: string }[]} */
    const ends = [];
    for (const l of panel.lines) {
      const k = Math.min(indexAt(l.time, t1), l.values.length - 1);
      const v = l.values[k];
      if (panel.lines.length > 1 || panel.limits.length > 0) ends.push({ y: v === null || v === undefined ? top + height / 2 : clamp(y(v), top, top + height), text: l.label, color: l.color });
    }
    for (const l of inside) if (l.label) ends.push({ y: y(l.value), text: l.label, color: 'limit' });
    for (const e of spread(ends, 14, top + 1, top + height - (index === panels.length - 1 ? 5 : 1))) {
      const color = e.color === 'limit' ? 't-vermilion' : e.color === 'ink' ? '' : e.color === 'reference' ? 'note' : `t-${e.color}`;
      svg += label(right + 8, e.y + 4, e.text, color);
    }
    frames.push({ top, height, low: axis.low, high: axis.high, title: left + textWidth(panel.title + unit + note, 12.3), factor });
    if (index === panels.length - 1) {
      svg += tTicks.map(t => label(x(t), top + height + 17, tickText(t, tStep), 'tick', 'middle')).join('');
      svg += label(right + 18, top + height + 17, 'time, s', 'tick');
    }
    y0 = top + height;
  });
  return { svg: svg + marks, width, height: Math.ceil(y0 + 24), frame: { left, right, top: depth * 21, bottom: y0, t0, t1, panels: frames } };
}

/**
 * One plot, or several in a stack, as a picture of its own.
 * @param {Run} data
 * @param {PlotSpec | PlotSpec[]} plotSpec
 * @param {PlotOptions & { theme?: 'light' | 'dark' }} [options]
 */
export function renderPlot(data, plotSpec, options = {}) {
  const specs = Array.isArray(plotSpec) ? plotSpec : [plotSpec];
  const panels = specs.map(spec => panelOf(data, spec)).filter(panel => panel !== null);
  const width = options.width || 900;
  const margin = 16;
  const picture = drawPlots(panels, { height: specs.length === 1 ? 260 : 110, events: data.events, ...options, width: width - 2 * margin });
  const inside = panels.length > 0 ? `<g transform="translate(${margin} ${margin})">${picture.svg}</g>` : label(margin, 40, 'none of the signals of this plot was recorded', 'note');
  return standalone(inside, width, panels.length > 0 ? picture.height + 2 * margin : 72, specs.map(s => s.title).join(', '), options.theme);
}
