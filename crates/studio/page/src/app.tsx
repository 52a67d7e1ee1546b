// The page: what stands where, the keys, and the time that is looked at.

import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { Arena, GHOSTS, type Follow } from './arena';
import { Link, type Line, type LineState, type PlotSpec, type Refusal } from './net';
import { Plots } from './plots';
import { Side } from './side';
import { SPEEDS, Transport } from './transport';
import { type Theme } from './look';
import { forceScale } from '../../../sim/web/arena.js';

const KEYS: [string, string][] = [
  ['Space', 'play or pause'], ['← →', 'one row back, on'], ['Shift ← →', 'one second back, on'], ['Home End', 'first, latest instant'], [', .', 'slower, faster'],
  ['B', 'branch here'], ['Ctrl Z, Ctrl Shift Z', 'undo, redo'], ['Ctrl S', 'save the scenario'], ['F', 'follow the robot'], ['0', 'fit the arena'], ['+ −', 'closer, farther'],
  ['M', 'measure'], ['G', 'forces on, off'], ['W A S D', 'drive, once “hand” has the command'], ['T', 'light or dark'], ['1 2 3', 'to set-up, parameters, plots'], ['?', 'these keys'],
];

function remembered<T>(key: string, otherwise: T): T {
  try { const text = localStorage.getItem('appell.' + key); return text === null ? otherwise : JSON.parse(text); } catch { return otherwise; }
}
function remember(key: string, value: unknown): void {
  try { localStorage.setItem('appell.' + key, JSON.stringify(value)); } catch { /* a page without storage forgets */ }
}

export function App() {
  const [, redraw] = useState<number>(0);
  const [theme, setTheme] = useState<Theme>(remembered('theme', matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
  const [follow, setFollow] = useState<Follow>('fit');
  const [measuring, setMeasuring] = useState(false);
  const [placing, setPlacing] = useState(false);
  const [forces, setForces] = useState(true);
  const [error, setError] = useState<Refusal | null>(null);
  const [dialog, setDialog] = useState<'keys' | 'save' | null>(null);
  const [span, setSpan] = useState<[number, number] | null>(null);
  const [layouts, setLayouts] = useState<Record<string, PlotSpec[]>>(remembered('plots', {}));
  const [done, setDone] = useState('');
  // The instant that is looked at; none for the newest.
  const cursor = useRef<number | null>(null);
  const replaying = useRef(false);
  const [cursorShown, showCursor] = useState<number | null>(null);
  const rowsAt = useRef<number>(0);
  const rowsLater = useRef<ReturnType<typeof setTimeout> | undefined>(undefined);
  const link = useMemo(() => new Link(() => redraw(n => n + 1), () => {
    const now = performance.now();
    if (now - rowsAt.current > 120) { rowsAt.current = now; redraw(n => n + 1); }
    // The last rows are shown, too.
    clearTimeout(rowsLater.current);
    rowsLater.current = setTimeout(() => redraw(n => n + 1), 60);
  }), []);

  // Before anything is drawn: canvases take their colors from it.
  document.documentElement.dataset.theme = theme;
  useEffect(() => { remember('theme', theme); dispatchEvent(new Event('studio-redraw')); redraw(n => n + 1); }, [theme]);

  const state = link.state;
  const line = state ? link.lines.get(state.active) ?? null : null;
  const about = state?.lines.find(one => one.id === state.active) ?? null;
  const end = line?.end ?? 0;
  const time = useRef<() => number>(() => 0);
  time.current = () => cursor.current === null ? link.lines.get(link.state?.active ?? -1)?.end ?? 0 : cursor.current;

  const say = (text: string) => { setDone(text); setTimeout(() => setDone(''), 6000); };
  const run = (command: Record<string, unknown>) => link.do(command).then(value => { setError(null); return value; }).catch((refusal: Refusal) => { setError(refusal); return null; });
  const at = () => cursor.current === null ? undefined : cursor.current;
  // Commands in one gesture go one after another; only the newest that waits is sent.
  const queue = useRef<{ busy: boolean; next: Record<string, unknown> | null }>({ busy: false, next: null });
  const stream = (command: Record<string, unknown>) => {
    const q = queue.current;
    if (q.busy) { q.next = command; return; }
    q.busy = true;
    void run(command).then(() => { q.busy = false; const next = q.next; q.next = null; if (next) stream(next); });
  };

  const seek = (t: number | null) => {
    replaying.current = false;
    const current = link.lines.get(link.state?.active ?? -1);
    const last = current?.end ?? 0;
    cursor.current = t === null || t >= last - 1e-9 ? (link.state?.playing ? null : t === null ? null : last) : Math.max(0, t);
    if (cursor.current !== null && cursor.current >= last) cursor.current = null;
    if (cursor.current !== null && link.state?.playing) void run({ do: 'pause' });
    showCursor(cursor.current);
    redraw(n => n + 1);
  };

  const play = () => {
    const s = link.state;
    if (!s) return;
    const me = s.lines.find(one => one.id === s.active);
    if (s.playing) { void run({ do: 'pause' }); return; }
    if (replaying.current) { replaying.current = false; redraw(n => n + 1); return; }
    if (cursor.current !== null || me?.over) {
      // What was driven is looked at again; at its end the run goes on.
      if (cursor.current === null) cursor.current = 0;
      replaying.current = true;
      let last = performance.now();
      const tick = (now: number) => {
        if (!replaying.current || cursor.current === null) return;
        const factor = link.state?.speed || 100;
        const dt = Math.min(0.1, (now - last) / 1000);
        cursor.current += dt * factor;
        last = now;
        const current = link.lines.get(link.state?.active ?? -1);
        if (current && cursor.current >= current.end) {
          cursor.current = null;
          replaying.current = false;
          const over = link.state?.lines.find(one => one.id === link.state?.active)?.over;
          if (!over) void run({ do: 'play' });
        }
        showCursor(cursor.current);
        requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
      redraw(n => n + 1);
      return;
    }
    void run({ do: 'play' });
  };

  const change = (path: string, value: number, gesture: number) => stream({ do: 'change', path, value, at: at(), gesture });
  const branch = () => { if (line) void run({ do: 'branch', at: time.current() }).then(() => { cursor.current = null; showCursor(null); }); };

  // A change in the past makes a branch that ends where one looks: look at its end.
  const activeBefore = useRef(-1);
  useEffect(() => {
    if (state && state.active !== activeBefore.current) {
      activeBefore.current = state.active;
      replaying.current = false;
      const fresh = link.lines.get(state.active);
      if (cursor.current !== null && fresh && fresh.end <= cursor.current + 0.02) { cursor.current = null; showCursor(null); }
    }
  });

  // Driving by hand: each key that goes down or up turns a knob of the controller `hand`.
  const held = useRef(new Set<string>());
  const hand = state?.robots.find(robot => robot.driving === 'hand') ?? null;
  const drive = () => {
    const keys = held.current;
    if (!hand) return;
    const speed = 0.5, turn = 1.2;
    const wanted: Record<string, number> = { forward: (Number(keys.has('w')) - Number(keys.has('s'))) * speed, yaw_rate: (Number(keys.has('a')) - Number(keys.has('d'))) * turn };
    for (const [to, value] of Object.entries(wanted)) {
      const path = `robot.${hand.name}.standby.hand.controller.channel.${to}.signal.value`;
      const known = [...(link.state?.changes ?? [])].reverse().find(c => c[1] === path)?.[2] ?? 0;
      if (lastHand.current[path] === undefined ? known !== value : lastHand.current[path] !== value) {
        lastHand.current[path] = value;
        void run({ do: 'change', path, value });
      }
    }
  };
  const lastHand = useRef<Record<string, number>>({});
  useEffect(() => { if (!hand) lastHand.current = {}; }, [hand?.name]);

  useEffect(() => {
    const down = (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      const typing = target.matches('input[type=text],input[type=number],textarea');
      const key = event.key.toLowerCase();
      if ((event.ctrlKey || event.metaKey) && key === 'z') { event.preventDefault(); void run({ do: event.shiftKey ? 'redo' : 'undo' }); return; }
      if ((event.ctrlKey || event.metaKey) && key === 'y') { event.preventDefault(); void run({ do: 'redo' }); return; }
      if ((event.ctrlKey || event.metaKey) && key === 's') { event.preventDefault(); setDialog('save'); return; }
      if (key === 'escape') { setDialog(null); setError(null); setMeasuring(false); setPlacing(false); setSpan(null); return; }
      if (typing || event.ctrlKey || event.metaKey || event.altKey) return;
      if ('wasd'.includes(key) && key.length === 1 && hand) {
        if (!event.repeat) { held.current.add(key); drive(); }
        return;
      }
      const slides = target.matches('input[type=range],select');
      const moves = !slides || !['arrowleft', 'arrowright', 'home', 'end'].includes(key);
      const step = line?.scene.period ?? 0.01;
      const on = (by: number) => { const t = time.current() + by; if (by > 0 && cursor.current === null && !about?.over) void run({ do: 'step' }); else seek(t); };
      const pace = (by: number) => { const now = SPEEDS.findIndex(s => s === state?.speed); const next = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, (now < 0 ? 4 : now) + by))]; void run({ do: 'speed', factor: next }); };
      const acts: Record<string, () => void> = {
        ' ': () => { if (!target.matches('button,summary,select,input')) play(); else return; },
        arrowleft: () => on(event.shiftKey ? -1 : -step), arrowright: () => on(event.shiftKey ? 1 : step),
        home: () => seek(0), end: () => seek(null), ',': () => pace(-1), '.': () => pace(1), b: branch,
        f: () => setFollow('follow'), 0: () => setFollow('fit'), m: () => setMeasuring(m => !m), g: () => setForces(f => !f),
        t: () => setTheme(t => t === 'dark' ? 'light' : 'dark'), '?': () => setDialog('keys'),
        '+': () => dispatchEvent(new CustomEvent('studio-zoom', { detail: 1.25 })), '-': () => dispatchEvent(new CustomEvent('studio-zoom', { detail: 0.8 })),
        1: () => focusIn('set-up'), 2: () => focusIn('parameters'), 3: () => focusIn('plots'),
      };
      const act = acts[key];
      if (act && moves && !(key === ' ' && target.matches('button,summary,select'))) { event.preventDefault(); act(); }
    };
    const up = (event: KeyboardEvent) => { if (held.current.delete(event.key.toLowerCase())) drive(); };
    const blur = () => { if (held.current.size > 0) { held.current.clear(); drive(); } };
    addEventListener('keydown', down);
    addEventListener('keyup', up);
    addEventListener('blur', blur);
    return () => { removeEventListener('keydown', down); removeEventListener('keyup', up); removeEventListener('blur', blur); };
  });

  if (!state || !line || !about) return <main class="wait"><h1>Appell Studio</h1><p role="status">{link.isOpen ? 'The run is being opened …' : 'Looking for the studio … If it has ended, start it again with “appell studio”.'}</p></main>;

  const driven = state.lines.filter(one => one.kind !== 'ghost');
  const others = state.lines.filter(one => one.id !== state.active && link.lines.has(one.id)).map(one => {
    const ghosts = state.lines.filter(l => l.kind === 'ghost');
    return { about: one, line: link.lines.get(one.id) as Line, color: one.kind === 'ghost' ? GHOSTS[ghosts.indexOf(one) % GHOSTS.length] : 'reference', dash: one.kind === 'ghost' };
  });
  const parent = about.parent ? driven.find(one => one.name === about.parent?.[0]) : null;
  const compared = (parent ? link.lines.get(parent.id) : null) ?? others.find(o => o.about.kind === 'ghost')?.line ?? null;
  const specs = layouts[line.scene.name] ?? preferred(line);
  const setSpecs = (next: PlotSpec[]) => { const all = { ...layouts, [line.scene.name]: next }; setLayouts(all); remember('plots', all); };
  const events = about.events.filter(e => e.kind !== 'change').map(e => ({ n: e.n, t: e.t }));
  const t = cursorShown ?? end;
  const newtons = forces ? legendForce(line) : '';

  return <>
    <header class="top">
      <span class="brand"><svg width="20" height="20" viewBox="0 0 20 20" aria-hidden="true"><path d="M2 15C6 15 6 5 10 5s4 10 8 10" fill="none" stroke="currentColor" stroke-width="2" /><circle cx="10" cy="13.5" r="2" fill="#E69F00" /></svg>Appell</span>
      <label class="file"><span class="sr">Scenario</span>
        <select value={state.file.replace(/\.toml$/, '')} title="Scenario; the others of its folder can be opened" onChange={e => void run({ do: 'open', name: (e.target as HTMLSelectElement).value }).then(() => { cursor.current = null; showCursor(null); setSpan(null); setFollow('fit'); })}>
          {!state.scenarios.includes(state.file.replace(/\.toml$/, '')) && <option value={state.file.replace(/\.toml$/, '')}>{state.file}</option>}
          {state.scenarios.map(name => <option value={name}>{name}.toml</option>)}
        </select>{state.saved ? <em>saved as {state.saved}.toml</em> : state.changed && <em>changed</em>}</label>
      <span class="verdict" role="status" data-verdict={about.verdict ?? ''}>{verdictOf(about)}</span>
      <span class="grow" />
      <button onClick={() => void run({ do: 'undo' })} disabled={!state.undo} title={state.undo ? `Undo: ${state.undo}` : 'Nothing to undo'}>Undo <kbd>Ctrl Z</kbd></button>
      <button class="opt" onClick={() => void run({ do: 'redo' })} disabled={!state.redo} title={state.redo ? `Redo: ${state.redo}` : 'Nothing to redo'}>Redo</button>
      <button onClick={() => setDialog('save')} title="Save what was done as a scenario that repeats it bit for bit">Save scenario <kbd>Ctrl S</kbd></button>
      <a class="button opt" href={`api/lines/${state.active}/recording.mcap`} download={`${line.scene.name}.mcap`} title="The recording of this line, MCAP">Recording</a>
      <button onClick={() => setTheme(theme === 'dark' ? 'light' : 'dark')} title="Light or dark (T)">{theme === 'dark' ? 'Light' : 'Dark'}</button>
      <button onClick={() => setDialog('keys')} title="All keys (?)" aria-label="All keys">?</button>
    </header>
    <Side state={state} line={line} run={run} at={at} change={change} placing={placing} setPlacing={setPlacing} />
    <main class="mid">
      <h1 class="sr">{line.scene.extra.title || line.scene.name}</h1>
      <Arena link={link} line={line} others={others} time={() => time.current()} follow={follow} setFollow={setFollow} measuring={measuring} forces={forces} placing={placing}
        onBeacon={(name, x, y, gesture) => stream({ do: 'edit', gesture, set: [[`arena.beacon.${name}.position`, `[${x.toFixed(3)}, ${y.toFixed(3)}]`]] })}
        onGround={(x, y) => { setPlacing(false); void run({ do: 'add-beacon', position: [Number(x.toFixed(3)), Number(y.toFixed(3))] }); }} onSeek={seek} />
      <div class="tools">
        <button aria-pressed={follow === 'follow'} onClick={() => setFollow('follow')} title="Keep the robot in the middle">Follow <kbd>F</kbd></button>
        <button aria-pressed={follow === 'fit'} onClick={() => setFollow('fit')} title="Show the whole arena">Fit <kbd>0</kbd></button>
        <button aria-pressed={measuring} onClick={() => setMeasuring(!measuring)} title="Distance and angle between two points: click both">Measure <kbd>M</kbd></button>
        <button aria-pressed={forces} onClick={() => setForces(!forces)} title="Contact forces with their friction limits">Forces <kbd>G</kbd></button>
      </div>
      <section class="card who" aria-label="Lines">
        <h2>{others.length > 0 ? 'Running along' : 'One line'}</h2>
        <ul>
          <li><svg width="24" height="8" aria-hidden="true"><path d="M0 4H24" stroke="#7ad151" stroke-width="4" /></svg><span>{about.name}, {about.what}</span><em>this one</em></li>
          {others.map(({ about: one, line: own, color: name, dash }) => <li>
            <svg width="24" height="8" aria-hidden="true"><path d="M0 4H24" style={{ stroke: `var(--${name})` }} stroke-width="1.6" stroke-dasharray={dash ? '5 3' : undefined} /></svg>
            {one.kind === 'ghost' ? <span>{one.name}</span> : <button class="bare" title={`Go on with line ${one.name}`} onClick={() => void run({ do: 'activate', line: one.id })}>{one.name}, {one.what}</button>}
            <em>{apart(line, own, t)}</em>
            <button class="x" aria-label={`Leave out ${one.name}`} title="Leave out" onClick={() => void run(one.kind === 'ghost' ? { do: 'ghost', level: one.name, on: false } : { do: 'drop', line: one.id })}>×</button></li>)}
        </ul>
        <div class="along"><span>run along</span>{['kinematic', 'rolling', 'slip'].map(level => <button class="chip" disabled={state.robots.every(r => r.level === level)} aria-pressed={state.ghosts.includes(level)} title={`The same task at level ${level} beside this run`} onClick={() => void run({ do: 'ghost', level, on: !state.ghosts.includes(level) })}>{level}</button>)}</div>
      </section>
      {newtons && <div class="card key" aria-label="Forces"><svg width="30" height="14" aria-hidden="true"><path d="M0 4h22" style={{ stroke: 'var(--blue)' }} stroke-width="2.2" /><path d="M21 1l7 3l-7 3z" style={{ fill: 'var(--blue)' }} /><path d="M0 11h22" style={{ stroke: 'var(--vermilion)' }} stroke-width="2.2" /><path d="M21 8l7 3l-7 3z" style={{ fill: 'var(--vermilion)' }} /></svg>forces, left and right{line.run.arena.friction ? <><svg width="16" height="16" aria-hidden="true"><circle cx="8" cy="8" r="6.5" fill="none" style={{ stroke: 'var(--vermilion)' }} stroke-dasharray="1.5 3" stroke-linecap="round" /></svg>limit μN {newtons}</> : null}</div>}
      {error && <div class="error" role="alert"><b>{error.path || 'Not done'}</b><span>{error.problem}</span>{error.hint && <em>{error.hint}</em>}<button class="x" aria-label="Close" onClick={() => setError(null)}>×</button></div>}
      {state.notice && <div class="error quiet" role="status"><span>{state.notice}</span></div>}
      {done && <div class="error quiet" role="status"><span>{done}</span></div>}
      {!link.isOpen && <div class="error" role="alert"><b>No connection</b><span>The studio does not answer. What was driven stays with it; this page joins again by itself.</span></div>}
      {hand && <div class="card drive" role="status"><span>You drive <b>{hand.name}</b>:</span>{['W', 'A', 'S', 'D'].map(k => <kbd>{k}</kbd>)}<span>{state.playing ? '' : '– press Space to let time run'}</span></div>}
      {placing && <div class="card drive" role="status">Click where the beacon shall stand; Esc to leave it.</div>}
    </main>
    <aside class="right" id="plots" tabIndex={-1} aria-label="Plots">
      <div class="bar"><h2>Plots</h2>{span && <button onClick={() => setSpan(null)} title="The whole time (double click)">All time</button>}<button onClick={() => setSpecs(preferred(line))} title="The plots that suit this scenario">Reset</button>
        <a class="button" title="What is plotted, as CSV" href={`api/series?line=${state.active}&from=0&to=${end}&points=8192&signals=${encodeURIComponent(specs.flatMap(s => s.lines.map(l => l.signal)).slice(0, 60).join(','))}`} download={`${line.scene.name}.csv`}>CSV</a></div>
      <Plots link={link} line={line} other={compared} specs={specs} setSpecs={setSpecs} time={() => time.current()} onSeek={seek} span={span} setSpan={setSpan} theme={theme} events={events} duration={about.duration} />
      <Signals line={line} add={path => { const signal = line.scene.signals.find(s => s.path === path); if (signal) setSpecs([...specs, { title: path.split('.').slice(1).join('.'), unit: signal.unit, lines: [{ signal: path, label: '', role: 'main' }] }]); }} />
    </aside>
    <Transport state={state} line={line} about={about} lines={driven} times={id => link.lines.get(id)?.end ?? 0} t={t} cursor={cursorShown} replaying={replaying.current} play={play} seek={seek} run={run} branch={branch} />
    {dialog === 'keys' && <Dialog title="Keys" close={() => setDialog(null)}><dl class="keys">{KEYS.map(([key, what]) => <><dt>{key.split(', ').map((k, i) => <>{i > 0 && ', '}<kbd>{k}</kbd></>)}</dt><dd>{what}</dd></>)}</dl></Dialog>}
    {dialog === 'save' && <Save name={state.saved ?? `${line.scene.name}-mine`} close={() => setDialog(null)} save={(name, replace) => link.do({ do: 'save', name, replace }).then(value => { setDialog(null); say(`Saved. It repeats this run bit for bit: ${(value as { run: string }).run}`); })} />}
  </>;
}

function focusIn(id: string): void {
  const section = document.getElementById(id);
  const first = section?.querySelector('select,input,button') as HTMLElement | null;
  (first ?? section)?.focus();
}

function verdictOf(about: LineState): string {
  if (!about.over) return '';
  const mark = about.verdict === 'passed' ? '✓' : about.verdict === 'failed' ? '✗' : '■';
  return `${mark} ${about.name} ${about.verdict ?? 'is over'}, ${(about.end ?? 0).toFixed(2)} s${about.verdict === 'failed' ? `: ${about.sentence}` : ''}`;
}

/** How far two lines are apart at an instant. */
function apart(one: Line, other: Line, t: number): string {
  const robot = one.run.robots[0]?.name;
  if (!robot || t > Math.max(one.end, other.end) + 1e-9) return '';
  const d = Math.hypot(one.at(`robot.${robot}.pose.x`, t) - other.at(`robot.${robot}.pose.x`, t), one.at(`robot.${robot}.pose.y`, t) - other.at(`robot.${robot}.pose.y`, t));
  return Number.isFinite(d) ? d < 1 ? `${(d * 100).toFixed(1)} cm off` : `${d.toFixed(2)} m off` : '';
}

function preferred(line: Line): PlotSpec[] {
  const wanted = ['speed', 'motor voltage', 'wheel torque', 'friction used', 'clearance'];
  const known = new Set(line.scene.signals.map(s => s.path));
  const plots = line.scene.plots.map(p => ({ ...p, title: p.title.replace(' by the contact force', '').replace(' to the nearest beacon', ''), lines: p.lines.filter(l => known.has(l.signal)).slice(0, 6) })).filter(p => p.lines.length > 0);
  const rank = (p: PlotSpec) => { const k = wanted.findIndex(w => p.title.includes(w)); return k < 0 ? wanted.length : k; };
  return plots.map((p, i) => [p, i] as const).sort((a, b) => rank(a[0]) - rank(b[0]) || a[1] - b[1]).map(([p]) => p).slice(0, 5);
}

function legendForce(line: Line): string {
  return forceScale(line.run) > 0 ? ' ' : '';
}

function Signals({ line, add }: { line: Line; add: (path: string) => void }) {
  const [filter, setFilter] = useState('');
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const found = line.scene.signals.filter(s => words.every(w => s.path.toLowerCase().includes(w)));
  return <details class="signals"><summary>Signals <span>{line.scene.signals.length}</span></summary>
    <input type="text" placeholder="find: left torque" aria-label="Find signals" value={filter} onInput={e => setFilter((e.target as HTMLInputElement).value)} />
    <ul>{found.slice(0, 200).map(s => <li><button draggable onDragStart={e => e.dataTransfer?.setData('text/plain', s.path)} onClick={() => add(s.path)} title={`${s.path}, ${s.unit}: drag it into a plot, or press Enter`}>{s.path.replace(/^robot\./, '')}<em>{s.unit}</em></button></li>)}</ul>
    {found.length === 0 && <p class="empty">No signal has all these words.</p>}
  </details>;
}

function Dialog({ title, close, children }: { title: string; close: () => void; children: preact.ComponentChildren }) {
  const box = useRef<HTMLDialogElement>(null);
  useEffect(() => { box.current?.showModal(); }, []);
  return <dialog ref={box} aria-label={title} onClose={close} onClick={e => { if (e.target === box.current) close(); }}><div class="inside"><header><h2>{title}</h2><button class="x" aria-label="Close" onClick={close}>×</button></header>{children}</div></dialog>;
}

function Save({ name, close, save }: { name: string; close: () => void; save: (name: string, replace: boolean) => Promise<void> }) {
  const [text, setText] = useState(name);
  const [replace, setReplace] = useState(false);
  const [refusal, setRefusal] = useState<Refusal | null>(null);
  return <Dialog title="Save scenario" close={close}><form onSubmit={e => { e.preventDefault(); save(text, replace).catch(setRefusal); }}>
    <label>Name <input type="text" value={text} onInput={e => setText((e.target as HTMLInputElement).value)} autoFocus /> .toml</label>
    <p class="note">Beside the scenario that was opened. With every change at its time it repeats this line bit for bit.</p>
    <label class="check"><input type="checkbox" checked={replace} onChange={e => setReplace((e.target as HTMLInputElement).checked)} /> replace a file of this name</label>
    {refusal && <p class="wrong" role="alert">{refusal.problem}{refusal.hint && `; ${refusal.hint}`}</p>}
    <footer><button type="button" onClick={close}>Cancel</button><button class="main" type="submit">Save</button></footer>
  </form></Dialog>;
}
