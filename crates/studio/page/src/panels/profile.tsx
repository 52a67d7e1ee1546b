// From the side: robots on the slope along their own heading with the height that they drove, and a wheel-legged
// robot before a step or a trench, drawn as in its report.

import { useEffect, useRef, useState } from 'preact/hooks';
import { drawCrossing, keyFrames, type Crossing } from '../../../../sim/web/crossing.js';
import { label, multiples, niceStep, pathText, px, significant, simplify, tickText } from '../../../../sim/web/draw.js';
import { sideOf } from '../../../../sim/web/arena.js';
import { stateAt, type Robot, type Run } from '../../../../sim/web/run.js';
import { heightOf } from '../../../../sim/web/terrain.js';
import { find } from '../carrier';
import { componentPanel, eachPicture, type ViewProps } from '../panel';
import type { Studio } from '../studio';
import { tr } from '../words';

/** Height of the ground in the direction of a heading, m/m. */
function riseAlong(run: Run, heading: number): number {
  const { terrain } = run.arena;
  if (terrain.kind !== 'plane') return 0;
  return -Math.tan(terrain.slope_deg * Math.PI / 180) * Math.cos(heading - terrain.downhill_heading_deg * Math.PI / 180);
}

function sideOfRobot(run: Run, robot: Robot, studio: Studio, t: number, width: number, height: number): string {
  const k = run.robots.indexOf(robot);
  const state = stateAt(studio.line.tracks[k], robot, t);
  const { terrain } = run.arena;
  const isUneven = terrain.kind === 'uneven';
  const pitch = isUneven ? -state.pitch : Math.atan(riseAlong(run, state.yaw));
  const reach = Math.max(0.1, ...robot.footprint.map(p => Math.abs(p[0])), ...robot.wheels.map(w => Math.abs(w.mount[0]) + w.radius));
  const scale = Math.min((width - 60) / (3.4 * reach), (height - 70) / (2.2 * reach));
  const [ox, oy] = [width / 2, height - 42 - Math.abs(Math.tan(pitch)) * width / 4];
  const rise = Math.tan(pitch) * width / 2;
  // The ground along the heading, through the robot.
  const points = Math.max(2, Math.ceil(width / 1.5));
  const profile = Array.from({ length: points + 1 }, (_, k) => {
    const u = (k / points - 0.5) * width / scale;
    return `${px(ox + u * scale)} ${px(oy - (isUneven ? heightOf(terrain, state.x + u * Math.cos(state.yaw), state.y + u * Math.sin(state.yaw)) - state.z : 0) * scale)}`;
  });
  const top = isUneven ? `M${profile.join('L')}` : `M0 ${px(oy + rise)}L${width} ${px(oy - rise)}`;
  let svg = `<path d="${top}V${height}H0Z" class="slope" fill-opacity="0.16"/><path d="${top}" class="none s-ink" stroke-width="1.6"/>`;
  let inside = '';
  const wheels = robot.wheels.map((wheel, i) => ({ wheel, state: state.wheels[i] })).sort((a, b) => b.wheel.mount[1] - a.wheel.mount[1]);
  const radius = Math.max(...robot.wheels.filter(w => w.kind !== 'caster').map(w => w.radius), 0.02);
  const [front, rear] = [Math.max(...robot.footprint.map(p => p[0])), Math.min(...robot.footprint.map(p => p[0]))];
  const body = `<rect x="${px(rear * scale)}" y="${px(-1.7 * radius * scale)}" width="${px((front - rear) * scale)}" height="${px(0.9 * radius * scale)}" rx="4" class="body"/>`;
  // The heaviest load keeps within the panel.
  const heaviest = Math.max(1e-9, ...state.wheels.map(own => own.load ?? 0));
  const draw = ({ wheel, state: own }: typeof wheels[number]) => {
    const side = sideOf(wheel), name = side === 'left' ? 'blue' : side === 'right' ? 'vermilion' : 'ink2';
    const x = (wheel.mount[0] - (wheel.kind === 'caster' || wheel.kind === 'trailer' ? wheel.trail * Math.cos(own.heading) : 0)) * scale;
    const r = wheel.radius * scale;
    const spokes = Array.from({ length: 6 }, (_, n) => { const a = own.spin + n * Math.PI / 3; return `M${px(x)} ${px(-r)}L${px(x + r * 0.85 * Math.cos(a))} ${px(-r + r * 0.85 * Math.sin(a))}`; }).join('');
    let text = `<circle cx="${px(x)}" cy="${px(-r)}" r="${px(r)}" class="f-${name} s-${name}" fill-opacity="0.3" stroke-width="1.6"/><path d="${spokes}" class="s-${name}" stroke-width="1"/>`;
    // Load up, and the force along the ground.
    const n = own.load === null ? 0 : own.load / heaviest * 42;
    if (own.load !== null && studio.forces) text += `<path d="M${px(x)} 0V${px(n * 0.8)}" class="s-${name}" stroke-width="2.2"/><path d="M${px(x - 4)} 8L${px(x)} 0L${px(x + 4)} 8Z" class="f-${name}"/>${label(x + (side === 'left' ? -6 : 6), n * 0.8 + 4, `${significant(own.load, 3)} N`, 'tick halo', side === 'left' ? 'end' : 'start')}`;
    return text;
  };
  inside += wheels.filter(w => sideOf(w.wheel) === 'left').map(draw).join('') + body + wheels.filter(w => sideOf(w.wheel) !== 'left').map(draw).join('');
  const com = robot.center_of_mass[0] * scale, ch = -1.25 * radius * scale;
  inside += `<circle cx="${px(com)}" cy="${px(ch)}" r="5" class="com"/><path d="M${px(com - 5)} ${px(ch)}h10M${px(com)} ${px(ch - 5)}v10" class="s-ink" stroke-width="1"/>`;
  svg += `<g transform="translate(${px(ox)} ${px(oy)}) rotate(${px(-pitch * 180 / Math.PI)})">${inside}</g>`;
  svg += label(14, 24, `${robot.name}, ${tr('heading')} ${(Math.atan2(Math.sin(state.yaw), Math.cos(state.yaw)) * 180 / Math.PI).toFixed(0).replace('-', '−')}°`, 'bold') + label(14, 42, isUneven ? `${tr('pitch')} ${(state.pitch * 180 / Math.PI).toFixed(1).replace('-', '−')}°` : pitch === 0 ? tr('level ground') : `${tr('ground along the heading')} ${(pitch * 180 / Math.PI).toFixed(1).replace('-', '−')}°`, 'note');
  return svg;
}

/** Height over the way driven, where the ground slopes. */
function wayOf(studio: Studio, t: number, width: number, height: number): string {
  const { line } = studio;
  const tracks = line.tracks[0];
  const { terrain } = line.run.arena;
  const heights = tracks?.attitude[0];
  if (!tracks || (terrain.kind !== 'plane' && !heights) || tracks.time.length < 2) return '';
  const [slope, h] = terrain.kind === 'plane' ? [Math.sin(terrain.slope_deg * Math.PI / 180), terrain.downhill_heading_deg * Math.PI / 180] : [0, 0];
  const points: [number, number][] = [];
  let way = 0, here = 0;
  const z = (k: number) => heights ? Number(heights[k]) : -slope * (Number(tracks.x[k]) * Math.cos(h) + Number(tracks.y[k]) * Math.sin(h));
  for (let k = 0; k < tracks.time.length; k++) {
    if (k > 0) way += Math.hypot(Number(tracks.x[k]) - Number(tracks.x[k - 1]), Number(tracks.y[k]) - Number(tracks.y[k - 1]));
    points.push([way, z(k) - z(0)]);
    if (tracks.time[k] <= t) here = k;
  }
  const box = { left: 52, right: width - 14, top: 26, bottom: height - 34 };
  const low = Math.min(0, ...points.map(p => p[1])), high = Math.max(0, ...points.map(p => p[1]));
  const room = Math.max(1e-6, (high - low) * 0.12);
  const x = (v: number) => box.left + v / Math.max(way, 1e-6) * (box.right - box.left), y = (v: number) => box.bottom - (v - low + room) / (high - low + 2 * room) * (box.bottom - box.top);
  const sx = niceStep(Math.max(way, 1e-6), 7), sy = niceStep(high - low + 2 * room, 4);
  return multiples(0, way, sx).map((v: number) => `<path d="M${px(x(v))} ${box.top}V${box.bottom}" class="grid"/>${label(x(v), box.bottom + 15, tickText(v, sx), 'tick', 'middle')}`).join('')
    + multiples(low - room, high + room, sy).map((v: number) => `<path d="M${box.left} ${px(y(v))}H${box.right}" class="grid"/>${label(box.left - 6, y(v) + 4, tickText(v, sy), 'tick', 'end')}`).join('')
    + `<path d="${pathText(simplify(points.map(p => [x(p[0]), y(p[1])] as [number, number]), 0.2))}" class="line s-ink"/><circle cx="${px(x(points[here][0]))}" cy="${px(y(points[here][1]))}" r="4.5" class="dot"/>`
    + label(box.left, 15, `${tr('height above the start')}, m`, 'bold') + label(box.right, box.bottom + 30, `${tr('way driven')}, m`, 'tick', 'end');
}

function RunFromTheSide({ studio, host }: ViewProps) {
  const svg = useRef<SVGSVGElement>(null);
  const latest = useRef(studio);
  latest.current = studio;
  useEffect(() => {
    let shown = '';
    return eachPicture(host.fail, () => {
      const element = svg.current;
      if (!element) return;
      const { line, time, forces, theme } = latest.current;
      const [width, height] = [element.clientWidth, element.clientHeight];
      const t = time();
      const key = `${width} ${height} ${t} ${line.id} ${line.run.time.length} ${forces} ${theme}`;
      if (key === shown || line.run.time.length === 0 || width < 10) return;
      shown = key;
      const way = line.run.arena.terrain.kind !== 'flat' ? Math.min(190, height * 0.36) : 0;
      const robots = line.run.robots.slice(0, 3);
      const each = width / robots.length;
      element.innerHTML = robots.map((robot, k) => `<svg x="${px(k * each)}" width="${px(each)}" height="${px(height - way)}">${sideOfRobot(line.run, robot, latest.current, t, each, height - way)}</svg>`).join('')
        + (way ? `<g transform="translate(0 ${px(height - way)})">${wayOf(latest.current, t, width, way)}</g>` : '');
    });
  }, []);
  return <svg class="picture" ref={svg} width="100%" height="100%" role="img" aria-label={`${tr('From the side')}: ${studio.line.scene.name}`} />;
}

/** Times as fast as the robot would be. */
const PACE = 4;

function ObstacleView({ host }: ViewProps) {
  const kept = host.settings.obstacle as { kind: 'step' | 'trench'; height: number; width: number } | undefined;
  const [obstacle, setObstacle] = useState(kept ?? { kind: 'step' as const, height: 0.2, width: 0.35 });
  const [data, setData] = useState<Crossing | null>(null);
  const [problem, setProblem] = useState('');
  const [now, setNow] = useState(0);
  const [plays, setPlays] = useState(false);
  const set = (change: Partial<typeof obstacle>) => { const next = { ...obstacle, ...change }; setObstacle(next); host.keep({ obstacle: next }); };
  useEffect(() => {
    // An answer that another question has overtaken is not shown.
    let isOver = false;
    const wait = setTimeout(() => {
      find(`api/crossing?height=${obstacle.height}${obstacle.kind === 'trench' ? `&width=${obstacle.width}` : ''}`).then(async answer => {
        const said = await answer.json();
        if (isOver) return;
        if (!answer.ok) { setProblem(said.problem); return; }
        setProblem('');
        setData(said);
        const keys = said.frames.length > 0 ? keyFrames(said, 9) : [];
        setNow(said.frames[keys[4] ?? 0]?.t ?? 0);
      }).catch(host.fail);
    }, 120);
    return () => { isOver = true; clearTimeout(wait); };
  }, [obstacle.kind, obstacle.height, obstacle.width]);
  const end = data && data.frames.length > 0 ? data.frames[data.frames.length - 1].t : 0;
  useEffect(() => {
    if (!plays) return;
    let before = performance.now();
    return eachPicture(host.fail, stamp => {
      const dt = (stamp - before) / 1000;
      before = stamp;
      setNow(t => { if (t + PACE * dt >= end) setPlays(false); return Math.min(end, t + PACE * dt); });
    });
  }, [plays, end]);
  const at = data ? Math.max(0, data.frames.findLastIndex(f => f.t <= now)) : 0;
  const picture = data && data.frames.length > 0 ? drawCrossing(data, at, Math.max(420, host.root.clientWidth - 38)) : null;
  const slider = (name: 'height' | 'width', words: string, top: number) => <label>{words} <input type="range" min="0" max={top} step="0.01" value={obstacle[name]} style={{ '--at': `${obstacle[name] / top * 100}%` }} aria-valuetext={`${obstacle[name]} m`} onInput={e => set({ [name]: Number((e.target as HTMLInputElement).value) })} /><b>{obstacle[name].toFixed(2)} m</b></label>;
  return <div class="obstacle">
    <div class="bar"><div class="seg" role="group" aria-label={tr('obstacle')}>{(['step', 'trench'] as const).map(kind => <button aria-pressed={obstacle.kind === kind} onClick={() => set({ kind })}>{kind === 'step' ? tr('step up') : tr('trench')}</button>)}</div>
      {slider('height', obstacle.kind === 'step' ? tr('height') : tr('depth'), 0.6)}{obstacle.kind === 'trench' && slider('width', tr('width'), 1.2)}</div>
    {problem && <p class="wrong" role="alert">{problem}</p>}
    {data && <p class="told"><b>{data.title}</b> {data.reason} <em>{data.verdict}</em></p>}
    {picture && data ? <><svg class="picture" viewBox={`0 0 ${picture.width} ${picture.height}`} role="img" aria-label={data.title} dangerouslySetInnerHTML={{ __html: picture.svg }} />
      <div class="bar"><button class="main" onClick={() => { if (now >= end) setNow(0); setPlays(!plays); }}>{plays ? tr('Pause') : tr('Play')}</button>
        <input type="range" min="0" max={end} step="any" value={now} style={{ '--at': `${now / Math.max(end, 1e-9) * 100}%` }} aria-label={tr('time')} aria-valuetext={`${now.toFixed(1)} s`} onInput={e => { setPlays(false); setNow(Number((e.target as HTMLInputElement).value)); }} /><b>{now.toFixed(1)} s</b></div>
      <p class="told">{data.frames[at].deed} · {picture.words}</p></> : data && <p class="empty">{tr('The robot does not try it.')}</p>}
    <p class="note">{tr('Quasi-static, of a robot whose lengths beyond wheel radius, pitch and reach are assumed; apart from the run.')}</p>
  </div>;
}

function ProfileView(props: ViewProps) {
  const [kind, setKind] = useState(props.host.settings.kind === 'obstacle' ? 'obstacle' : 'run');
  return <div class="view profile"><div class="tools"><div class="seg two" role="group" aria-label={tr('what is shown')}>{[['run', tr('This run')], ['obstacle', tr('Wheel-legged robot')]].map(([name, words]) => <button aria-pressed={kind === name} onClick={() => { setKind(name); props.host.keep({ kind: name }); }}>{words}</button>)}</div></div>
    {kind === 'run' ? <RunFromTheSide {...props} /> : <ObstacleView {...props} />}</div>;
}

export const profile = componentPanel('From the side', ProfileView);
