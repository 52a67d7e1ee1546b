// The text of the report: everything that reads and prints without scripts.
//
// Pure: `reportBody` and `reportStyle` give the page's body and the part of its style sheet that
// the pictures need.

import { DARK, LIGHT, clamp, colorName, escapeText, niceStep, pathText, pictureStyle, plain, px, significant, simplify } from './draw.js';
import { indexAt, stateAt, tellingTime, tracksOf, valueAt } from './run.js';
import { arenaWidth, drawArena, drawCloseUp, drawGround, drawRobot, drawScaleBar, forceScale, reachOf, viewOf } from './arena.js';
import { drawPlots, panelOf } from './plot.js';

/** @typedef {import('./run.js').Run} Run */
/** @typedef {import('./run.js').Comparison} Comparison */
/** @typedef {import('./run.js').RobotState} RobotState */

/** Width of the report's text, px. */
export const PAGE_WIDTH = 1120;
/** Height of the arena's ground in the report, at most, px. */
export const ARENA_HEIGHT = 548;

/**
 * Sizes of the report's pictures: the close-up stands beside a narrow arena, else below.
 * @param {Run} run
 */
export function stageLayout(run) {
  const arena = arenaWidth(run, PAGE_WIDTH, ARENA_HEIGHT);
  const beside = PAGE_WIDTH - arena >= 280;
  const width = beside ? Math.min(PAGE_WIDTH - arena - 28, 640) : 520;
  return { arena, beside, width, height: beside ? clamp(width, 260, 320) : 290 };
}

/**
 * @param {string} inside
 * @param {number} width
 * @param {number} height
 * @param {string} attributes
 */
function picture(inside, width, height, attributes) {
  return `<svg class="picture" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" ${attributes}>${inside}</svg>`;
}

/** @param {string} status */
function verdictOf(status) {
  if (status === 'passed') return { className: 'passed', mark: 'M2 8l3.6 3.6L13 3.6' };
  if (status === 'failed') return { className: 'failed', mark: 'M3 3l9 9M12 3l-9 9' };
  return { className: 'stopped', mark: 'M3.5 3.5h8v8h-8z' };
}

/** @param {Run} run */
function header(run) {
  const { status, sentence } = run.verdict;
  const { className, mark } = verdictOf(status);
  const [robot, ...others] = run.robots;
  const model = robot && others.length === 0 ? [`level ${robot.level}`, `drive ${robot.drive}`] : [];
  const setup = [...model, run.scenario.integrator, `step ${plain(run.scenario.step * 1000)} ms`].filter(Boolean).join(' · ');
  return `<header><span class="badge ${className}"><svg width="15" height="15" viewBox="0 0 15 15" aria-hidden="true"><path d="${mark}"/></svg>${escapeText(status.toUpperCase())}</span><div><h1>${escapeText(run.scenario.title || run.scenario.name)}</h1><p>${escapeText(sentence)}</p><p class="quiet">${escapeText(setup)}</p></div></header>`;
}

/** @param {Run} run */
function eventTable(run) {
  if (run.events.length === 0) return '<p class="quiet">No events in this run.</p>';
  const detail = run.events.some(e => e.detail);
  const several = run.robots.length > 1;
  const shown = run.events.slice(0, 40);
  const rows = shown.map(e => `<tr><td><button type="button" class="number" data-time="${e.t}" aria-label="Go to event ${escapeText(e.n)} at ${e.t.toFixed(2)} s" disabled>${escapeText(e.n)}</button></td><td class="right">${e.t.toFixed(2)}</td><td>${several ? `<span class="quiet">${escapeText(e.robot)}</span> ` : ''}${escapeText(e.text)}</td>${detail ? `<td class="right">${e.detail ? escapeText(e.detail) : ''}</td>` : ''}</tr>`).join('');
  const more = run.events.length > shown.length ? `<p class="quiet">${run.events.length - shown.length} more in the recording.</p>` : '';
  return `<div class="scroll"><table class="events"><thead><tr><th><span class="hidden">number</span></th><th class="right">time, s</th><th>what</th>${detail ? '<th class="right"><span class="hidden">detail</span></th>' : ''}</tr></thead><tbody>${rows}</tbody></table></div>${more}`;
}

/**
 * @param {Run} run
 * @param {number} time of the still picture
 */
function stage(run, time) {
  const layout = stageLayout(run);
  const arena = drawArena(run, { width: PAGE_WIDTH, maxHeight: ARENA_HEIGHT, time });
  const names = run.arena.beacons.map(b => b.name);
  const seen = `Arena of ${plain(run.arena.size[0])} by ${plain(run.arena.size[1])} m${names.length > 0 ? ` with beacons ${names.join(', ')}` : ''}; path driven and robot at ${time.toFixed(2)} s`;
  const end = run.time.length > 0 ? run.time[run.time.length - 1] : 0;
  const robots = run.robots.length > 1 ? `<label class="which">robot <select id="which">${run.robots.map((r, i) => `<option value="${i}">${escapeText(r.name)}</option>`).join('')}</select></label>` : '';
  const heading = forceScale(run) > 0 ? 'Wheel forces' : 'Robot';
  const closeUp = run.robots.length > 0 ? drawCloseUp(run, 0, { width: layout.width, height: layout.height, time, id: 'close' }) : null;
  const close = closeUp ? `<div class="close"><h2 class="minor">${heading} <small>at <span class="now">${time.toFixed(2)}</span> s, seen from above</small>${robots}</h2>${picture(closeUp.svg, layout.width, closeUp.height, 'id="close" aria-label="Close-up of the robot, its wheels and the forces on them"')}</div>` : '';
  return `<section class="stage${layout.beside ? ' beside' : ''}" aria-label="Arena" style="--arena:${arena.width}px">
<div class="arena">${picture(arena.svg, arena.width, arena.height, `id="arena" aria-label="${escapeText(seen)}"`)}</div>
<div class="player" role="group" aria-label="Player" hidden><button type="button" id="play" class="main" title="Play or pause (space)"></button><button type="button" id="back" title="One sample back (left arrow; with shift a second)" aria-label="One sample back"><svg width="12" height="12" viewBox="0 0 12 12" aria-hidden="true"><path d="M8 2L4 6L8 10"/></svg></button><button type="button" id="forth" title="One sample on (right arrow; with shift a second)" aria-label="One sample on"><svg width="12" height="12" viewBox="0 0 12 12" aria-hidden="true"><path d="M4 2L8 6L4 10"/></svg></button><div class="scrub"><input type="range" id="scrub" min="0" max="${end}" step="any" value="${time}" aria-label="Time, s" title="Time (home and end go to its ends)"><svg id="rail" aria-hidden="true"></svg></div><output id="clock" for="scrub"><b class="now">${time.toFixed(2)}</b> / ${end.toFixed(2)} s</output><select id="speed" aria-label="Speed of the player" title="Speed of the player (down and up arrows)">${[0.1, 0.2, 0.5, 1, 2, 5, 10].map(v => `<option value="${v}"${v === 1 ? ' selected' : ''}>${v}×</option>`).join('')}</select></div>
<div class="happened"><h2 class="minor">Events</h2>${eventTable(run)}</div>
${close}
</section>`;
}

/** @param {Run} run */
function plots(run) {
  const panels = run.plots.map(spec => panelOf(run, spec)).filter(panel => panel !== null);
  if (panels.length === 0) return '';
  const drawn = drawPlots(panels, { width: PAGE_WIDTH, events: run.events });
  const names = panels.map(p => p.title).join(', ');
  return `<section class="what" aria-label="Plots"><h2>What happened <small>${run.events.length > 0 ? 'vertical lines: the events numbered above' : ''}</small><button type="button" id="unzoom" hidden>Whole run</button></h2><div class="plots">${picture(drawn.svg, drawn.width, drawn.height, `id="plots" aria-label="Plots over time: ${escapeText(names)}"`)}</div><p class="hint quiet" hidden>Drag over a span to zoom, double-click for the whole run, click to go to a time.</p></section>`;
}

/** @param {Run} run */
function metrics(run) {
  if (run.metrics.length === 0) return '';
  const half = Math.ceil(run.metrics.length / 2);
  const table = (/** @type {Run['metrics']} */ rows) => rows.length === 0 ? '' : `<table><tbody>${rows.map(m => `<tr><th scope="row">${escapeText(m.name)}</th><td class="right"><b>${typeof m.value === 'number' ? significant(m.value, m.digits) : escapeText(m.value === null ? '–' : m.value)}</b></td><td class="unit">${m.unit === '1' ? '' : escapeText(m.unit)}</td><td class="quiet">${escapeText(m.note || '')}</td></tr>`).join('')}</tbody></table>`;
  return `<section aria-label="Metrics"><h2>Metrics</h2><div class="metrics">${table(run.metrics.slice(0, half))}${table(run.metrics.slice(half))}</div></section>`;
}

/** @param {Run} run */
function statistics(run) {
  if (!run.statistics || run.statistics.length === 0) return '';
  const number = (/** @type {number | null} */ value, /** @type {number} */ digits) => value === null ? '–' : value.toFixed(digits).replace('-', '−');
  const table = (/** @type {Run['statistics'][number]} */ t) => `<table><thead><tr><th>${escapeText(t.name)}${t.samples > 0 ? ` <small>${t.samples} samples</small>` : ''}</th><th class="right">mean</th><th class="right">standard deviation</th><th></th></tr></thead><tbody>${t.rows.map(r => `<tr><th scope="row">${escapeText(r.signal)}</th><td class="right">${number(r.mean, t.decimals)}</td><td class="right">${number(r.std, t.decimals)}</td><td class="unit">${escapeText(r.unit)}</td></tr>`).join('')}</tbody></table>`;
  return `<section aria-label="Statistics"><h2>Statistics</h2><div class="metrics">${run.statistics.map(table).join('')}</div></section>`;
}

/**
 * Class and style of a compared run's line.
 * @param {Comparison['runs'][number]} run
 */
function lineOf(run) {
  const name = colorName(run.color);
  const plain = /^#[0-9a-f]{6}$/i.test(run.color || '') ? run.color : LIGHT.purple;
  return { color: name || 'ink', style: name ? undefined : `stroke:${plain}`, dash: run.dash ? '6 3' : '' };
}

/**
 * The compared runs at the instant where they differ most.
 * @param {Run} run
 * @param {Comparison} comparison
 */
function overlay(run, comparison) {
  const robot = run.robots[0];
  const width = 540;
  const height = 230;
  let at = 0;
  let most = -1;
  for (const d of comparison.distance) d.values.forEach((v, k) => { if (v > most) { most = v; at = d.time[k]; } });
  const runs = comparison.runs.filter(r => r.time.length > 0);
  if (!robot || runs.length === 0) return null;
  if (most < 0) at = Math.min(...runs.map(r => r.time[r.time.length - 1])) / 2;
  const states = runs.map(r => /** @type {RobotState} */ ({ ...stateAt(tracksOf({ ...run, time: [], signals: {} }, robot), robot, 0), x: valueAt(r.time, r.x, at), y: valueAt(r.time, r.y, at), yaw: valueAt(r.time, r.yaw, at) }));
  const reach = reachOf(robot) * 1.25;
  const xs = states.map(s => s.x);
  const ys = states.map(s => s.y);
  const scale = Math.min(width / (Math.max(...xs) - Math.min(...xs) + 2 * reach), height / (Math.max(...ys) - Math.min(...ys) + 2 * reach));
  const cx = (Math.max(...xs) + Math.min(...xs)) / 2;
  const cy = (Math.max(...ys) + Math.min(...ys)) / 2;
  const view = viewOf(scale, width / 2 - cx * scale, height / 2 + cy * scale);
  const far = { low: /** @type {[number, number]} */ ([cx - width / 2 / scale, cy - height / 2 / scale]), high: /** @type {[number, number]} */ ([cx + width / 2 / scale, cy + height / 2 / scale]) };
  const ground = drawGround(view, run, { bounds: far });
  const margin = 0.2 * width / scale;
  const trails = runs.map(r => {
    const line = lineOf(r);
    const last = indexAt(r.time, at);
    const points = r.x.slice(0, last + 1).map((x, k) => /** @type {[number, number]} */ (x > far.low[0] - margin && x < far.high[0] + margin && r.y[k] > far.low[1] - margin && r.y[k] < far.high[1] + margin ? [view.x(x), view.y(r.y[k])] : [NaN, NaN]));
    return `<path d="${pathText(simplify(points, 0.15))}" class="line s-${line.color}"${line.dash ? ` stroke-dasharray="${line.dash}"` : ''}${line.style ? ` style="${line.style}"` : ''}/>`;
  }).join('');
  const ghosts = runs.map((r, i) => {
    const line = lineOf(r);
    return drawRobot(view, robot, states[i], { ghost: `line s-${line.color}`, style: `${line.style || ''}${line.dash ? `;stroke-dasharray:${line.dash}` : ''}` });
  }).join('');
  const beacons = run.arena.beacons.map(b => `<circle cx="${px(view.x(b.position[0]))}" cy="${px(view.y(b.position[1]))}" r="${px(b.radius * scale)}" class="beacon"/>`).join('');
  const bar = niceStep(110 / scale, 1);
  const svg = `<clipPath id="compare-clip"><rect width="${width}" height="${height}" rx="8"/></clipPath><g clip-path="url(#compare-clip)">${ground.below}${ground.above}${beacons}${trails}${ghosts}${drawScaleBar(width - 14 - bar * scale, height - 14, bar, scale)}</g><rect x=".5" y=".5" width="${width - 1}" height="${height - 1}" rx="8" class="frame"/>`;
  return { at, svg: picture(svg, width, height, `aria-label="The compared runs at ${at.toFixed(2)} s"`), differ: most > 0 };
}

/** @param {Run} run */
function comparisonOf(run) {
  const { comparison } = run;
  if (!comparison || comparison.runs.length === 0) return '';
  const seen = overlay(run, comparison);
  const reference = comparison.runs[comparison.reference];
  const far = Math.max(0, ...comparison.distance.flatMap(d => d.values.length > 0 ? [d.values.reduce((a, b) => Math.max(a, b), 0)] : []));
  const fine = far < 1;
  const lines = comparison.distance.filter(d => comparison.runs[d.run]).slice(0, 6).map(d => {
    const line = lineOf(comparison.runs[d.run]);
    return { label: comparison.runs[d.run].label, color: line.color, style: line.style, dash: line.dash, time: d.time, values: fine ? d.values.map(v => v * 1000) : d.values };
  });
  const chart = lines.length > 0 ? drawPlots([{ title: `distance from ${reference ? reference.label : 'the reference'} at the same instant`, unit: fine ? 'mm' : 'm', lines, limits: [], markMin: false, markMax: false, more: 0 }], { width: 540, height: 200, id: 'distance' }) : null;
  const swatch = (/** @type {Comparison['runs'][number]} */ r) => {
    const line = lineOf(r);
    return `<svg class="picture swatch" width="24" height="8" viewBox="0 0 24 8" aria-hidden="true"><path d="M0 4H24" class="line s-${line.color}"${line.dash ? ` stroke-dasharray="${line.dash}"` : ''}${line.style ? ` style="${line.style}"` : ''}/></svg>`;
  };
  /** @type {string[]} */
  const columns = [];
  for (const r of comparison.runs) for (const key of Object.keys(r.metrics || {})) if (!columns.includes(key)) columns.push(key);
  const value = (/** @type {number | string | null | undefined} */ v) => v === null || v === undefined ? '<span class="quiet">not in model</span>' : typeof v === 'number' ? significant(v, Number.isInteger(v) ? undefined : Math.abs(v) < 1 ? 3 : 4) : escapeText(v);
  const rows = comparison.runs.map((r, i) => {
    const { className, mark } = verdictOf(r.status);
    return `<tr><th scope="row">${swatch(r)}${escapeText(r.label)}${i === comparison.reference ? ' <span class="quiet">(reference)</span>' : ''}</th><td class="status ${className}"><svg width="12" height="12" viewBox="0 0 15 15" aria-hidden="true"><path d="${mark}"/></svg>${escapeText(r.status)}</td>${columns.map(c => `<td class="right">${value((r.metrics || {})[c])}</td>`).join('')}</tr>`;
  }).join('');
  const left = seen ? `<figure><figcaption><b>the runs at ${seen.at.toFixed(2)} s</b>${seen.differ ? ', where they differ most' : ''}</figcaption>${seen.svg}</figure>` : '';
  const right = chart ? `<figure>${picture(chart.svg, chart.width, chart.height, `id="distance" aria-label="Distance between the runs over time"`)}</figure>` : '';
  return `<section class="comparison" aria-label="Comparison"><h2>The same task compared <small>${escapeText(comparison.note)}</small></h2><div class="two">${left}${right}</div><div class="wide"><table><thead><tr><th>run</th><th>verdict</th>${columns.map(c => `<th class="right">${escapeText(c)}</th>`).join('')}</tr></thead><tbody>${rows}</tbody></table></div></section>`;
}

/** @param {Run} run */
function scenario(run) {
  const s = run.scenario;
  const seconds = (/** @type {number} */ v) => v >= 1 ? `${plain(v)} s` : v >= 1e-3 ? `${plain(v * 1e3)} ms` : `${plain(v * 1e6)} µs`;
  const facts = [['version', `appell ${run.version}`], ['seed', s.seed], ['integrator', s.step > 0 ? `${s.integrator}, ${seconds(s.step)}` : s.integrator], ['recorded', s.recorded_period > 0 ? `every ${seconds(s.recorded_period)}` : 'every step']];
  return `<section aria-label="Scenario"><h2>Scenario <small>${escapeText(s.file)}</small></h2><pre tabindex="0">${escapeText(s.text.trim())}</pre></section><footer><dl>${facts.map(([k, v]) => `<div><dt>${k}</dt><dd>${escapeText(v)}</dd></div>`).join('')}<div class="hash"><dt>hash</dt><dd>${escapeText(s.hash)}</dd></div></dl></footer>`;
}

/**
 * The body of the report, static pictures included.
 * @param {Run} data
 */
export function reportBody(data) {
  const time = tellingTime(data);
  return `<main>\n${header(data)}\n${stage(data, time)}\n${plots(data)}\n${metrics(data)}\n${statistics(data)}\n${comparisonOf(data)}\n${scenario(data)}\n</main>`;
}

/**
 * The title of the report's page, escaped.
 * @param {Run} data
 */
export function reportTitle(data) {
  return escapeText(`${data.scenario.name}: ${data.verdict.status} · Appell`);
}

/** The report's colors in both themes and the style of its pictures: put before `report.css`. */
export function reportStyle() {
  const variables = (/** @type {Record<string, string>} */ palette) => Object.keys(palette).map(name => `--${name}:${palette[name]}`).join(';');
  return `:root{color-scheme:light;${variables(LIGHT)}}
@media screen and (prefers-color-scheme: dark){:root{color-scheme:dark;${variables(DARK)}}}
${pictureStyle(name => `var(--${name})`)}
`;
}
