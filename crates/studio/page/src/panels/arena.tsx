// The arena: the report's drawing in a window that pans, zooms and follows, with what runs along.

import { useEffect, useRef, useState } from 'preact/hooks';
import { drawArrow, drawBeacons, drawDownhill, drawGoal, drawGround, drawMoving, drawOrigin, drawRobot, drawScaleBar, drawTerrain, gridSteps, reachOf, robotColor, trailPoints, trailRuns, viewOf } from '../../../../sim/web/arena.js';
import { clamp, eventMark, label, multiples, niceStep, pathText, plain, px, simplify, tickText } from '../../../../sim/web/draw.js';
import { indexAt, stateAt, type Tracks } from '../../../../sim/web/run.js';
import { componentPanel, eachPicture, type ViewProps } from '../panel';
import { Shade, SPEED, TIME } from '../shade';
import type { Line } from '../net';
import type { Studio } from '../studio';
import { saveArena } from '../save';
import { tr } from '../words';

/** Pieces of trails before they are joined. */
const PIECES_MAX = 1200;
/** A velocity is drawn as the way of so long, s, for so many robots at most. */
const AHEAD = 0.5, VELOCITIES_MAX = 12;

type View = ReturnType<typeof viewOf>;
type Drag = { beacon: string | null; moved: boolean; x: number; y: number; gesture: number };

type Props = Pick<Studio, 'link' | 'line' | 'others' | 'time' | 'follow' | 'setFollow' | 'measuring' | 'forces' | 'placing'> & {
  onBeacon: (name: string, x: number, y: number, gesture: number) => void; onGround: (x: number, y: number) => void; onSeek: (t: number) => void;
  /** What colors the trail: a signal of the first robot, or its speed. */
  shade: string; fail: (error: unknown) => void;
};

export function Arena(props: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const latest = useRef(props);
  latest.current = props;
  const [size, setSize] = useState<[number, number]>([800, 600]);
  const [ruler, setRuler] = useState<[number, number][]>([]);
  const rulerNow = useRef(ruler);
  rulerNow.current = ruler;
  const dirty = useRef(true);
  // A drag of a beacon makes new lines: window and drag outlive them.
  const kept = useRef<{ view: View; drag: Drag | null; follow: string }>({ view: viewOf(100, 0, 0), drag: null, follow: 'fit' });

  useEffect(() => { dirty.current = true; }, [props.line, props.follow, props.others.map(o => o.line.id).join(), size, props.forces, ruler, props.measuring]);
  useEffect(() => { if (!props.measuring) setRuler([]); }, [props.measuring]);

  useEffect(() => {
    const element = holder.current;
    if (!element) return;
    const watch = new ResizeObserver(() => setSize([element.clientWidth, element.clientHeight]));
    watch.observe(element);
    return () => watch.disconnect();
  }, []);

  useEffect(() => {
    const root = holder.current;
    if (!root) return;
    const svg = root.querySelector('svg') as SVGSVGElement;
    const layer = (name: string) => svg.querySelector(`[data-layer="${name}"]`) as SVGGElement;
    const layers = { ground: layer('ground'), others: layer('others'), trail: layer('trail'), top: layer('top'), moving: layer('moving'), rim: layer('rim') };
    let view: View = kept.current.view;
    let shown = { time: NaN, rows: -1, trail: -1, until: -1, newton: 0, scaled: 0, follow: kept.current.follow, events: 0 };
    const shade = new Shade(props.link, props.line, props.shade);

    const fit = (width: number, height: number) => {
      const { run } = latest.current.line;
      const [w, h] = run.arena.size;
      // Beside or below the card in the corner, whichever leaves more; above the legend.
      const card = root.parentElement?.querySelector('.who') as HTMLElement | null;
      const legend = root.parentElement?.querySelector('.legend') as HTMLElement | null;
      const foot = height - (legend ? height - legend.offsetTop + 10 : 40);
      const [right, bottom] = card ? [card.offsetLeft + card.offsetWidth + 34, card.offsetTop + card.offsetHeight + 10] : [46, 50];
      const windows = [[46, Math.max(50, bottom), width - 20, foot], [right, 54, width - 20, foot]];
      const scales = windows.map(([x0, y0, x1, y1]) => Math.min((x1 - x0) / w, (y1 - y0) / h));
      const best = scales[0] >= scales[1] ? 0 : 1;
      const scale = Math.max(1, scales[best]);
      const [x0, y0, x1, y1] = windows[best];
      return viewOf(scale, (x0 + x1 - w * scale) / 2, (y0 + y1 + h * scale) / 2);
    };

    const ground = (width: number, height: number) => {
      const { run } = latest.current.line;
      const low: [number, number] = [(0 - view.x(0)) / view.scale, (view.y(0) - height) / view.scale];
      const high: [number, number] = [(width - view.x(0)) / view.scale, view.y(0) / view.scale];
      const { below, above } = drawGround(view, run, { bounds: { low, high } });
      const terrain = drawTerrain(view, run, 'arena');
      const goals = [...new Set(run.robots.map(robot => drawGoal(view, run, robot)))].join('');
      const paths = run.robots.map(robot => robot.path && robot.path.length > 1 ? `<path d="${pathText(simplify(robot.path.map(p => [view.x(p[0]), view.y(p[1])]), 0.15))}" class="ref"/>` : '').join('');
      layers.ground.innerHTML = below + terrain.svg + above + drawOrigin(view) + goals + paths;
      layers.top.innerHTML = drawBeacons(view, run) + run.events.slice(0, 60).map(event => {
        if (!event.position) return '';
        const x = view.x(event.position[0]), y = view.y(event.position[1]);
        // Not where the name of a beacon stands.
        const isTaken = run.arena.beacons.some(b => Math.abs(view.x(b.position[0]) - x - 15) < 30 && Math.abs(view.y(b.position[1]) + b.radius * view.scale + 14 - y + 17) < 18);
        return `<circle cx="${px(x)}" cy="${px(y)}" r="3" class="dot"/>${eventMark(x + 15, y + (isTaken ? 17 : -17), event.n)}`;
      }).join('');
      // Numbers along the rims of the window.
      const { numbers } = gridSteps(view.scale);
      let rim = '';
      const card = root.parentElement?.querySelector('.who') as HTMLElement | null;
      const under = card ? card.offsetTop + card.offsetHeight + 12 : 24;
      const [w, h] = run.arena.size;
      for (const x of multiples(Math.max(0, low[0]), Math.min(w, high[0]), numbers)) if (view.x(x) > 46 && view.x(x) < width - 30) rim += label(view.x(x) + 4, height - 7, tickText(x, numbers) + ' m', 'tick halo');
      for (const y of multiples(Math.max(0, low[1]), Math.min(h, high[1]), numbers)) if (view.y(y) > under && view.y(y) < height - 66) rim += label(6, view.y(y) - 4, tickText(y, numbers) + ' m', 'tick halo');
      const bar = niceStep(120 / view.scale, 1);
      const scaleBar = root.parentElement?.querySelector('[data-bar]');
      if (scaleBar) {
        scaleBar.setAttribute('width', String(Math.ceil(bar * view.scale) + 4));
        scaleBar.innerHTML = drawScaleBar(2, 24, bar, view.scale);
      }
      const points = rulerNow.current;
      if (points.length > 0) {
        const at = points.map(p => [view.x(p[0]), view.y(p[1])]);
        rim += `<path d="M${at.map(p => `${px(p[0])} ${px(p[1])}`).join('L')}" class="ruler"/>` + at.map(p => `<circle cx="${px(p[0])}" cy="${px(p[1])}" r="4" class="ruler-end"/>`).join('');
        const degrees = (radians: number) => `${(radians * 180 / Math.PI).toFixed(1)}°`.replace('-', '−');
        for (let k = 1; k < points.length; k++) {
          const [dx, dy] = [points[k][0] - points[k - 1][0], points[k][1] - points[k - 1][1]];
          rim += label((at[k - 1][0] + at[k][0]) / 2 + 8, (at[k - 1][1] + at[k][1]) / 2 - 10, `${Math.hypot(dx, dy).toFixed(3)} m${points.length === 2 ? `, ${degrees(Math.atan2(dy, dx))}` : ''}`, 'bold halo');
        }
        if (points.length === 3) {
          const [a, b] = [points[0], points[2]].map(p => Math.atan2(p[1] - points[1][1], p[0] - points[1][0]));
          const turn = Math.abs(Math.atan2(Math.sin(b - a), Math.cos(b - a)));
          rim += label(at[1][0] + 12, at[1][1] + 20, `∠ ${degrees(turn)}`, 'bold halo');
        }
      }
      layers.rim.innerHTML = rim;
      layers.others.innerHTML = latest.current.others.map(({ line, color, dash }) => line.tracks.map(tracks => `<path d="${pathText(trailPoints(view, tracks))}" class="other s-${color}"${dash ? ' stroke-dasharray="6 5"' : ''}/>`).join('')).join('');
    };

    const trail = (from: number) => {
      const { line } = latest.current;
      line.run.robots.forEach((_, i) => {
        const all = line.tracks[i];
        const part = piece(all, from, all.time.length);
        const own = robotColor(line.run, i);
        const runs = trailRuns(view, part, 1, undefined, shade.color);
        const casing = `<path d="${pathText(trailPoints(view, part))}" class="casing"/>`;
        const body = runs.map(r => `<path d="${r.path}" ${own ? `class="s-${own}"` : `stroke="${r.color}"`}/>`).join('');
        const group = document.createElementNS('http://www.w3.org/2000/svg', 'g');
        group.innerHTML = casing + `<g class="trail">${body}</g>`;
        layers.trail.append(group);
      });
    };

    // A stretch of tracks, with what colors it, between 0 and 1, in the place of its speed.
    const piece = (all: Tracks, from: number, until: number): Tracks => ({
      ...all, time: all.time.slice(from, until), x: all.x.slice(from, until), y: all.y.slice(from, until), speed: all.time.slice(from, until).map((_, k) => shade.part(all, from + k)),
    });

    const stop = eachPicture(props.fail, () => {
      const { line, others, follow, time, forces } = latest.current;
      const width = root.clientWidth, height = root.clientHeight;
      const t = time();
      const rows = line.run.time.length;
      if (rows === 0) return;
      let moved = dirty.current;
      if (dirty.current && follow === 'fit') view = fit(width, height);
      if (follow === 'follow') {
        const s = stateAt(line.tracks[0], line.run.robots[0], t);
        // From afar one comes near enough to see the forces.
        const near = 0.085 * Math.min(width, height) / reachOf(line.run.robots[0]);
        const scale = shown.follow === 'fit' ? Math.max(view.scale, near) : view.scale;
        const next = viewOf(scale, width / 2 - s.x * scale, height / 2 + s.y * scale);
        if (Math.abs(next.x(0) - view.x(0)) + Math.abs(next.y(0) - view.y(0)) > 0.3 || next.scale !== view.scale) { view = next; moved = true; }
      }
      shown.follow = follow;
      if (rows < shown.rows || line.run.events.length !== shown.events) moved = true;
      shown.events = line.run.events.length;
      // Scales follow the run, but not at every frame.
      if (moved || rows - shown.scaled > 25 || shade.isNew) {
        shown.newton = line.forceScale;
        const length = shown.newton * view.scale, newtons = niceStep(34 / length, 1);
        const example = root.parentElement?.querySelector('[data-newtons]');
        if (example && length > 0) {
          const arrow = (y: number, name: string) => { const [shaft, head] = drawArrow(0, y, newtons * length, y, 7) ?? ['', '']; return `<path d="${shaft}" class="force s-${name}"/><path d="${head}" class="f-${name}"/>`; };
          const svg = example.querySelector('svg') as SVGSVGElement;
          svg.setAttribute('width', String(Math.ceil(newtons * length)));
          svg.innerHTML = arrow(4, 'blue') + arrow(12, 'vermilion');
          (example.querySelector('b') as HTMLElement).textContent = `${plain(newtons)} N`;
        }
        if (shade.scale()) moved = true;
        shown.scaled = rows;
        const legend = root.parentElement?.querySelector('[data-shade]');
        if (legend) {
          (legend.querySelector('i') as HTMLElement).style.background = shade.gradient();
          const [low, high] = legend.querySelectorAll('b');
          low.textContent = plain(shade.low).replace('-', '−');
          high.textContent = plain(shade.high);
        }
      }
      const grown = rows !== shown.rows;
      if (!moved && !grown && t === shown.time) return;
      const until = indexAt(line.run.time, t);
      if (moved) {
        ground(width, height);
        layers.trail.innerHTML = '';
        shown.trail = 0;
        dirty.current = false;
      } else if (grown && others.length > 0) {
        layers.others.innerHTML = others.map(({ line, color, dash }) => line.tracks.map(tracks => `<path d="${pathText(trailPoints(view, tracks))}" class="other s-${color}"${dash ? ' stroke-dasharray="6 5"' : ''}/>`).join('')).join('');
      }
      // Pieces are added as it grows, less often for many robots, and joined when they have become many.
      const many = 3 + line.run.robots.length / 2;
      if (rows - shown.trail >= 2 && (moved || rows - shown.trail > many || !grown)) {
        if (layers.trail.childElementCount > PIECES_MAX) { layers.trail.innerHTML = ''; shown.trail = 0; }
        trail(Math.max(0, shown.trail - 1));
        shown.trail = rows;
      }
      // What is ahead of the time that is looked at is faint.
      layers.trail.style.opacity = until < rows - 2 ? '0.35' : '';
      let svg = '';
      if (until < rows - 2) line.run.robots.forEach((_, i) => {
        const part = piece(line.tracks[i], 0, until + 1);
        const own = robotColor(line.run, i);
        svg += `<g class="trail">${trailRuns(view, part, 1, undefined, shade.color).map(r => `<path d="${r.path}" ${own ? `class="s-${own}"` : `stroke="${r.color}"`}/>`).join('')}</g>`;
      });
      for (const other of others) other.line.run.robots.forEach((robot, i) => { svg += drawRobot(view, robot, stateAt(other.line.tracks[i], robot, t), { ghost: `ghost-line s-${other.color}` }); });
      svg += drawMoving(view, line.run, line.tracks, t, { scale: forces ? shown.newton : 0 });
      if (forces && line.run.robots.length <= VELOCITIES_MAX) line.run.robots.forEach((robot, i) => {
        const own = `robot.${robot.name}.twist.`, s = stateAt(line.tracks[i], robot, t);
        const [u, w] = [line.at(own + 'forward', t) || 0, line.at(own + 'left', t) || 0].map(v => v * AHEAD * view.scale);
        const x = view.x(s.x), y = view.y(s.y);
        const arrow = Math.hypot(u, w) > 8 ? drawArrow(x, y, x + u * Math.cos(s.yaw) - w * Math.sin(s.yaw), y - u * Math.sin(s.yaw) - w * Math.cos(s.yaw), 8) : null;
        if (arrow) svg += `<path d="${arrow[0]}" class="velocity"/><path d="${arrow[1]}" class="f-ink"/>`;
      });
      // The instantaneous center of rotation of a single robot, where it is in the window.
      if (line.run.robots.length === 1) {
        const own = `robot.${line.run.robots[0].name}.`;
        const s = stateAt(line.tracks[0], line.run.robots[0], t);
        const yaw = line.at(own + 'twist.yaw_rate', t), v = line.at(own + 'twist.forward', t), left = line.at(own + 'twist.left', t) || 0;
        if (Math.abs(yaw) > 0.02) {
          const [u, w] = [-left / yaw, v / yaw];
          const x = view.x(s.x + u * Math.cos(s.yaw) - w * Math.sin(s.yaw)), y = view.y(s.y + u * Math.sin(s.yaw) + w * Math.cos(s.yaw));
          if (x > 0 && y > 0 && x < width && y < height) svg += `<path d="M${px(x)} ${px(y)}L${px(view.x(s.x))} ${px(view.y(s.y))}" class="icr-line"/><circle cx="${px(x)}" cy="${px(y)}" r="4.5" class="icr"><title>instantaneous center of rotation</title></circle>`;
        }
      }
      layers.moving.innerHTML = svg;
      shown = { ...shown, time: t, rows, until };
    });

    // Hands ---------------------------------------------------------------------------------------
    const place = (event: PointerEvent | WheelEvent | MouseEvent): [number, number] => {
      const box = svg.getBoundingClientRect();
      return [(event.clientX - box.left - view.x(0)) / view.scale, (view.y(0) - (event.clientY - box.top)) / view.scale];
    };
    let drag: Drag | null = kept.current.drag;
    const down = (event: PointerEvent) => {
      if (event.button !== 0) return;
      const at = place(event);
      const near = latest.current.link.state?.beacons.find(b => Math.hypot(b.position[0] - at[0], b.position[1] - at[1]) < Math.max(b.radius, 10 / view.scale));
      drag = { beacon: near && !latest.current.measuring ? near.name : null, moved: false, x: event.clientX, y: event.clientY, gesture: Date.now() % 1e9 };
      svg.setPointerCapture(event.pointerId);
    };
    const move = (event: PointerEvent) => {
      const at = place(event);
      if (!drag) {
        const near = latest.current.link.state?.beacons.some(b => Math.hypot(b.position[0] - at[0], b.position[1] - at[1]) < Math.max(b.radius, 10 / view.scale));
        svg.style.cursor = latest.current.measuring || latest.current.placing ? 'crosshair' : near ? 'move' : 'grab';
        return;
      }
      if (!drag.moved && Math.hypot(event.clientX - drag.x, event.clientY - drag.y) < 4) return;
      drag.moved = true;
      if (drag.beacon) {
        latest.current.onBeacon(drag.beacon, at[0], at[1], drag.gesture);
        return;
      }
      if (latest.current.follow !== 'free') latest.current.setFollow('free');
      view = viewOf(view.scale, view.x(0) + event.clientX - drag.x, view.y(0) + event.clientY - drag.y);
      drag.x = event.clientX;
      drag.y = event.clientY;
      dirty.current = true;
    };
    const up = (event: PointerEvent) => {
      if (drag && !drag.moved) {
        const at = place(event);
        const { measuring, placing, onGround, line, onSeek } = latest.current;
        if (measuring) setRuler(rulerNow.current.length < 3 ? [...rulerNow.current, at] : [at]);
        else if (placing) onGround(at[0], at[1]);
        else {
          let best = 14 / view.scale, t = NaN;
          for (const tracks of line.tracks) tracks.x.forEach((x, k) => {
            const d = Math.hypot(Number(x) - at[0], Number(tracks.y[k]) - at[1]);
            if (d < best) { best = d; t = tracks.time[k]; }
          });
          if (Number.isFinite(t)) onSeek(t);
        }
      }
      drag = null;
    };
    const wheel = (event: WheelEvent) => {
      event.preventDefault();
      const box = svg.getBoundingClientRect();
      const factor = Math.pow(1.0016, -clamp(event.deltaY, -200, 200));
      const scale = clamp(view.scale * factor, 2, 8000);
      const [x, y] = place(event);
      view = viewOf(scale, event.clientX - box.left - x * scale, event.clientY - box.top + y * scale);
      dirty.current = true;
      if (latest.current.follow === 'fit') latest.current.setFollow('free');
    };
    const zoom = (event: Event) => {
      const factor = (event as CustomEvent<number>).detail;
      const [w, h] = [root.clientWidth / 2, root.clientHeight / 2];
      const [x, y] = [(w - view.x(0)) / view.scale, (view.y(0) - h) / view.scale];
      const scale = clamp(view.scale * factor, 2, 8000);
      view = viewOf(scale, w - x * scale, h + y * scale);
      dirty.current = true;
      if (latest.current.follow === 'fit') latest.current.setFollow('free');
    };
    const redraw = () => { dirty.current = true; };
    svg.addEventListener('pointerdown', down);
    svg.addEventListener('pointermove', move);
    svg.addEventListener('pointerup', up);
    const cancel = () => { drag = null; };
    svg.addEventListener('pointercancel', cancel);
    svg.addEventListener('wheel', wheel, { passive: false });
    addEventListener('studio-zoom', zoom);
    addEventListener('studio-redraw', redraw);
    return () => {
      stop();
      kept.current = { view, drag, follow: shown.follow };
      removeEventListener('studio-zoom', zoom);
      removeEventListener('studio-redraw', redraw);
      svg.removeEventListener('pointerdown', down);
      svg.removeEventListener('pointermove', move);
      svg.removeEventListener('pointerup', up);
      svg.removeEventListener('pointercancel', cancel);
      svg.removeEventListener('wheel', wheel);
    };
  }, [props.line, props.shade]);

  return <div class="arena" ref={holder}>
    <svg class="picture" role="img" aria-label={`${tr('Arena of')} ${props.line.scene.name}`} width="100%" height="100%">
      <g data-layer="ground" /><g data-layer="others" /><g data-layer="trail" /><g data-layer="top" /><g data-layer="moving" /><g data-layer="rim" />
    </svg>
  </div>;
}

/** How far two lines are apart at an instant. */
function apart(one: Line, other: Line, t: number): string {
  const robot = one.run.robots[0]?.name;
  if (!robot || t > Math.max(one.end, other.end) + 1e-9) return '';
  const d = Math.hypot(one.at(`robot.${robot}.pose.x`, t) - other.at(`robot.${robot}.pose.x`, t), one.at(`robot.${robot}.pose.y`, t) - other.at(`robot.${robot}.pose.y`, t));
  return Number.isFinite(d) ? d < 1 ? `${(d * 100).toFixed(1)} cm ${tr('off')}` : `${d.toFixed(2)} m ${tr('off')}` : '';
}

/** What runs along, and what could. */
export function Along({ studio, t }: { studio: Studio; t: number }) {
  const { state, line, about, others, run } = studio;
  return <section class="card who" aria-label={tr('Lines')}>
    <h2>{others.length > 0 ? tr('Running along') : tr('One line')}</h2>
    <ul>
      <li><svg width="24" height="8" aria-hidden="true"><path d="M0 4H24" stroke="#7ad151" stroke-width="4" /></svg><span>{about.name}, {about.what}</span><em>{tr('this one')}</em></li>
      {others.map(({ about: one, line: own, color: name, dash }) => <li>
        <svg width="24" height="8" aria-hidden="true"><path d="M0 4H24" style={{ stroke: `var(--${name})` }} stroke-width="1.6" stroke-dasharray={dash ? '5 3' : undefined} /></svg>
        {one.kind === 'ghost' ? <span>{one.name}</span> : <button class="bare" title={`${tr('Go on with line')} ${one.name}`} onClick={() => void run({ do: 'activate', line: one.id })}>{one.name}, {one.what}</button>}
        <em>{apart(line, own, t)}</em>
        <button class="x" aria-label={`${tr('Leave out')} ${one.name}`} title={tr('Leave out')} onClick={() => void run(one.kind === 'ghost' ? { do: 'ghost', level: one.name, on: false } : { do: 'drop', line: one.id })}>×</button></li>)}
    </ul>
    <div class="along"><span>{tr('run along')}</span>{['kinematic', 'rolling', 'slip'].map(level => <button class="chip" disabled={state.robots.every(r => r.level === level)} aria-pressed={state.ghosts.includes(level)} title={`${tr('The same task beside this run at level')} ${level}`} onClick={() => void run({ do: 'ghost', level, on: !state.ghosts.includes(level) })}>{level}</button>)}
      {state.found.recordings.length > 0 && <select class="chip" aria-label={tr('Lay a recording beside')} title={tr('Lay a recording beside')} value="" onChange={e => { const select = e.target as HTMLSelectElement; const name = select.value; select.value = ''; if (name) void run({ do: 'beside', recording: name }); }}>
        <option value="">+ {tr('recording')}</option>{state.found.recordings.map(name => <option value={name}>{name}</option>)}</select>}</div>
  </section>;
}

/** The choice of what colors the trail, with its scale. */
export function ShadeLegend({ studio, shade, choose }: { studio: Studio; shade: string; choose: (path: string) => void }) {
  const { line } = studio;
  const own = `robot.${line.run.robots[0]?.name}.`;
  const signals = line.scene.signals.filter(s => s.path.startsWith(own));
  const unit = shade === SPEED ? 'm/s' : shade === TIME ? 's' : line.scene.signals.find(s => s.path === shade)?.unit ?? '';
  return <div class="card shade" data-shade>
    <select aria-label={tr('Color of the trail')} title={tr('Color of the trail')} value={shade} onChange={e => choose((e.target as HTMLSelectElement).value)}>
      <option value={SPEED}>{tr('speed on the path')}</option><option value={TIME}>{tr('time')}</option>{signals.map(s => <option value={s.path}>{s.path.slice(own.length)}</option>)}
    </select><span>{unit === '1' ? '' : unit}</span><b>0</b><i /><b>1</b></div>;
}

function ArenaView({ host, studio, frame }: ViewProps) {
  const { line, follow, setFollow, measuring, setMeasuring, forces, setForces, stream, run, setPlacing, seek } = studio;
  const known = (path: unknown) => typeof path === 'string' && (path === SPEED || path === TIME || line.scene.signals.some(s => s.path === path));
  const [shade, setShade] = useState<string>(known(host.settings.shade) ? host.settings.shade as string : SPEED);
  const chosen = known(shade) ? shade : SPEED;
  const isSingle = line.run.robots.length === 1;
  const { terrain } = line.run.arena;
  const slope = terrain.kind === 'plane' ? terrain.slope_deg : 0;
  return <div class="view">
    <Arena {...studio} shade={chosen} fail={host.fail}
      onBeacon={(name, x, y, gesture) => stream({ do: 'edit', gesture, set: [[`arena.beacon.${name}.position`, `[${x.toFixed(3)}, ${y.toFixed(3)}]`]] })}
      onGround={(x, y) => { setPlacing(false); void run({ do: 'add-beacon', position: [Number(x.toFixed(3)), Number(y.toFixed(3))] }); }} onSeek={seek} />
    <div class="tools">
      <button aria-pressed={follow === 'follow'} onClick={() => setFollow('follow')} title={tr('Keep the robot in the middle')}>{tr('Follow')} <kbd>F</kbd></button>
      <button aria-pressed={follow === 'fit'} onClick={() => setFollow('fit')} title={tr('Show the whole arena')}>{tr('Fit')} <kbd>0</kbd></button>
      <button aria-pressed={measuring} onClick={() => setMeasuring(!measuring)} title={tr('Click two points for their distance and heading, a third for the angle')}>{tr('Measure')} <kbd>M</kbd></button>
      <button aria-pressed={forces} onClick={() => setForces(!forces)} title={tr('Contact forces with their friction limits')}>{tr('Forces')} <kbd>G</kbd></button>
      <button class="opt" onClick={() => saveArena(line, studio.theme)} title={tr('This run in the arena, as SVG')}>SVG</button>
    </div>
    <Along studio={studio} t={frame.time} />
    <div class="legend">
      {forces && line.forceScale > 0 && <div class="card" aria-label={tr('Forces')} data-newtons><svg class="picture" width="30" height="16" aria-hidden="true" /><b /><span class="far">{tr('forces, left and right')}</span>{line.run.arena.friction ? <><svg width="16" height="16" aria-hidden="true"><circle cx="8" cy="8" r="6.5" fill="none" style={{ stroke: 'var(--vermilion)' }} stroke-dasharray="1.5 3" stroke-linecap="round" /></svg>{tr('limit')} μN</> : null}</div>}
      {forces && line.run.robots.length <= VELOCITIES_MAX && <div class="card far"><svg class="picture" width="26" height="10" aria-hidden="true" dangerouslySetInnerHTML={{ __html: '<path d="M0 5H19" class="velocity"/><path d="M26 5l-8 -4v8z" class="f-ink"/>' }} />{tr('velocity')}, {AHEAD} s</div>}
      {slope !== 0 && <div class="card" title={tr('downhill')}><svg class="picture" width="26" height="26" viewBox="0 0 36 36" aria-hidden="true" dangerouslySetInnerHTML={{ __html: drawDownhill(line.run, 18, 18) }} /><span class="far">{tr('downhill')}</span> {plain(Math.abs(slope))}°</div>}
      <span class="grow" />
      {isSingle && <ShadeLegend studio={studio} shade={chosen} choose={path => { setShade(path); host.keep({ shade: path }); }} />}
      <div class="card"><svg class="picture" data-bar width="80" height="30" role="img" aria-label={tr('Scale')} /></div>
    </div>
  </div>;
}

export const arena = componentPanel('Arena', ArenaView);
