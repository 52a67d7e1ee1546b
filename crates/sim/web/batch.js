// The report of a batch: success, reasons of failure, and the distribution of each figure.
//
// Pure, and without scripts in the page: everything is drawn beforehand.

import { clamp, escapeText, label, niceStep, plain, px, significant, textWidth, tickText } from './draw.js';

/**
 * @typedef {object} Figure
 * @property {string} name
 * @property {string} unit
 * @property {string} group
 * @property {number} count trials that have it
 * @property {number} mean
 * @property {number} std
 * @property {number[]} quantiles least, 5, 25, 50, 75, 95 %, largest
 * @property {number[]} bins counts in equal intervals from the least to the largest
 */
/**
 * @typedef {object} BatchData
 * @property {{ scenario: string, title: string, hash: string, root: string, seed: number, version: string, precision: string, trials: number, variants: Variant[] }} summary
 * @property {Record<string, Mark>} marks
 * @property {string | null} marked file of the run whose figures are marked
 * @property {string} drawn group of the drawn values
 * @property {string} text
 * @property {Scatter[][]} scatters of each variant
 * @property {{ title: string, variant: number, trial: number, reason: string, svg: string }[]} pictures
 */
/** @typedef {{ name: string, verdicts: Record<string, number>, success?: { share: number, low: number, high: number }, failures: [string, number][], figures: Figure[], paired?: { figure: string, mean: number, error: number, count: number }[] }} Variant */
/** @typedef {{ value: number, below: number }} Mark a figure of the marked run, and the share of trials below it */
/** @typedef {{ influence: { drawn: string, figure: string, correlation: number }, x: (number | null)[], y: (number | null)[], passed: boolean[] }} Scatter */

const CELL = { width: 360, height: 148, left: 12, right: 12, top: 40, bottom: 26 };

/**
 * Name of a figure without that of its group.
 * @param {Figure} figure
 */
function shortName(figure) {
  const start = `${figure.group}: `;
  return figure.name.startsWith(start) ? figure.name.slice(start.length) : figure.name;
}

/**
 * @param {string} words
 * @param {number} width px
 * @param {number} size px
 */
function fitted(words, width, size) {
  if (textWidth(words, size) <= width) return words;
  let cut = words;
  while (cut && textWidth(`…${cut}`, size) > width) cut = cut.slice(1);
  return `…${cut}`;
}

/**
 * A histogram with median, the middle 90 % and a mark.
 * @param {Figure} figure
 * @param {Mark | undefined} marked
 */
function histogram(figure, marked) {
  const mark = marked && marked.value;
  const { width, height, left, right, top, bottom } = CELL;
  const [least, low, , median, , high, most] = figure.quantiles;
  const from = mark === undefined ? least : Math.min(least, mark);
  const to = mark === undefined ? most : Math.max(most, mark);
  const span = to - from;
  const x = (/** @type {number} */ value) => left + (value - from) / span * (width - left - right);
  const floor = height - bottom;
  const tallest = Math.max(1, ...figure.bins);
  const step = (most - least) / figure.bins.length;
  const bars = figure.bins.map((count, k) => {
    if (count === 0) return '';
    const a = x(least + k * step);
    const b = x(least + (k + 1) * step);
    const h = Math.max(1, count / tallest * (floor - top));
    return `<rect x="${px(a)}" y="${px(floor - h)}" width="${px(Math.max(0.8, b - a - 0.6))}" height="${px(h)}" class="f-blue" fill-opacity=".55"/>`;
  }).join('');
  // As many ticks as have room for their numbers.
  let stepTicks = niceStep(span, 5);
  for (let count = 4; count > 1; count--) {
    const widest = Math.max(...[from, to].map(v => textWidth(tickText(v, stepTicks), 11.5)));
    if ((widest + 10) * span / stepTicks < width - left - right) break;
    stepTicks = niceStep(span, count - 1);
  }
  let ticks = '';
  for (let value = Math.ceil(from / stepTicks) * stepTicks; value <= to + stepTicks * 1e-6; value += stepTicks) {
    const at = x(value);
    const words = tickText(value, stepTicks);
    const half = textWidth(words, 11.5) / 2;
    ticks += `<path d="M${px(at)} ${px(floor)}v4" class="frame"/>${label(clamp(at, half, width - half), floor + 16, words, 'tick', 'middle')}`;
  }
  const middle = `<path d="M${px(x(low))} ${px(floor + 0.5)}H${px(x(high))}" class="s-blue" stroke-width="3"/><path d="M${px(x(median))} ${px(top)}V${px(floor)}" class="s-ink" stroke-width="1.2"/>`;
  let marker = '';
  if (marked && mark !== undefined) {
    const at = x(mark);
    // Digits enough to tell it from the others.
    const digits = clamp(Math.ceil(Math.log10(Math.abs(mark) / span)) + 3, 3, 9);
    const words = `${significant(mark, mark === 0 ? 1 : digits)} · above ${Math.round(100 * marked.below)} %`;
    const half = textWidth(words, 11.5) / 2;
    marker = `<path d="M${px(at)} ${px(top - 4)}V${px(floor)}" class="s-vermilion" stroke-width="2"/>${label(clamp(at, half + 2, width - half - 2), top - 8, words, 't-vermilion', 'middle')}`;
  }
  const unit = figure.unit && figure.unit !== '1' ? `, ${figure.unit}` : '';
  const title = `<text x="${left}" y="14" class="bold">${escapeText(fitted(shortName(figure), width - left - right - textWidth(unit, 12), 12.5))}<tspan class="note" font-weight="400">${escapeText(unit)}</tspan></text>`;
  return `<svg class="picture" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" aria-label="Distribution of ${escapeText(figure.name)}">${title}<path d="M${left} ${px(floor)}H${width - right}" class="frame"/>${bars}${middle}${ticks}${marker}</svg>`;
}

/**
 * Ticks along an axis: as many as have room.
 * @param {number} from
 * @param {number} to
 * @param {number} count at most
 */
function ticksOf(from, to, count) {
  const step = niceStep(to - from, count);
  const values = [];
  for (let value = Math.ceil(from / step - 1e-9) * step; value <= to + step * 1e-6; value += step) values.push(value);
  return { step, values };
}

/**
 * A figure against a drawn value, one point for a trial.
 * @param {Scatter} scatter
 * @param {Figure | undefined} figure
 */
function cloud(scatter, figure) {
  const width = 360;
  const height = 236;
  const box = { left: 54, right: 12, top: 26, bottom: 40 };
  const { influence } = scatter;
  const known = (/** @type {(number | null)[]} */ values) => /** @type {number[]} */ (values.filter(v => v !== null));
  const range = (/** @type {number[]} */ values) => {
    const low = Math.min(...values);
    const high = Math.max(...values);
    const room = (high - low || Math.abs(high) || 1) * 0.04;
    return [low - room, high + room];
  };
  const [x0, x1] = range(known(scatter.x));
  const [y0, y1] = range(known(scatter.y));
  const x = (/** @type {number} */ v) => box.left + (v - x0) / (x1 - x0) * (width - box.left - box.right);
  const y = (/** @type {number} */ v) => height - box.bottom - (v - y0) / (y1 - y0) * (height - box.top - box.bottom);
  const across = ticksOf(x0, x1, 4);
  const up = ticksOf(y0, y1, 4);
  const grid = across.values.map(v => `<path d="M${px(x(v))} ${box.top}V${height - box.bottom}" class="grid"/>${label(x(v), height - box.bottom + 15, tickText(v, across.step), 'tick', 'middle')}`).join('')
    + up.values.map(v => `<path d="M${box.left} ${px(y(v))}H${width - box.right}" class="grid"/>${label(box.left - 6, y(v) + 4, tickText(v, up.step), 'tick', 'end')}`).join('');
  const points = scatter.x.map((v, k) => {
    const w = scatter.y[k];
    if (v === null || w === null) return '';
    return `<circle cx="${px(x(v))}" cy="${px(y(w))}" r="2.1" class="${scatter.passed[k] ? 'f-blue' : 'f-vermilion'}" fill-opacity=".45"/>`;
  }).join('');
  const unit = figure && figure.unit && figure.unit !== '1' ? `, ${figure.unit}` : '';
  const title = `<text x="${box.left}" y="14" class="bold">${escapeText(fitted(influence.figure, 210, 12.5))}<tspan class="note" font-weight="400">${escapeText(unit)}</tspan></text>${label(width - box.right, 14, `ρ = ${influence.correlation.toFixed(2)}`, 'note', 'end')}`;
  const below = label((box.left + width - box.right) / 2, height - 6, fitted(influence.drawn, width - box.left, 12), '', 'middle');
  return `<svg class="picture" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" aria-label="${escapeText(influence.figure)} against ${escapeText(influence.drawn)}">${title}${grid}${points}${below}</svg>`;
}

/**
 * @param {BatchData} data
 * @param {number} index of the variant
 */
function influenceSection(data, index) {
  const scatters = data.scatters[index] || [];
  const variant = data.summary.variants[index];
  if (scatters.length === 0) return '';
  const figureOf = (/** @type {string} */ name) => variant.figures.find(figure => figure.name === name);
  const clouds = scatters.map(scatter => cloud(scatter, figureOf(scatter.influence.figure))).join('');
  const failed = scatters.some(scatter => scatter.passed.includes(false)) && variant.success;
  return `<section aria-label="What matters"><h2>What the drawn values move most <small>ρ: rank correlation, 1 where one always rises with the other, −1 where it falls${failed ? '; red: trials that did not pass' : ''}</small></h2><div class="cells">${clouds}</div></section>`;
}

/**
 * @param {BatchData} data
 * @param {number} index of the variant
 */
function pictureSection(data, index) {
  const pictures = data.pictures.filter(picture => picture.variant === index);
  if (pictures.length === 0) return '';
  // As images: each picture has ids and a style sheet of its own.
  const figures = pictures.map(picture => `<figure><figcaption><b>${escapeText(picture.title)}</b>, trial ${picture.trial}<br><span class="quiet">${escapeText(picture.reason)}</span></figcaption><img alt="Arena with the path driven in trial ${picture.trial}" src="data:image/svg+xml;charset=utf-8,${encodeURIComponent(picture.svg)}"></figure>`).join('');
  return `<section aria-label="Trials"><h2>Trials worth a look <small>run once more, the same to the last bit</small></h2><div class="shots">${figures}</div></section>`;
}

/**
 * The variants side by side: success, and the mean of each figure with its difference to the first.
 * @param {BatchData} data
 */
function comparison(data) {
  const { variants } = data.summary;
  if (variants.length < 2) return '';
  const [first] = variants;
  const head = variants.map(variant => `<th class="right">${escapeText(variant.name)}</th>`).join('');
  const success = first.success ? `<tr><th scope="row">passed</th>${variants.map(({ success: s }) => `<td class="right">${s ? `${percent(s.share)}<br><small class="quiet">${percent(s.low)} to ${percent(s.high)}</small>` : ''}</td>`).join('')}<td></td></tr>` : '';
  const rows = first.figures.filter(figure => figure.group !== data.drawn).map(figure => {
    const cells = variants.map((variant, k) => {
      const own = variant.figures.find(f => f.name === figure.name);
      if (!own) return '<td class="right quiet">none</td>';
      const pair = k > 0 && variant.paired ? variant.paired.find(p => p.figure === figure.name) : undefined;
      const sign = pair && pair.mean > 0 ? '+' : '';
      const clear = pair && Math.abs(pair.mean) > pair.error;
      const difference = pair && (pair.mean !== 0 || pair.error !== 0) ? `<br><small class="${clear ? 'clear' : 'quiet'}">${sign}${significant(pair.mean, 3)} ± ${significant(pair.error, 2)}</small>` : '';
      return `<td class="right">${significant(own.mean, 4)}${difference}</td>`;
    }).join('');
    const spreads = variants.some(variant => { const own = variant.figures.find(f => f.name === figure.name); return own && own.quantiles[6] > own.quantiles[0]; });
    const unit = figure.unit && figure.unit !== '1' ? escapeText(figure.unit) : '';
    return spreads ? `<tr><th scope="row">${escapeText(shortName(figure))}</th>${cells}<td>${unit}</td></tr>` : '';
  }).join('');
  return `<section aria-label="Comparison"><h2>The variants compared <small>means over the trials; below, the mean difference to ${escapeText(first.name)} in the same trials with its 95 % interval, bold where it does not hold 0</small></h2><div class="wide"><table><thead><tr><th>figure</th>${head}<th>unit</th></tr></thead><tbody>${success}${rows}</tbody></table></div></section>`;
}

/** @param {number} value */
function percent(value) {
  const shown = 100 * value;
  return `${shown >= 99.95 || shown < 0.05 ? plain(Math.round(shown * 1000) / 1000) : shown.toFixed(1)} %`;
}

/**
 * @param {Variant} variant
 * @param {number} trials
 */
function sentenceOf({ success, verdicts }, trials) {
  const counts = Object.keys(verdicts).map(verdict => `${verdicts[verdict]} ${verdict}`).join(', ');
  return success
    ? `${percent(success.share)} of ${trials} trials passed; with 95 % confidence the share lies between ${percent(success.low)} and ${percent(success.high)}. (${counts})`
    : `${trials} trials without a task. (${counts})`;
}

/** @param {BatchData} data */
function batchHeader({ summary }) {
  const [first, ...others] = summary.variants;
  const sentence = others.length > 0 ? `${summary.variants.length} variants, ${summary.trials} trials each, with the same noise and the same draws.` : sentenceOf(first, summary.trials);
  return `<header><div><h1>${escapeText(summary.title || summary.scenario)}</h1><p>${escapeText(sentence)}</p><p class="quiet">seed ${summary.seed}${summary.precision === 'f32' ? ' · single precision (f32)' : ''}</p></div></header>`;
}

/**
 * @param {Variant} variant
 * @param {number} trials
 */
function failureTable({ failures }, trials) {
  if (failures.length === 0) return '';
  const rows = failures.slice(0, 20).map(([reason, count]) => `<tr><th scope="row">${escapeText(reason)}</th><td class="right">${count}</td><td class="right">${percent(count / trials)}</td></tr>`).join('');
  return `<section aria-label="Failures"><h2>Why trials failed <small>numbers within a reason as …</small></h2><div class="wide"><table><thead><tr><th>reason</th><th class="right">trials</th><th class="right">share</th></tr></thead><tbody>${rows}</tbody></table></div></section>`;
}

/**
 * The figures of a group: histograms of those that spread, then all as a table.
 * @param {BatchData} data
 * @param {Variant} variant
 * @param {string} group
 */
function groupOf(data, variant, group) {
  const figures = variant.figures.filter(figure => figure.group === group);
  const spread = figures.filter(figure => figure.quantiles[6] > figure.quantiles[0]);
  const several = variant.figures.some(figure => figure.group !== group && figure.group !== data.drawn);
  const heading = group === data.drawn ? 'Drawn values' : several ? group : 'Figures';
  const cells = spread.map(figure => histogram(figure, data.marks[figure.name])).join('');
  const value = (/** @type {number} */ v) => significant(v, 4);
  const marked = figures.some(figure => data.marks[figure.name] !== undefined);
  const rows = figures.map(figure => {
    const mark = data.marks[figure.name];
    const [least, low, , median, , high, most] = figure.quantiles;
    const cells = [figure.mean, figure.std, least, low, median, high, most].map(v => `<td class="right">${value(v)}</td>`).join('');
    const unit = figure.unit && figure.unit !== '1' ? figure.unit : '';
    return `<tr><th scope="row">${escapeText(shortName(figure))}</th>${cells}${marked ? `<td class="right t-vermilion">${mark === undefined ? '' : value(mark.value)}</td>` : ''}<td>${escapeText(unit)}</td><td class="right">${figure.count}</td></tr>`;
  }).join('');
  const head = ['mean', 'std', 'least', '5 %', 'median', '95 %', 'largest'].map(w => `<th class="right">${w}</th>`).join('');
  return `<section aria-label="${escapeText(heading)}"><h2>${escapeText(heading)}</h2><div class="cells">${cells}</div><details${spread.length === 0 ? ' open' : ''}><summary>as a table</summary><div class="wide"><table><thead><tr><th>figure</th>${head}${marked ? '<th class="right">marked</th>' : ''}<th>unit</th><th class="right">trials</th></tr></thead><tbody>${rows}</tbody></table></div></details></section>`;
}

/**
 * All about one variant.
 * @param {BatchData} data
 * @param {Variant} variant
 * @param {number} index
 */
function variantOf(data, variant, index) {
  /** @type {string[]} */
  const groups = [];
  for (const figure of variant.figures) if (!groups.includes(figure.group) && (index === 0 || figure.group !== data.drawn)) groups.push(figure.group);
  const several = data.summary.variants.length > 1;
  const title = several ? `<h1 class="variant">${escapeText(variant.name)}</h1><p>${escapeText(sentenceOf(variant, data.summary.trials))}</p>` : '';
  return `${title}${failureTable(variant, data.summary.trials)}\n${pictureSection(data, index)}\n${influenceSection(data, index)}\n${groups.map(group => groupOf(data, variant, group)).join('\n')}`;
}

/**
 * The body of a batch's report.
 * @param {BatchData} data
 */
export function batchBody(data) {
  const key = `<p class="quiet">Histograms: trials in each of 40 equal intervals. Thick line: the middle 90 %. Thin line: median.${data.marked ? ` Red line: the run of ${escapeText(data.marked)}, and the share of trials below it.` : ''}</p>`;
  const facts = [['version', `appell ${data.summary.version}`], ['seed', data.summary.seed], ['trials', data.summary.trials], ['precision', data.summary.precision]];
  const footer = `<footer><dl>${facts.map(([k, v]) => `<div><dt>${k}</dt><dd>${escapeText(v)}</dd></div>`).join('')}<div class="hash"><dt>hash</dt><dd>${escapeText(data.summary.hash)}</dd></div><div class="hash"><dt>root of the rows</dt><dd>${escapeText(data.summary.root)}</dd></div></dl></footer>`;
  const variants = data.summary.variants.map((variant, index) => variantOf(data, variant, index)).join('\n');
  return `<main class="batch">\n${batchHeader(data)}\n${key}\n${comparison(data)}\n${variants}\n<section aria-label="Scenario"><h2>Scenario <small>${escapeText(data.summary.scenario)}</small></h2><pre tabindex="0">${escapeText(data.text.trim())}</pre></section>${footer}\n</main>`;
}

/**
 * The title of the page, escaped.
 * @param {BatchData} data
 */
export function batchTitle(data) {
  return escapeText(`${data.summary.scenario}: ${data.summary.trials} trials · Appell`);
}
