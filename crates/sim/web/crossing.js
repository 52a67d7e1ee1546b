// A wheel-legged robot on a step or over a trench, from the side: one instant, a strip of instants, and
// the page that plays them.
//
// Pure functions from numbers to SVG text; `crossing-player.js` touches the page.

import { escapeText, label, niceStep, px, significant, textWidth, tickText } from './draw.js';
import { standalone } from './arena.js';

/** @typedef {[number, number]} Point */
/**
 * @typedef {object} Frame
 * @property {number} t
 * @property {[Point, Point]} hinges front and rear
 * @property {[number, number]} legs
 * @property {number} pitch
 * @property {number} tilt
 * @property {Point[]} wheels from the front to the rear
 * @property {boolean[]} touches
 * @property {Point} center
 * @property {[number, number]} support
 * @property {number} margin
 * @property {string} deed
 */
/** @typedef {{ title: string, reason: string, verdict: string, levels: [number, number, number][], radius: number, arm: number, frames: Frame[] }} Crossing */
/** @typedef {{ x: (v: number) => number, z: (v: number) => number, scale: number, width: number, height: number, low: number, high: number }} View */

/**
 * A view of all that the robot sees of the ground, `width` px wide.
 * @param {Crossing} data
 * @param {number} width
 * @param {[number, number]} span from and to, m
 * @returns {View}
 */
function profileView(data, width, span) {
  const scale = width / (span[1] - span[0]);
  const floor = Math.min(...data.levels.map(l => l[2])) - 0.07;
  const top = Math.max(...data.frames.map(f => f.center[1])) + 0.3;
  const height = Math.round((top - floor) * scale);
  return { x: v => (v - span[0]) * scale, z: v => height - (v - floor) * scale, scale, width, height, low: span[0], high: span[1] };
}

/** @param {Crossing} data @returns {[number, number]} */
function spanOf(data) {
  const reach = 2.3 * data.radius + 0.08;
  return [data.frames[0].hinges[1][0] - reach, data.frames[data.frames.length - 1].hinges[0][0] + reach];
}

/** @param {Crossing} data @param {View} view */
function groundOf(data, view) {
  const points = data.levels.flatMap(([from, to, level]) => {
    const a = Math.max(from, view.low);
    const b = Math.min(to, view.high);
    return b > a ? [`${px(view.x(a))} ${px(view.z(level))}`, `${px(view.x(b))} ${px(view.z(level))}`] : [];
  });
  const line = `M${points.join('L')}`;
  return `<path d="${line}L${px(view.width)} ${view.height}L0 ${view.height}Z" class="slope" fill-opacity="0.16"/><path d="${line}" class="none s-ink" stroke-width="1.6"/>`;
}

/** @param {Frame} frame @param {Crossing} data @param {View} view */
function robotOf(frame, data, view) {
  const at = (/** @type {Point} */ p) => `${px(view.x(p[0]))} ${px(view.z(p[1]))}`;
  const [front, rear] = frame.hinges;
  let svg = '';
  // Support: a bar under the ground between the outer contacts, and the plumb line of the center of mass.
  const [s0, s1] = frame.support;
  const base = view.height - 9;
  svg += `<path d="M${px(view.x(s0))} ${base}H${px(view.x(s1))}" class="s-green" stroke-width="5" stroke-opacity="0.75"/><path d="M${px(view.x(s0))} ${base - 6}v12M${px(view.x(s1))} ${base - 6}v12" class="s-green" stroke-width="1.6"/>`;
  svg += `<path d="M${at(frame.center)}V${base + 6}" class="chord"/>`;
  frame.wheels.forEach((wheel, k) => {
    const color = k < 2 ? 'blue' : 'vermilion';
    svg += `<circle cx="${px(view.x(wheel[0]))}" cy="${px(view.z(wheel[1]))}" r="${px(data.radius * view.scale)}" class="f-${color} s-${color}" fill-opacity="${frame.touches[k] ? 0.34 : 0.08}" stroke-width="1.5"/><circle cx="${px(view.x(wheel[0]))}" cy="${px(view.z(wheel[1]))}" r="2.2" class="pivot"/>`;
  });
  for (const k of [0, 2]) svg += `<path d="M${at(frame.wheels[k])}L${at(frame.wheels[k + 1])}" class="s-ink" stroke-width="5" stroke-linecap="round" stroke-opacity="0.75"/>`;
  svg += `<path d="M${at(front)}L${at(rear)}" class="s-ink" stroke-width="9" stroke-linecap="round"/>`;
  // The part that tilts, from its joint.
  const lean = frame.tilt - frame.pitch;
  const middle = /** @type {Point} */ ([(front[0] + rear[0]) / 2, (front[1] + rear[1]) / 2]);
  const tip = /** @type {Point} */ ([middle[0] + data.arm * Math.sin(lean), middle[1] + data.arm * Math.cos(lean)]);
  svg += `<path d="M${at(middle)}L${at(tip)}" class="s-ink2" stroke-width="4" stroke-linecap="round"/><rect x="${px(view.x(tip[0]) - 0.06 * view.scale)}" y="${px(view.z(tip[1]) - 0.045 * view.scale)}" width="${px(0.12 * view.scale)}" height="${px(0.09 * view.scale)}" rx="3" class="body"/>`;
  for (const hinge of frame.hinges) svg += `<circle cx="${px(view.x(hinge[0]))}" cy="${px(view.z(hinge[1]))}" r="${px(Math.max(3, 0.016 * view.scale))}" class="start"/>`;
  const [cx, cz] = [view.x(frame.center[0]), view.z(frame.center[1])];
  const r = Math.max(4.5, 0.016 * view.scale);
  svg += `<circle cx="${px(cx)}" cy="${px(cz)}" r="${px(r)}" class="com"/><path d="M${px(cx - r)} ${px(cz)}h${px(2 * r)}M${px(cx)} ${px(cz - r)}v${px(2 * r)}" class="s-ink" stroke-width="1"/>`;
  return svg;
}

/** What is said of an instant. @param {Frame} frame */
function wordsOf(frame) {
  const degrees = (/** @type {number} */ a) => (a * 180 / Math.PI).toFixed(0).replace('-', '−').replace(/^−0$/, '0') + '°';
  return `legs ${degrees(frame.legs[0])} front, ${degrees(frame.legs[1])} rear · body ${degrees(frame.pitch)} · margin ${significant(frame.margin, 3)} m`;
}

/**
 * One instant over the whole scene, without a frame of its own: the inside of the player's picture.
 * @param {Crossing} data
 * @param {number} k
 * @param {number} [width]
 */
export function drawCrossing(data, k, width = 1080) {
  const view = profileView(data, width, spanOf(data));
  const step = niceStep(view.high - view.low, 6);
  const ticks = [];
  for (let i = Math.ceil(view.low / step); i * step < view.high; i++) {
    const x = view.x(i * step);
    const words = `${tickText(i * step, step)} m`;
    // Those that would be cut off are left out.
    const has = x + 4 + textWidth(words, 11.5) < width;
    ticks.push(`<path d="M${px(x)} 0V${view.height}" class="grid"/>${has ? label(x + 4, 14, words, 'tick') : ''}`);
  }
  return { svg: ticks.join('') + groundOf(data, view) + robotOf(data.frames[k], data, view), width, height: view.height, words: wordsOf(data.frames[k]) };
}

/**
 * Instants that show a crossing: the first, the last, and others spread over what happens between.
 * @param {Crossing} data
 * @param {number} most
 */
export function keyFrames(data, most) {
  const frames = data.frames;
  const busy = frames.map((f, k) => f.legs.some(a => Math.abs(a) > 0.01) || !f.touches.every(Boolean) ? k : -1).filter(k => k >= 0);
  const [first, last] = busy.length > 0 ? [busy[0], busy[busy.length - 1]] : [0, frames.length - 1];
  const between = Array.from({ length: most - 2 }, (_, i) => Math.round(first + (i + 0.5) * (last - first) / (most - 2)));
  return [...new Set([0, ...between, frames.length - 1])];
}

/**
 * A strip of instants, as a picture of its own.
 * @param {Crossing} data
 */
export function renderStrip(data) {
  const width = 1180;
  const margin = 20;
  const across = 3;
  const cell = (width - 2 * margin - (across - 1) * 16) / across;
  const picks = keyFrames(data, 9);
  let svg = label(margin, 36, data.title, 'title') + label(margin, 58, `${data.reason} · ${data.verdict}`, 'note');
  const one = profileView(data, cell, spanOf(data));
  const row = one.height + 50;
  picks.forEach((k, i) => {
    const frame = data.frames[k];
    const [x, y] = [margin + (i % across) * (cell + 16), 76 + Math.floor(i / across) * row];
    svg += `<g transform="translate(${px(x)} ${px(y)})">${groundOf(data, one)}${robotOf(frame, data, one)}<rect width="${px(cell)}" height="${one.height}" class="frame"/>` +
      `<text x="2" y="${one.height + 16}"><tspan class="bold">${i + 1}</tspan><tspan dx="6">${escapeText(`${frame.t.toFixed(1)} s, ${frame.deed}`)}</tspan></text>${label(2, one.height + 32, wordsOf(frame), 'tick')}</g>`;
  });
  return standalone(svg, width, 76 + Math.ceil(picks.length / across) * row + 8, data.title);
}

/** @param {Crossing} data */
export function crossingTitle(data) {
  return escapeText(data.title);
}

/**
 * The page: a still picture that the player brings to life.
 * @param {Crossing} data
 */
export function crossingBody(data) {
  const first = drawCrossing(data, 0);
  const last = data.frames[data.frames.length - 1];
  const least = data.frames.reduce((a, b) => a.margin < b.margin ? a : b);
  return `<main><h1>${escapeText(data.title)}</h1>
<p>${escapeText(data.reason)}. <strong>${escapeText(data.verdict)}</strong>, ${last.t.toFixed(1)} s; the center of mass is never nearer than ${significant(least.margin, 3)} m to an edge of the support polygon (${escapeText(least.deed)}, at ${least.t.toFixed(1)} s).</p>
<figure><svg class="picture" id="scene" viewBox="0 0 ${first.width} ${first.height}" role="img" aria-label="${escapeText(data.title)}">${first.svg}</svg></figure>
<p class="controls"><button id="play" type="button" title="play or pause, space">Play</button><input id="time" type="range" min="0" max="${last.t}" step="any" value="0" aria-label="time"/><output id="words">${escapeText(wordsOf(data.frames[0]))}</output></p>
<p class="legend">Front leg system blue, rear vermilion; a wheel that touches is filled. The bar below is the support between the outer contacts, ⊕ the center of mass over it; the box on the mast is the part of the body that tilts. Quasi-static: nothing accelerates. Lengths beyond wheel radius, pitch and reach are assumptions.</p></main>`;
}

const CROSSING_STYLE = `body{margin:0;background:var(--background);color:var(--ink);font:16px/1.5 Inter,"Helvetica Neue",Arial,sans-serif}main{max-width:1120px;margin:0 auto;padding:20px}h1{font-size:24px;margin:.2em 0}figure{margin:12px 0}figure svg{width:100%;height:auto;display:block;border:1px solid #8886;border-radius:6px}
.controls{display:flex;gap:14px;align-items:center;flex-wrap:wrap}.controls button{font:inherit;padding:4px 18px;border-radius:6px;border:1px solid #8889;background:none;color:inherit;cursor:pointer;min-width:92px}.controls input{flex:1 1 260px}.controls output{flex:1 1 100%;font-variant-numeric:tabular-nums}.legend{font-size:14px;opacity:.8}`;

/** Style of the page, beside that of pictures and colors. */
export function crossingStyle() {
  return CROSSING_STYLE;
}
