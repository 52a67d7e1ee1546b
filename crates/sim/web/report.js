// The report's player: everything that moves once scripts run.
//
// Only the layers that move are drawn anew: robots and forces, cursors, and the end of the trail.

import { clamp, label, pathText, px, significant, textWidth } from './draw.js';
import { indexAt, readReportData, stateAt, tellingTime, tracksOf, valueAt } from './run.js';
import { closeUpPlace, drawArena, drawCloseUp, drawMoving, forceScale, forceWords, robotColor, speedLimit, trailPoints, trailRuns } from './arena.js';
import { drawPlots, panelOf } from './plot.js';
import { ARENA_HEIGHT, PAGE_WIDTH, stageLayout } from './report-body.js';

/** @typedef {import('./arena.js').View} View */
/** @typedef {import('./plot.js').PlotPicture} PlotPicture */
/** @typedef {import('./plot.js').Panel} Panel */

/** Brings the page to life; does nothing when the page holds no data. */
export function startReport() {
  const source = document.getElementById('data');
  const text = source && source.textContent;
  if (!text || text.length < 3) return;
  const run = readReportData(text);
  if (run.time.length === 0) return;
  const begin = run.time[0];
  const end = run.time[run.time.length - 1];
  const tracks = run.robots.map(robot => tracksOf(run, robot));
  const panels = /** @type {Panel[]} */ (run.plots.map(spec => panelOf(run, spec)).filter(panel => panel !== null));
  const newton = forceScale(run);
  const fastest = speedLimit(run);
  const layout = stageLayout(run);

  const arenaSvg = find('arena');
  const closeSvg = find('close');
  const plotSvg = find('plots');
  const scrub = /** @type {HTMLInputElement | null} */ (document.getElementById('scrub'));
  const rail = find('rail');
  const play = /** @type {HTMLButtonElement | null} */ (document.getElementById('play'));
  const speed = /** @type {HTMLSelectElement | null} */ (document.getElementById('speed'));
  const unzoom = document.getElementById('unzoom');
  const nows = [...document.querySelectorAll('.now')];
  const numbers = [.../** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll('button.number'))];
  const still = matchMedia('(prefers-reduced-motion: reduce)');

  let time = tellingTime(run);
  let shown = NaN;
  let playing = false;
  let touched = false;
  let last = 0;
  let followed = 0;
  /** @type {[number, number]} */
  let span = [begin, end];
  let hover = NaN;
  let asked = false;

  // Pictures that follow the width of the page ------------------------------------------------------

  /** @type {{ view: View, moving: Element, trails: ReturnType<typeof trailOf>[] } | null} */
  let arena = null;
  /** @type {{ view: View, middle: number, x: number, y: number, reach: number, paper: boolean, width: number, height: number, world: Element, moving: Element, words: Element, trails: ReturnType<typeof trailOf>[] } | null} */
  let close = null;
  /** @type {{ picture: PlotPicture, cursor: Element } | null} */
  let plots = null;
  let railWidth = 0;

  function layArena(/** @type {number} */ width, /** @type {boolean} */ paper) {
    if (!arenaSvg || run.robots.length === 0) return;
    const holder = /** @type {HTMLElement} */ (arenaSvg.parentElement);
    const maxHeight = width < 640 ? 620 : ARENA_HEIGHT;
    const room = paper ? width : Math.min(width, holder.clientWidth || width);
    if (Number(arenaSvg.getAttribute('data-room') || PAGE_WIDTH) !== room) {
      const picture = drawArena(run, { width: room, maxHeight, time, robots: false });
      fill(arenaSvg, picture.svg, picture.width, picture.height);
      arenaSvg.setAttribute('data-room', String(room));
      arena = { view: picture.view, moving: layer(arenaSvg, 'moving'), trails: [] };
    } else if (!arena) {
      // The static picture is drawn by the same text; its view follows from its size.
      const picture = drawArena(run, { width: PAGE_WIDTH, maxHeight: ARENA_HEIGHT, time, robots: false });
      arena = { view: picture.view, moving: layer(arenaSvg, 'moving'), trails: [] };
    }
    if (arena) arena.trails = run.robots.map((_, i) => trailOf(/** @type {Element} */ (arenaSvg), i, /** @type {View} */ (arena && arena.view)));
  }

  function layClose(/** @type {boolean} */ paper) {
    if (!closeSvg) return;
    const holder = /** @type {HTMLElement} */ (closeSvg.parentElement);
    const width = paper ? layout.width : Math.round(Math.min(holder.clientWidth || layout.width, 640));
    const height = layout.height;
    const picture = drawCloseUp(run, followed, { width, height, time, id: 'close', spare: 1 });
    const state = stateAt(tracks[followed], run.robots[followed], time);
    fill(closeSvg, picture.svg, width, picture.height);
    close = { view: picture.view, middle: picture.middle, x: state.x, y: state.y, reach: picture.reach, paper, width, height, world: layer(closeSvg, 'world'), moving: layer(closeSvg, 'moving'), words: layer(closeSvg, 'words'), trails: [] };
    close.trails = run.robots.map((_, i) => trailOf(closeSvg, i, picture.view, picture.bounds));
  }

  function layPlots(/** @type {number} */ width) {
    if (!plotSvg || panels.length === 0) return;
    const picture = drawPlots(panels, { width, events: run.events, t0: span[0], t1: span[1] });
    fill(plotSvg, picture.svg, picture.width, picture.height);
    // Cursors move over a picture of their own, so that the curves are not painted again.
    const cursor = /** @type {SVGSVGElement} */ (document.getElementById('cursor') || document.createElementNS('http://www.w3.org/2000/svg', 'svg'));
    cursor.id = 'cursor';
    cursor.setAttribute('class', 'picture');
    cursor.setAttribute('aria-hidden', 'true');
    fill(cursor, '', picture.width, picture.height);
    plotSvg.after(cursor);
    plots = { picture, cursor };
    if (unzoom) unzoom.hidden = span[0] <= begin && span[1] >= end;
  }

  function layRail() {
    if (!rail) return;
    railWidth = rail.clientWidth || 400;
    rail.setAttribute('viewBox', `0 0 ${railWidth} 32`);
    const ties = run.events.map(e => `M${px(railX(e.t))} 10v12`).join('');
    rail.innerHTML = `<path d="M8 16H${px(railWidth - 8)}" class="rail"/><path class="done"/><path d="${ties}" class="tie"/><circle cy="16" r="6.5" class="thumb"/>`;
  }

  const railX = (/** @type {number} */ t) => 8 + (end > begin ? (t - begin) / (end - begin) : 0) * (railWidth - 16);

  /**
   * A trail in pieces that are revealed up to an instant. Pieces carry their own casing, so that a
   * frame repaints one piece and not the whole path.
   * @param {Element} svg
   * @param {number} index
   * @param {View} view
   * @param {import('./arena.js').Bounds} [bounds] only what lies within
   */
  function trailOf(svg, index, view, bounds) {
    const group = /** @type {Element} */ (svg.querySelector(`[data-layer="trails"] [data-robot="${index}"]`));
    const runs = trailRuns(view, tracks[index], fastest, bounds);
    const own = robotColor(run, index);
    const whole = pathText(trailPoints(view, tracks[index], bounds));
    const casings = runs.map(r => `<path d="${r.path}" class="casing"/>`).join('');
    const bodies = runs.map(r => `<path d="${r.path}" ${own ? `class="s-${own}"` : `stroke="${r.color}"`}/>`).join('');
    group.innerHTML = `<path d="${whole}" class="rest"/><g>${casings}</g><g class="trail">${bodies}</g>`;
    const pieces = [...group.children[2].children].map((body, i) => [body, group.children[1].children[i]]);
    const { x, y, time: times } = tracks[index];
    const along = new Float64Array(times.length);
    for (let k = 1; k < times.length; k++) {
      const d = Math.hypot(Number(x[k]) - Number(x[k - 1]), Number(y[k]) - Number(y[k - 1]));
      along[k] = along[k - 1] + (Number.isFinite(d) ? d : 0);
    }
    return { pieces, along, runs, at: pieces.length, times };
  }

  /**
   * Shows a trail up to time `t`: pieces before it whole, the one at it in part.
   * @param {ReturnType<typeof trailOf>} trail
   * @param {number} t
   */
  function reveal(trail, t) {
    const { pieces, runs, along, times } = trail;
    // `at` counts the pieces that begin before t.
    let low = 0;
    let high = runs.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[runs[middle].first] < t) low = middle + 1; else high = middle;
    }
    if (trail.at > 0) for (const path of pieces[trail.at - 1]) path.removeAttribute('stroke-dasharray');
    for (let i = low; i < trail.at; i++) for (const path of pieces[i]) path.setAttribute('display', 'none');
    for (let i = trail.at; i < low; i++) for (const path of pieces[i]) path.removeAttribute('display');
    trail.at = low;
    if (low === 0) return;
    const { first, last: end } = runs[low - 1];
    const k = indexAt(times, t);
    const next = Math.min(k + 1, times.length - 1);
    const f = next > k ? clamp((t - times[k]) / (times[next] - times[k]), 0, 1) : 0;
    const length = along[end] - along[first];
    const part = length > 0 ? (along[k] + (along[next] - along[k]) * f - along[first]) / length : 1;
    if (part >= 1) return;
    for (const path of pieces[low - 1]) {
      path.setAttribute('pathLength', '1');
      path.setAttribute('stroke-dasharray', `${Math.max(part, 0).toFixed(4)} 2`);
    }
  }

  // One frame ---------------------------------------------------------------------------------------

  function show() {
    asked = false;
    if (time !== shown) {
      shown = time;
      const until = touched ? time : end;
      if (arena) {
        arena.moving.innerHTML = drawMoving(arena.view, run, tracks, time, { scale: newton });
        for (const trail of arena.trails) reveal(trail, until);
      }
      const state = close && stateAt(tracks[followed], run.robots[followed], time);
      // The world under the close-up is drawn for a neighborhood, and anew when the robot leaves it.
      if (close && state && Math.hypot(state.x - close.x, state.y - close.y) > close.reach) layClose(close.paper);
      if (close && state) {
        close.world.setAttribute('transform', closeUpPlace(close.view, state, close.middle, close.width, close.height));
        close.moving.innerHTML = drawMoving(close.view, run, tracks, time, { scale: newton, head: 11, only: followed });
        for (const trail of close.trails) reveal(trail, time);
        const words = forceWords(run, run.robots[followed], state);
        const notes = close.words.querySelectorAll('.note');
        words.forEach((word, i) => { if (notes[i]) notes[i].textContent = word.text; });
      }
      for (const now of nows) now.textContent = time.toFixed(2);
      if (scrub) { scrub.value = String(time); scrub.setAttribute('aria-valuetext', `${time.toFixed(2)} seconds`); }
      if (rail) {
        const x = px(railX(time));
        rail.children[1].setAttribute('d', `M8 16H${x}`);
        rail.children[3].setAttribute('cx', x);
      }
      for (const n of numbers) {
        const row = n.closest('tr');
        const place = !touched || Number(n.dataset.time) <= time + 1e-9 ? 'past' : 'ahead';
        if (row && row.className !== place) row.className = place;
      }
    }
    drawCursor();
  }

  function ask() {
    if (!asked) { asked = true; requestAnimationFrame(show); }
  }

  function drawCursor() {
    if (!plots) return;
    const { frame } = plots.picture;
    const x = (/** @type {number} */ t) => frame.left + (t - frame.t0) / (frame.t1 - frame.t0) * (frame.right - frame.left);
    const inside = (/** @type {number} */ t) => t >= frame.t0 - 1e-9 && t <= frame.t1 + 1e-9;
    let svg = selecting ? `<rect x="${px(Math.min(selecting.from, selecting.to))}" y="${px(frame.panels[0].top)}" width="${px(Math.abs(selecting.to - selecting.from))}" height="${px(frame.bottom - frame.panels[0].top)}" class="select"/>` : '';
    const read = Number.isFinite(hover) ? hover : time;
    for (const t of Number.isFinite(hover) ? [time, hover] : [time]) {
      if (!inside(t)) continue;
      svg += `<path d="${frame.panels.map(p => `M${px(x(t))} ${px(p.top)}v${px(p.height)}`).join('')}" class="${t === hover ? 'hover' : 'cursor'}"/>`;
    }
    if (inside(read)) {
      panels.forEach((panel, i) => {
        const p = frame.panels[i];
        let right = frame.right;
        for (const line of [...panel.lines].reverse()) {
          const value = valueAt(line.time, line.values, read);
          if (!Number.isFinite(value)) continue;
          const y = p.top + p.height - (value - p.low) / (p.high - p.low) * p.height;
          if (y > p.top - 2 && y < p.top + p.height + 2) svg += `<circle cx="${px(x(read))}" cy="${px(y)}" r="3.2" class="knob s-${line.color}"/>`;
          const words = (panel.lines.length > 1 && frame.right > 600 ? `${line.label} ` : '') + significant(value * p.factor, 3);
          const width = textWidth(words, 12) + 14;
          if (right - width < p.title + 8) continue;
          svg += label(right, p.top - 8, words, `bold ${line.color === 'ink' ? '' : line.color === 'reference' ? 'note' : `t-${line.color}`}`, 'end');
          right -= width;
        }
      });
      const chip = `${read.toFixed(2)} s`;
      const half = textWidth(chip, 11) / 2 + 7;
      const cx = clamp(x(read), frame.left + half - 20, frame.right - half + 5);
      svg += `<rect x="${px(cx - half)}" y="${px(frame.bottom + 4)}" width="${px(2 * half)}" height="18" rx="4" class="chip"/>${label(cx, frame.bottom + 17, chip, 'chip-text', 'middle')}`;
    }
    plots.cursor.innerHTML = svg;
  }

  // Player ------------------------------------------------------------------------------------------

  const playIcon = '<svg width="11" height="12" viewBox="0 0 11 12" aria-hidden="true"><path d="M1 .5L10.5 6L1 11.5Z"/></svg>Play';
  const pauseIcon = '<svg width="11" height="12" viewBox="0 0 11 12" aria-hidden="true"><path d="M1 .5h3v11h-3zM7 .5h3v11h-3z"/></svg>Pause';

  function go(/** @type {number} */ t) {
    time = clamp(t, begin, end);
    touched = true;
    ask();
  }

  function toggle(/** @type {boolean} */ on) {
    playing = on && end > begin;
    if (play) play.innerHTML = playing ? pauseIcon : playIcon;
    if (!playing) return;
    touched = true;
    if (time >= end) time = begin;
    last = performance.now();
    requestAnimationFrame(tick);
  }

  function tick(/** @type {number} */ now) {
    if (!playing) return;
    const rate = speed ? Number(speed.value) : 1;
    // A page in the background sleeps; it must not leap when it wakes.
    time += Math.min(0.1, Math.max(0, (now - last) / 1000)) * rate;
    last = now;
    // With reduced motion the picture changes four times a second instead of flowing.
    if (!still.matches || Math.floor(now / 250) !== beat || time >= end) {
      beat = Math.floor(now / 250);
      if (time >= end) { time = end; toggle(false); }
      show();
    }
    if (playing) requestAnimationFrame(tick);
  }
  let beat = 0;

  function step(/** @type {number} */ by) {
    toggle(false);
    const k = indexAt(run.time, time + 1e-9);
    go(run.time[clamp(by < 0 && run.time[k] < time - 1e-9 ? k : k + by, 0, run.time.length - 1)]);
  }

  function pace(/** @type {number} */ by) {
    if (speed) speed.selectedIndex = clamp(speed.selectedIndex + by, 0, speed.options.length - 1);
  }

  // Plots under the pointer -------------------------------------------------------------------------

  /** @type {{ from: number, to: number, id: number } | null} */
  let selecting = null;

  /** @param {PointerEvent | MouseEvent} event */
  function pointerX(event) {
    if (!plotSvg || !plots) return 0;
    const box = plotSvg.getBoundingClientRect();
    return clamp((event.clientX - box.left) * plots.picture.width / box.width, plots.picture.frame.left, plots.picture.frame.right);
  }

  function timeOf(/** @type {number} */ x) {
    if (!plots) return begin;
    const { left, right, t0, t1 } = plots.picture.frame;
    return t0 + (x - left) / (right - left) * (t1 - t0);
  }

  function zoom(/** @type {number} */ t0, /** @type {number} */ t1) {
    span = [Math.max(begin, Math.min(t0, t1)), Math.min(end, Math.max(t0, t1))];
    if (plots) layPlots(plots.picture.width);
    ask();
  }

  if (plotSvg) {
    plotSvg.addEventListener('pointerdown', event => {
      if (event.button !== 0 || event.pointerType === 'touch') return;
      selecting = { from: pointerX(event), to: pointerX(event), id: event.pointerId };
      plotSvg.setPointerCapture(event.pointerId);
    });
    plotSvg.addEventListener('pointermove', event => {
      hover = timeOf(pointerX(event));
      if (selecting) selecting.to = pointerX(event);
      ask();
    });
    plotSvg.addEventListener('pointerup', () => {
      const chosen = selecting;
      selecting = null;
      if (!chosen) return;
      if (Math.abs(chosen.to - chosen.from) > 6) zoom(timeOf(chosen.from), timeOf(chosen.to));
      else go(timeOf(chosen.to));
    });
    plotSvg.addEventListener('pointercancel', () => { selecting = null; ask(); });
    plotSvg.addEventListener('pointerleave', () => { hover = NaN; ask(); });
    plotSvg.addEventListener('click', event => { if (/** @type {PointerEvent} */ (event).pointerType === 'touch') go(timeOf(pointerX(event))); });
    plotSvg.addEventListener('dblclick', () => zoom(begin, end));
  }
  if (unzoom) unzoom.addEventListener('click', () => zoom(begin, end));

  // A click in the arena goes to the nearest instant of a path.
  if (arenaSvg) {
    arenaSvg.addEventListener('click', event => {
      if (!arena) return;
      const box = arenaSvg.getBoundingClientRect();
      const f = arenaSvg.viewBox.baseVal.width / box.width;
      const cx = (event.clientX - box.left) * f;
      const cy = (event.clientY - box.top) * f;
      let nearest = 30;
      let at = NaN;
      for (const track of tracks) {
        track.x.forEach((x, k) => {
          const d = arena ? Math.hypot(arena.view.x(Number(x)) - cx, arena.view.y(Number(track.y[k])) - cy) : Infinity;
          if (d < nearest) { nearest = d; at = track.time[k]; }
        });
      }
      if (Number.isFinite(at)) go(at);
    });
  }

  // Controls ----------------------------------------------------------------------------------------

  const on = (/** @type {string} */ id, /** @type {() => void} */ act) => { const e = document.getElementById(id); if (e) e.addEventListener('click', act); };
  on('play', () => toggle(!playing));
  on('back', () => step(-1));
  on('forth', () => step(1));
  if (scrub) { scrub.min = String(begin); scrub.max = String(end); scrub.addEventListener('input', () => { toggle(false); go(Number(scrub.value)); }); }
  for (const n of numbers) {
    n.disabled = false;
    n.addEventListener('click', () => { toggle(false); go(Number(n.dataset.time)); });
  }
  const which = /** @type {HTMLSelectElement | null} */ (document.getElementById('which'));
  if (which) which.addEventListener('change', () => { followed = Number(which.value); layClose(false); shown = NaN; ask(); });

  addEventListener('keydown', event => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const target = /** @type {HTMLElement} */ (event.target);
    if (target.tagName === 'SELECT' || (target.tagName === 'BUTTON' && event.key === ' ')) return;
    if (target.tagName === 'PRE' && event.key !== ' ') return;
    /** @type {Record<string, () => void>} */
    const keys = {
      ' ': () => toggle(!playing),
      ArrowLeft: () => event.shiftKey ? go(time - 1) : step(-1),
      ArrowRight: () => event.shiftKey ? go(time + 1) : step(1),
      Home: () => go(begin),
      End: () => go(end),
    };
    // Up and down scroll the page unless the player has the focus.
    if (target.closest('.player')) { keys.ArrowUp = () => pace(1); keys.ArrowDown = () => pace(-1); }
    else if (event.key === 'Home' || event.key === 'End') { if (!target.closest('.stage, .what')) return; }
    const act = keys[event.key];
    if (act) { event.preventDefault(); act(); }
  });

  // Start, and follow the page's width ----------------------------------------------------------------

  function lay(/** @type {boolean} */ paper) {
    const main = document.querySelector('main');
    const width = paper ? PAGE_WIDTH : Math.round(main ? main.clientWidth : PAGE_WIDTH);
    layArena(width, paper);
    layClose(paper);
    layPlots(width);
    layRail();
    shown = NaN;
    show();
  }

  document.documentElement.classList.add('live');
  for (const e of document.querySelectorAll('.player, .hint')) /** @type {HTMLElement} */ (e).hidden = false;
  toggle(false);
  lay(false);
  let before = innerWidth;
  addEventListener('resize', () => { if (innerWidth !== before) { before = innerWidth; lay(false); } });
  addEventListener('beforeprint', () => { toggle(false); lay(true); });
  addEventListener('afterprint', () => lay(false));
}

/** @param {string} id @returns {SVGSVGElement | null} */
function find(id) {
  return /** @type {SVGSVGElement | null} */ (/** @type {unknown} */ (document.getElementById(id)));
}

/** @param {Element} svg @param {string} name @returns {Element} */
function layer(svg, name) {
  return /** @type {Element} */ (svg.querySelector(`[data-layer="${name}"]`));
}

/** @param {SVGSVGElement} svg @param {string} inside @param {number} width @param {number} height */
function fill(svg, inside, width, height) {
  svg.innerHTML = inside;
  svg.setAttribute('viewBox', `0 0 ${width} ${height}`);
  svg.setAttribute('width', String(width));
  svg.setAttribute('height', String(height));
}

if (typeof document !== 'undefined') startReport();
