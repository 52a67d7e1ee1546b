// The arena: the report's drawing in a window that pans, zooms and follows, with what runs along.

import { useEffect, useRef, useState } from 'preact/hooks';
import { drawBeacons, drawGoal, drawGround, drawMoving, drawOrigin, drawRobot, drawScaleBar, drawTerrain, forceScale, gridSteps, robotColor, speedLimit, trailPoints, trailRuns, viewOf } from '../../../sim/web/arena.js';
import { clamp, eventMark, label, multiples, niceStep, pathText, plain, px, simplify, tickText, viridis } from '../../../sim/web/draw.js';
import { indexAt, stateAt } from '../../../sim/web/run.js';
import type { Line, Link } from './net';

type View = ReturnType<typeof viewOf>;
type Drag = { beacon: string | null; moved: boolean; x: number; y: number; gesture: number };
export type Follow = 'fit' | 'follow' | 'free';

export const GHOSTS = ['purple', 'sky', 'green', 'orange', 'blue', 'vermilion'];

type Props = {
  link: Link; line: Line; others: { line: Line; color: string; dash: boolean }[];
  time: () => number; follow: Follow; setFollow: (follow: Follow) => void; measuring: boolean;
  forces: boolean; onBeacon: (name: string, x: number, y: number, gesture: number) => void; onGround: (x: number, y: number) => void; placing: boolean;
  onSeek: (t: number) => void;
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
  const kept = useRef<{ view: View; drag: Drag | null }>({ view: viewOf(100, 0, 0), drag: null });

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
    let shown = { time: NaN, rows: -1, trail: -1, until: -1, fastest: 1, newton: 0, scaled: 0 };
    let handle = 0;

    const fit = (width: number, height: number) => {
      const { run } = latest.current.line;
      const [w, h] = run.arena.size;
      const scale = Math.max(1, Math.min((width - 60) / w, (height - 110) / h));
      return viewOf(scale, (width - w * scale) / 2, (height + h * scale) / 2);
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
        return `<circle cx="${px(x)}" cy="${px(y)}" r="3" class="dot"/>${eventMark(x + 15, y - 17, event.n)}`;
      }).join('');
      // Numbers along the rims of the window.
      const { numbers } = gridSteps(view.scale);
      let rim = '';
      const [w, h] = run.arena.size;
      for (const x of multiples(Math.max(0, low[0]), Math.min(w, high[0]), numbers)) if (view.x(x) > 46 && view.x(x) < width - 30) rim += label(view.x(x) + 4, height - 7, tickText(x, numbers) + ' m', 'tick halo');
      for (const y of multiples(Math.max(0, low[1]), Math.min(h, high[1]), numbers)) if (view.y(y) > 60 && view.y(y) < height - 26) rim += label(6, view.y(y) - 4, tickText(y, numbers) + ' m', 'tick halo');
      const bar = niceStep(Math.min(160, width * 0.25) / view.scale, 1);
      rim += drawScaleBar(width - 24 - bar * view.scale, height - 38, bar, view.scale);
      const points = rulerNow.current;
      if (points.length > 0) {
        const at = points.map(p => [view.x(p[0]), view.y(p[1])]);
        rim += `<path d="M${at.map(p => `${px(p[0])} ${px(p[1])}`).join('L')}" class="ruler"/>` + at.map(p => `<circle cx="${px(p[0])}" cy="${px(p[1])}" r="4" class="ruler-end"/>`).join('');
        if (points.length === 2) {
          const [dx, dy] = [points[1][0] - points[0][0], points[1][1] - points[0][1]];
          rim += label((at[0][0] + at[1][0]) / 2 + 8, (at[0][1] + at[1][1]) / 2 - 10, `${Math.hypot(dx, dy).toFixed(3)} m, ${(Math.atan2(dy, dx) * 180 / Math.PI).toFixed(1)}°`, 'bold halo');
        }
      }
      layers.rim.innerHTML = rim;
      layers.others.innerHTML = latest.current.others.map(({ line, color, dash }) => line.tracks.map(tracks => `<path d="${pathText(trailPoints(view, tracks))}" class="other s-${color}"${dash ? ' stroke-dasharray="6 5"' : ''}/>`).join('')).join('');
    };

    const trail = (from: number) => {
      const { line } = latest.current;
      line.run.robots.forEach((_, i) => {
        const all = line.tracks[i];
        const part = { ...all, time: all.time.slice(from), x: all.x.slice(from), y: all.y.slice(from), speed: all.speed.slice(from) };
        const own = robotColor(line.run, i);
        const runs = trailRuns(view, part, shown.fastest);
        const casing = `<path d="${pathText(trailPoints(view, part))}" class="casing"/>`;
        const body = runs.map(r => `<path d="${r.path}" ${own ? `class="s-${own}"` : `stroke="${r.color}"`}/>`).join('');
        const group = document.createElementNS('http://www.w3.org/2000/svg', 'g');
        group.innerHTML = casing + `<g class="trail">${body}</g>`;
        layers.trail.append(group);
      });
    };

    const frame = () => {
      handle = requestAnimationFrame(frame);
      const { line, others, follow, time, forces } = latest.current;
      const width = root.clientWidth, height = root.clientHeight;
      const t = time();
      const rows = line.run.time.length;
      if (rows === 0) return;
      let moved = dirty.current;
      if (dirty.current && follow === 'fit') view = fit(width, height);
      if (follow === 'follow') {
        const s = stateAt(line.tracks[0], line.run.robots[0], t);
        const scale = follow === 'follow' && view.scale < 30 ? 160 : view.scale;
        const next = viewOf(scale, width / 2 - s.x * scale, height / 2 + s.y * scale);
        if (Math.abs(next.x(0) - view.x(0)) + Math.abs(next.y(0) - view.y(0)) > 0.3 || next.scale !== view.scale) { view = next; moved = true; }
      }
      if (rows < shown.rows) moved = true;
      // Scales follow the run, but not at every frame.
      if (moved || rows - shown.scaled > 25) {
        const fastest = speedLimit(line.run);
        shown.newton = forceScale(line.run);
        if (fastest !== shown.fastest) { shown.fastest = fastest; moved = true; }
        shown.scaled = rows;
        const scaleText = root.querySelector('[data-fastest]');
        if (scaleText) scaleText.textContent = plain(fastest);
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
      if (rows - shown.trail >= 2 && (moved || rows - shown.trail > 3 || !grown)) { trail(Math.max(0, shown.trail - 1)); shown.trail = rows; }
      // What is ahead of the time that is looked at is faint.
      layers.trail.style.opacity = until < rows - 2 ? '0.35' : '';
      let svg = '';
      if (until < rows - 2) line.run.robots.forEach((_, i) => {
        const all = line.tracks[i];
        const part = { ...all, time: all.time.slice(0, until + 1), x: all.x.slice(0, until + 1), y: all.y.slice(0, until + 1), speed: all.speed.slice(0, until + 1) };
        const own = robotColor(line.run, i);
        svg += `<g class="trail">${trailRuns(view, part, shown.fastest).map(r => `<path d="${r.path}" ${own ? `class="s-${own}"` : `stroke="${r.color}"`}/>`).join('')}</g>`;
      });
      for (const other of others) other.line.run.robots.forEach((robot, i) => { svg += drawRobot(view, robot, stateAt(other.line.tracks[i], robot, t), { ghost: `ghost-line s-${other.color}` }); });
      svg += drawMoving(view, line.run, line.tracks, t, { scale: forces ? shown.newton : 0 });
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
    };

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
        if (measuring) setRuler(rulerNow.current.length === 1 ? [rulerNow.current[0], at] : [at]);
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
    handle = requestAnimationFrame(frame);
    return () => {
      cancelAnimationFrame(handle);
      kept.current = { view, drag };
      removeEventListener('studio-zoom', zoom);
      removeEventListener('studio-redraw', redraw);
      svg.removeEventListener('pointerdown', down);
      svg.removeEventListener('pointermove', move);
      svg.removeEventListener('pointerup', up);
      svg.removeEventListener('pointercancel', cancel);
      svg.removeEventListener('wheel', wheel);
    };
  }, [props.line]);

  const single = props.line.run.robots.length === 1;
  return <div class="arena" ref={holder}>
    <svg class="picture" role="img" aria-label={`Arena of ${props.line.scene.name}`} width="100%" height="100%">
      <g data-layer="ground" /><g data-layer="others" /><g data-layer="trail" /><g data-layer="top" /><g data-layer="moving" /><g data-layer="rim" />
    </svg>
    {single && <div class="card scale"><span>speed on the path, m/s</span><i style={{ background: `linear-gradient(90deg,${[0, 0.25, 0.5, 0.75, 1].map(u => viridis(u)).join()})` }} /><span class="ends"><b>0</b><b data-fastest>1</b></span></div>}
  </div>;
}
