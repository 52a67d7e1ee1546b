// The column of what runs and what can be turned, in the words of the scenario file.

import { useMemo, useState } from 'preact/hooks';
import { significant } from '../../../sim/web/draw.js';
import type { Line, State } from './net';
import { tr } from './words';
import { rangeOf, unitOf } from './look';

type Props = {
  state: State; line: Line; run: (command: Record<string, unknown>) => Promise<unknown>; at: () => number | undefined;
  change: (path: string, value: number, gesture: number) => void; placing: boolean; setPlacing: (placing: boolean) => void;
};

const FIRST = ['lookahead', 'speed', 'acceleration', 'lateral_acceleration', 'body.mass', 'center_of_mass.0', 'resistance', 'friction', 'slope_deg'];

export function Side({ state, line, run, at, change, placing, setPlacing }: Props) {
  const [chosen, choose] = useState(0);
  const [filter, setFilter] = useState('');
  const robot = state.robots[Math.min(chosen, state.robots.length - 1)];
  const base = `robot.${robot.name}.`;
  const label = (name: string) => {
    const own = robot.controllers.find(c => c.name === name);
    if (name === 'hand') return 'hand: W A S D';
    if (!own) return name;
    return name === 'controller' ? `${own.kind}${own.law ? `, ${own.law}` : ''}` : own.file ? `${name} (${own.file})` : `${name}${own.law && own.law !== name ? `, ${own.law}` : ''}`;
  };
  const all = () => line.scene.numbers.filter(([path, , can]) => can && (path.startsWith(base) || path.startsWith('terrain.')) && !path.includes('.standby.hand.'));
  const short = (path: string) => path.replace(base, '').replace(/^platform\./, '');
  const rank = (path: string) => { const s = short(path); const k = FIRST.findIndex(f => ('.' + s).endsWith('.' + f)); return k < 0 ? 99 : k + (s.includes('standby') || s.includes('wheel.right') ? 20 : 0); };
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const shown = useMemo(() => words.length > 0 ? all().filter(([path]) => words.every(w => path.toLowerCase().includes(w))).slice(0, 40)
    : all().filter(([path]) => rank(path) < 20).sort((a, b) => rank(a[0]) - rank(b[0])).slice(0, 8), [line, base, filter]);
  const now = (path: string, first: number) => { for (let k = state.changes.length - 1; k >= 0; k--) if (state.changes[k][1] === path) return state.changes[k][2]; return first; };
  return <aside class="left" aria-label={tr('Controls')}>
    <section id="set-up"><h2>{tr('Set-up')} <kbd>1</kbd></h2>
      <label class="row" title="robot"><span>{tr('robot')}</span><select value={chosen} onChange={e => choose(Number((e.target as HTMLSelectElement).value))}>{state.robots.map((r, i) => <option value={i}>{r.name}</option>)}</select></label>
      <label class="row" title={`${base}file: ${tr('another robot file, from the beginning')}`}><span>{tr('platform')}</span>
        <select aria-label={tr('platform')} value="" onChange={e => choice(e, file => run({ do: 'platform', robot: robot.name, file }))}>
          <option value="">{robot.platform}</option>
          {state.found.platforms.length > 0 && <optgroup label={tr('robot files')}>{state.found.platforms.map(name => <option value={name}>{name}.toml</option>)}</optgroup>}
        </select></label>
      <div class="row" role="group" aria-label="level" title={base + 'level: from the beginning'}><span>{tr('level')}</span><div class="seg">{['kinematic', 'rolling', 'slip'].map(level => <button aria-pressed={robot.level === level} title={`${base}level = "${level}": drives the task again at this level, up to now`} onClick={() => void run({ do: 'edit', set: [[base + 'level', `"${level}"`]] })}>{level}</button>)}</div></div>
      <label class="row" title={base + 'drive'}><span>{tr('drive')}</span><select value={robot.drive} disabled={robot.level === 'kinematic'} onChange={e => void run({ do: 'edit', set: [[base + 'drive', `"${(e.target as HTMLSelectElement).value}"`]] })}><option value="as-built">as built</option><option value="torque">torque</option><option value="dc-motor">dc-motor</option></select></label>
      <label class="row" title={base + 'controller: another takes over at this instant'}><span>{tr('controller')}</span>
        <select aria-label="controller" value={robot.driving ?? ''} disabled={!robot.driving} onChange={e => { const to = (e.target as HTMLSelectElement).value; void run(robot.controllers.some(c => c.name === to) ? { do: 'swap', robot: robot.name, to, at: at() } : { do: 'engage', robot: robot.name, with: to, at: at() }); }}>
          {!robot.driving && <option value="">{tr('none')}</option>}
          <optgroup label={tr('of the scenario')}>{robot.controllers.map(c => <option value={c.name}>{label(c.name)}</option>)}</optgroup>
          {robot.offers.length > 0 && <optgroup label={tr('built in')}>{robot.offers.map(name => <option value={name}>{name === 'hand' ? 'hand: W A S D' : name}</option>)}</optgroup>}
        </select></label>
      <label class="row" title={`${base}task: ${tr('another task, from the beginning')}`}><span>{tr('task')}</span>
        <select aria-label={tr('task')} value="" onChange={e => choice(e, name => run({ do: 'task', robot: robot.name, ...(name.startsWith('of:') ? { of: name.slice(3) } : { kind: name }) }))}>
          <option value="">{robot.task ?? tr('none')}</option>
          {state.found.tasks.length > 0 && <optgroup label={tr('among these beacons')}>{state.found.tasks.map(kind => <option value={kind}>{kind}</option>)}</optgroup>}
          {state.scenarios.length > 0 && <optgroup label={tr('of another scenario, with its arena')}>{state.scenarios.map(name => <option value={`of:${name}`}>{name}.toml</option>)}</optgroup>}
        </select></label>
    </section>
    <section id="parameters"><h2>{tr('Parameters')} <kbd>2</kbd></h2>
      <input type="text" class="find" placeholder={tr('find: left radius')} aria-label={tr('Find parameters')} value={filter} onInput={e => setFilter((e.target as HTMLInputElement).value)} />
      {shown.map(([path, first]) => <Slider key={line.scene.name + path} path={path} short={short(path)} first={first} value={now(path, first)} change={change} />)}
      {shown.length === 0 && <p class="empty">{words.length > 0 ? tr('No number has all these words.') : tr('This scenario has no numbers that change while robots drive.')}</p>}
    </section>
    <section id="beacons"><h2>{tr('Beacons')} <span>{state.beacons.length} {tr('of')} 15</span></h2>
      <ul class="beacons" data-long={state.beacons.some(b => b.name.length > 3 || b.position.some(v => v >= 10))}>{state.beacons.map(b => <li><b>{b.name}</b><span>{b.position[0].toFixed(2)}, {b.position[1].toFixed(2)} m</span><button class="x" aria-label={`${tr('Remove beacon')} ${b.name}`} title={`${tr('Remove beacon')} ${b.name}`} onClick={() => void run({ do: 'remove-beacon', name: b.name })}>×</button></li>)}</ul>
      <div class="row size"><span>{tr('arena')}</span>{['x', 'y'].map((axis, k) => <label><span class="sr">{tr('arena')}, {axis}, m</span><input type="number" min="0.5" max="1000" step="0.5" title={`arena.size.${k}, m`} value={line.run.arena.size[k]}
        onChange={e => { const size = [...line.run.arena.size]; size[k] = Number((e.target as HTMLInputElement).value); if (size[k] > 0) void run({ do: 'edit', set: [['arena.size', `[${size.map(v => v.toFixed(3)).join(', ')}]`]] }); }} /></label>)}<span>m</span></div>
      <button class="add" aria-pressed={placing} disabled={state.beacons.length >= 15} onClick={() => setPlacing(!placing)} title={tr('Then click in the arena; beacons can be dragged')}>{tr('Place a beacon')}</button>
    </section>
    <section id="events"><h2>{tr('Events')}</h2>
      <ol class="events">{state.lines.find(l => l.id === state.active)?.events.slice(-40).map(e => <li data-kind={e.kind}><span class="n">{e.n}</span><span>{e.text}{e.detail ? `, ${e.detail}` : ''}</span><em>{e.t.toFixed(2)} s</em></li>)}</ol>
      {state.lines.find(l => l.id === state.active)?.events.length === 0 && <p class="empty">{tr('Press Space: what happens is listed here.')}</p>}
    </section>
  </aside>;
}

/** Does what was chosen; the list shows what is, once that is so. */
function choice(event: Event, act: (value: string) => unknown): void {
  const select = event.target as HTMLSelectElement;
  const { value } = select;
  select.value = '';
  if (value) void act(value);
}

function Slider({ path, short, first, value, change }: { path: string; short: string; first: number; value: number; change: (path: string, value: number, gesture: number) => void }) {
  const [low, high, step] = rangeOf(path, first);
  const [turning, turn] = useState<{ value: number; gesture: number } | null>(null);
  const shown = turning ? turning.value : value;
  const unit = unitOf(path);
  const title = `${path}\n${significant(low, 3)} to ${significant(high, 3)} ${unit}; at first ${significant(first)}`;
  const set = (next: number) => { const gesture = turning?.gesture ?? Date.now() % 1e9; turn({ value: next, gesture }); change(path, next, gesture); };
  const where = (v: number) => `${Math.min(100, Math.max(0, (v - low) / (high - low) * 100))}%`;
  return <label class="slider" title={title}>
    <span class="head"><span class="name">{short}</span><span class="val">{shown !== first && <s>{significant(first, 3)}</s>}<b>{significant(shown, 3)}</b> {unit}</span></span>
    <span class="track"><i style={{ left: where(first) }} data-on={shown !== first} /><input type="range" aria-label={short} aria-valuetext={`${significant(shown, 3)} ${unit}`} min={low} max={high} step={step} value={shown} style={{ '--at': where(shown) }}
      onInput={e => set(Number((e.target as HTMLInputElement).value))} onChange={() => setTimeout(() => turn(null), 400)} /></span>
  </label>;
}
