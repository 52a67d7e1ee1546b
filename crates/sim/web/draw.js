// Numbers, colors and SVG text: what the arena and the plots share.
//
// Every function here is pure and returns text or numbers; nothing touches a document.

/** @typedef {Record<string, string>} Palette */
/** @typedef {[number, number]} Point */

/** Font of every picture, ready for a style sheet. */
export const FONT = 'Inter, "Helvetica Neue", Arial, "Liberation Sans", sans-serif';

/**
 * Colors on a white ground. The data colors are the Okabe–Ito set; a `…Text` color is the
 * same hue dark enough for small letters (at least 4.5 : 1).
 * @type {Palette}
 */
export const LIGHT = {
  background: '#ffffff', panel: '#ffffff', soft: '#f6f7f9', ink: '#15181d', ink2: '#565d68',
  line: '#d9dce1', grid: '#e6e8ec', gridMajor: '#d4d7dd', floor: '#fbfbfc', wall: '#6b727d',
  reference: '#858b95', casing: '#5f656f', event: '#8d939c', body: '#ffffff', bodyLine: '#2b3038',
  tread: '#ffffff', ground: '#3d4654', blue: '#0072B2', vermilion: '#D55E00', green: '#009E73',
  purple: '#CC79A7', sky: '#56B4E9', orange: '#E69F00', blueText: '#00659e',
  vermilionText: '#b04d00', greenText: '#007a59', purpleText: '#9c4578', skyText: '#176f9f',
  orangeText: '#8a5f00',
};

/**
 * Colors on a dark ground; same meanings.
 * @type {Palette}
 */
export const DARK = {
  background: '#14171C', panel: '#1a1e24', soft: '#1a1e24', ink: '#e9ecf0', ink2: '#a3abb7',
  line: '#343a44', grid: '#242931', gridMajor: '#323842', floor: '#181c22', wall: '#7b8491',
  reference: '#8b93a0', casing: '#8f98a6', event: '#69717d', body: '#20252d', bodyLine: '#d5dae1',
  tread: '#14171C', ground: '#8fa3c0', blue: '#2f97d6', vermilion: '#e8762a', green: '#1cb487',
  purple: '#d68bb5', sky: '#56B4E9', orange: '#E69F00', blueText: '#62b4ea',
  vermilionText: '#f4965a', greenText: '#3fce9f', purpleText: '#e0a3c6', skyText: '#7cc6f0',
  orangeText: '#f0b63f',
};

/** Names of the data colors in the order in which unnamed lines take them. */
export const DATA_COLORS = ['blue', 'vermilion', 'green', 'purple', 'sky', 'orange'];

/** Dash patterns that set lines of one color apart. */
export const DASHES = ['', '7 3', '2 3', '9 3 2 3'];

const VIRIDIS = [
  0x440154, 0x482475, 0x414487, 0x355f8d, 0x2a788e, 0x21918c, 0x22a884, 0x44bf70, 0x7ad151,
  0xbddf26, 0xfde725,
];

/**
 * The viridis color of `u` in [0, 1].
 * @param {number} u
 */
export function viridis(u) {
  const at = clamp(u, 0, 1) * (VIRIDIS.length - 1);
  const i = Math.min(VIRIDIS.length - 2, Math.floor(at));
  let mixed = 0;
  for (const shift of [16, 8, 0]) {
    const a = (VIRIDIS[i] >> shift) & 255;
    const b = (VIRIDIS[i + 1] >> shift) & 255;
    mixed |= Math.round(a + (b - a) * (at - i)) << shift;
  }
  return '#' + mixed.toString(16).padStart(6, '0');
}

/**
 * The class of a color given as `#rrggbb`: a name of the palette, `ink` for black and white,
 * or nothing when it is not one of ours.
 * @param {string | undefined} hex
 */
export function colorName(hex) {
  const wanted = (hex || '').toLowerCase();
  if (wanted === '#000000' || wanted === '#000' || wanted === '#ffffff' || wanted === '#fff') return 'ink';
  return DATA_COLORS.find(name => LIGHT[name].toLowerCase() === wanted) || null;
}

/** @param {number} value @param {number} low @param {number} high */
export function clamp(value, low, high) {
  return Math.min(high, Math.max(low, value));
}

/**
 * Text made safe for HTML and SVG, in content and in quoted attributes.
 * @param {unknown} text
 */
export function escapeText(text) {
  return String(text).replace(/&/g, '&amp;').replace(/</g, '&lt;').replace(/>/g, '&gt;')
    .replace(/"/g, '&quot;').replace(/'/g, '&#39;');
}

/**
 * A coordinate with one decimal.
 * @param {number} value
 */
export function px(value) {
  return String(Math.round(value * 10) / 10 + 0);
}

/**
 * A number with `digits` significant digits, a true minus, and powers of ten when it is far
 * from one.
 * @param {number} value
 * @param {number} [digits]
 */
export function significant(value, digits) {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (digits === undefined) {
    if (Number.isInteger(value) && size < 1e6) return String(value).replace('-', '−');
    digits = size < 1 ? 3 : 4;
  }
  if (value === 0) return '0';
  if (size < 1e-3 || size >= 1e6) {
    const [mantissa, exponent] = value.toExponential(Math.max(0, digits - 1)).split('e');
    const raised = String(Number(exponent)).replace(/[-0-9]/g, c => c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[Number(c)]);
    return `${mantissa} · 10${raised}`.replace('-', '−');
  }
  const rounded = Number(value.toPrecision(digits));
  const whole = Math.floor(Math.log10(Math.abs(rounded))) + 1;
  return rounded.toFixed(clamp(digits - whole, 0, 12)).replace('-', '−');
}

/**
 * The largest of 1, 2, 5 times a power of ten that cuts `range` into at least `count` parts.
 * @param {number} range
 * @param {number} count
 */
export function niceStep(range, count) {
  const raw = Math.abs(range) / count;
  if (!(raw > 0) || !Number.isFinite(raw)) return 1;
  const power = Math.pow(10, Math.floor(Math.log10(raw) + 1e-9));
  const lead = raw / power;
  return (lead >= 5 - 1e-9 ? 5 : lead >= 2 - 1e-9 ? 2 : 1) * power;
}

/**
 * A number of a label: at most four significant digits, no zeros at its end.
 * @param {number} value
 */
export function plain(value) {
  const rounded = Number(value.toPrecision(4));
  const size = Math.abs(rounded);
  return size !== 0 && (size < 1e-3 || size >= 1e6) ? significant(value) : String(rounded).replace('-', '−');
}

/**
 * The smallest of 1, 2, 5 times a power of ten not below `least`.
 * @param {number} least
 */
export function roundUp(least) {
  const step = niceStep(least, 1);
  return step >= least * (1 - 1e-9) ? step : step * (Math.round(step / Math.pow(10, Math.floor(Math.log10(step) + 1e-9))) === 2 ? 2.5 : 2);
}

/**
 * Multiples of `step` within [low, high].
 * @param {number} low
 * @param {number} high
 * @param {number} step
 */
export function multiples(low, high, step) {
  const out = [];
  for (let i = Math.ceil(low / step - 1e-6); i <= Math.floor(high / step + 1e-6) && out.length < 1000; i++) out.push(i * step);
  return out;
}

/**
 * A tick's number, with the decimals its step needs.
 * @param {number} value
 * @param {number} step
 */
export function tickText(value, step) {
  const decimals = clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 9);
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? '0' : text).replace('-', '−');
}

/**
 * Width of a text in px, near enough to place labels where no text can be measured.
 * @param {string} text
 * @param {number} size font size, px
 */
export function textWidth(text, size) {
  let ems = 0;
  for (const c of text) ems += 'iljtfr.,:;|!\'()[] '.includes(c) ? 0.33 : 'mwMW%@—⊕'.includes(c) ? 0.9 : c >= 'A' && c <= 'Z' ? 0.68 : 0.57;
  return ems * size;
}

/**
 * A line of text.
 * @param {number} x
 * @param {number} y baseline
 * @param {string} words not yet escaped
 * @param {string} [className]
 * @param {'start' | 'middle' | 'end'} [anchor]
 */
export function label(x, y, words, className = '', anchor = 'start') {
  const end = anchor === 'start' ? '' : ` text-anchor="${anchor}"`;
  return `<text x="${px(x)}" y="${px(y)}"${className && ` class="${className}"`}${end}>${escapeText(words)}</text>`;
}

/**
 * Path text through points in px; a gap (a point that is not finite) lifts the pen. Relative
 * steps between rounded points keep it short and do not drift.
 * @param {Point[]} points
 */
export function pathText(points) {
  let text = '';
  let x = NaN;
  let y = NaN;
  for (const [ax, ay] of points) {
    const nx = Math.round(ax * 10);
    const ny = Math.round(ay * 10);
    if (!Number.isFinite(nx) || !Number.isFinite(ny)) { x = NaN; continue; }
    if (Number.isNaN(x)) text += `M${nx / 10} ${ny / 10}l0 0`;
    else if (nx !== x || ny !== y) text += `${nx < x ? '' : ' '}${(nx - x) / 10}${ny < y ? '' : ' '}${(ny - y) / 10}`;
    x = nx;
    y = ny;
  }
  return text;
}

/**
 * The fewest of `points` that stay within `tolerance` px of the whole polyline (Ramer, Douglas
 * and Peucker). Gaps are kept.
 * @param {Point[]} points
 * @param {number} tolerance
 */
export function simplify(points, tolerance) {
  const keep = new Uint8Array(points.length);
  const finite = points.map(p => Number.isFinite(p[0]) && Number.isFinite(p[1]));
  /** @type {[number, number][]} */
  const stack = [];
  let first = -1;
  for (let i = 0; i <= points.length; i++) {
    if (i < points.length && finite[i]) { if (first < 0) first = i; continue; }
    if (first >= 0) { keep[first] = keep[i - 1] = 1; stack.push([first, i - 1]); }
    if (i < points.length) keep[i] = 1;
    first = -1;
  }
  for (let span = stack.pop(); span; span = stack.pop()) {
    const [a, b] = span;
    const [ax, ay] = points[a];
    const ux = points[b][0] - ax;
    const uy = points[b][1] - ay;
    const length2 = ux * ux + uy * uy;
    let far = tolerance * tolerance;
    let at = -1;
    for (let i = a + 1; i < b; i++) {
      const vx = points[i][0] - ax;
      const vy = points[i][1] - ay;
      const along = length2 > 0 ? clamp((vx * ux + vy * uy) / length2, 0, 1) : 0;
      const dx = vx - along * ux;
      const dy = vy - along * uy;
      const d = dx * dx + dy * dy;
      if (d > far) { far = d; at = i; }
    }
    if (at > 0) { keep[at] = 1; stack.push([a, at], [at, b]); }
  }
  return points.filter((_, i) => keep[i]);
}

/**
 * The numbered mark of an event.
 * @param {number} x
 * @param {number} y
 * @param {number} n
 */
export function eventMark(x, y, n) {
  return `<g class="mark"><circle cx="${px(x)}" cy="${px(y)}" r="9"/>${label(x, y + 3.9, String(n), n > 99 ? 'tiny' : '', 'middle')}</g>`;
}

/**
 * The style sheet of every picture. `color` gives the text of a color: a value for a picture
 * that stands alone, `var(--name)` inside a page.
 * @param {(name: string) => string} color
 */
export function pictureStyle(color) {
  const c = color;
  const lines = ['ink', 'ink2', 'reference', ...DATA_COLORS].map(n => `.s-${n}{stroke:${c(n)}}.f-${n}{fill:${c(n)}}`).join('');
  const texts = DATA_COLORS.map(n => `text.t-${n},.t-${n}{fill:${c(n + 'Text')}}`).join('');
  return `svg.picture text{font-family:${FONT};font-size:12px;fill:${c('ink')};font-variant-numeric:tabular-nums;font-feature-settings:"tnum"}
svg.picture .none,svg.picture .line,svg.picture .ref{fill:none}${lines}
svg.picture .line{stroke-width:1.5;stroke-linejoin:round}svg.picture text.note,svg.picture text.tick{fill:${c('ink2')}}svg.picture text.tick{font-size:11.5px}svg.picture text.tiny{font-size:8.5px}svg.picture .bold{font-weight:600}svg.picture text.title{font-size:17px;font-weight:600}
${texts.replace(/text\./g, 'svg.picture text.')}
.ground{fill:${c('background')}}.floor{fill:${c('floor')}}.grid,.grid-major{stroke:${c('grid')};stroke-width:1;shape-rendering:crispEdges}.grid-major{stroke:${c('gridMajor')}}.wall{fill:none;stroke:${c('wall')};stroke-width:1.5}
.slope{fill:${c('ground')}}.contour{stroke:${c('ground')};stroke-width:1;opacity:.3}.patch{fill:${c('sky')};fill-opacity:.16;stroke:${c('sky')};stroke-opacity:.7}
.origin{stroke:${c('ink2')};stroke-width:1.5;fill:none}.origin-tip{fill:${c('ink2')}}.bar{stroke:${c('ink')};stroke-width:1.3;fill:none}.halo{stroke:${c('floor')};stroke-width:3;stroke-linejoin:round;paint-order:stroke}
.ref{fill:none;stroke:${c('reference')};stroke-width:1.3;stroke-dasharray:6 4}.chord{stroke:${c('ink2')};stroke-width:1.1;stroke-dasharray:2 4;fill:none}.gate{stroke:${c('green')};stroke-width:1.8;stroke-dasharray:7 5}.chevron{fill:none;stroke:${c('greenText')};stroke-width:2;stroke-linejoin:round;stroke-linecap:round}.corridor{fill:none;stroke:${c('green')};stroke-opacity:.14;stroke-linejoin:round;stroke-linecap:round}.goal{fill:${c('green')};fill-opacity:.1;stroke:${c('green')};stroke-width:1.6}
.beacon{fill:${c('orange')};stroke:${c('orangeText')};stroke-width:1}
.rest{fill:none;stroke:${c('ink2')};stroke-width:1.2;stroke-opacity:.5;stroke-linejoin:round}.casing{fill:none;stroke:${c('casing')};stroke-width:5;stroke-linejoin:round;stroke-linecap:round}.trail{fill:none;stroke-width:3.2;stroke-linecap:round;stroke-linejoin:round}
.start{stroke:${c('ink2')};stroke-width:1.6;fill:${c('floor')}}.dot{fill:${c('ink')};stroke:${c('background')};stroke-width:1}.leader{stroke:${c('ink2')};stroke-width:1}.mark circle{fill:${c('background')};stroke:${c('ink')};stroke-width:1.2}svg.picture .mark text{font-size:11px;font-weight:600}
.body{fill:${c('body')};fill-opacity:.72;stroke:${c('bodyLine')};stroke-width:1.4;stroke-linejoin:round}.axle{stroke:${c('bodyLine')};stroke-width:1;stroke-opacity:.5}.wheel-left{fill:${c('blue')}}.wheel-right{fill:${c('vermilion')}}.wheel-other{fill:${c('ink2')}}.tread{stroke:${c('tread')};stroke-width:1;stroke-opacity:.6}.fork{stroke:${c('bodyLine')};stroke-width:1.2}.pivot{fill:${c('bodyLine')}}.com{fill:${c('body')};stroke:${c('bodyLine')};stroke-width:1.2}.reach{fill:none;stroke:${c('ink2')};stroke-width:1;stroke-opacity:.45}
.ghost .body{fill:none;fill-opacity:0}
.force{stroke-width:2.4;fill:none}.force-casing{fill:${c('body')};stroke:${c('body')};stroke-width:5.5;stroke-linejoin:round}.friction{fill:none;stroke-width:1.2;stroke-dasharray:1.5 3.5;stroke-linecap:round}.over{fill:${c('vermilion')};fill-opacity:.35;stroke-dasharray:none}
.frame{fill:none;stroke:${c('line')}}.event{stroke:${c('event')};stroke-width:1;shape-rendering:crispEdges}.limit{stroke:${c('vermilion')};stroke-width:1.2;stroke-dasharray:7 4}.cursor{stroke:${c('ink')};stroke-width:1}.hover{stroke:${c('ink2')};stroke-width:1;stroke-dasharray:2 3}.chip{fill:${c('ink')};stroke:${c('background')};stroke-width:4;paint-order:stroke}svg.picture text.chip-text{fill:${c('background')};font-size:11px;font-weight:600}.select{fill:${c('blue')};fill-opacity:.13;stroke:${c('blue')};stroke-width:1}.knob{fill:${c('background')};stroke-width:1.8}`;
}
