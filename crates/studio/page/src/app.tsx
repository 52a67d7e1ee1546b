// The page: what stands where, the keys, and the time that is looked at.

import { useEffect, useMemo, useRef, useState } from 'preact/hooks';
import { DEMO, find } from './carrier';
import { Column, FIRST, where, opened, type Layout } from './dock';
import { type Theme } from './look';
import { remember, remembered } from './memory';
import { Link, type Line, type LineState, type PlotSpec, type Refusal } from './net';
import { BUILT } from './panels';
import { preferred } from './panels/plots';
import { takeFile } from './save';
import { Side } from './side';
import type { Follow, Studio } from './studio';
import { SPEEDS, Transport } from './transport';
import { LANGUAGES, spoken, speak, tr, type Language } from './words';

const KEYS: [string, string][] = [
  ['Space', 'play or pause'], ['← →', 'one row back, on'], ['Shift ← →', 'one second back, on'], ['Home End', 'first, latest instant'], [', .', 'slower, faster'],
  ['B', 'branch here'], ['Ctrl Z, Ctrl Shift Z', 'undo, redo'], ['Ctrl S', 'save the scenario'], ['F', 'follow the robot'], ['0', 'fit the arena'], ['+ −', 'closer, farther'],
  ['M', 'measure'], ['G', 'forces on, off'], ['W A S D', 'drive, once “hand” has the command'], ['T', 'light or dark'], ['1 2 3', 'to set-up, parameters, plots'], ['?', 'these keys'],
];

/** Colors of what runs along. */
const GHOSTS = ['purple', 'sky', 'green', 'orange', 'blue', 'vermilion'];

export function App() {
  const [, redraw] = useState<number>(0);
  const [theme, setTheme] = useState<Theme>(remembered('theme', matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'));
  const [language, setLanguage] = useState<Language>(spoken());
  const [follow, setFollow] = useState<Follow>('fit');
  const [measuring, setMeasuring] = useState(false);
  const [placing, setPlacing] = useState(false);
  const [forces, setForces] = useState(true);
  const [error, setError] = useState<Refusal | null>(null);
  const [dialog, setDialog] = useState<'keys' | 'save' | null>(null);
  const [span, setSpan] = useState<[number, number] | null>(null);
  const [plotted, setPlotted] = useState<Record<string, PlotSpec[]>>(remembered('plots', {}));
  const [layout, layOut] = useState<Layout>({ ...FIRST, ...remembered<Partial<Layout>>('layout', {}) });
  const setLayout = (next: Layout) => { layOut(next); remember('layout', next); };
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

  // A page without a server has no other interface for programs.
  if (DEMO) Object.assign(window, { appell: { find, do: (command: Record<string, unknown>) => link.do(command), get state() { return link.state; } } });
  // Before anything is drawn: canvases take their colors from it.
  document.documentElement.dataset.theme = theme;
  useEffect(() => { remember('theme', theme); dispatchEvent(new Event('studio-redraw')); redraw(n => n + 1); }, [theme]);

  const state = link.state;
  const line = state ? link.lines.get(state.active) ?? null : null;
  const suited = useMemo(() => line ? preferred(line) : [], [line]);
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

  // A batch is opened to be looked at.
  useEffect(() => { if (state?.batch && !where(layout, 'batch')) setLayout(opened(layout, 'batch', 'under')); }, [state?.batch]);

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
  const pushed = useRef({ forward: 0, yaw_rate: 0 });
  const hand = state?.robots.find(robot => robot.driving === 'hand') ?? null;
  const drive = () => {
    const keys = held.current;
    if (!hand) return;
    const speed = 0.5, turn = 1.2;
    const wanted: Record<string, number> = { forward: Math.max(-1, Math.min(1, Number(keys.has('w')) - Number(keys.has('s')) + pushed.current.forward)) * speed, yaw_rate: Math.max(-1, Math.min(1, Number(keys.has('a')) - Number(keys.has('d')) + pushed.current.yaw_rate)) * turn };
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
  // A gamepad drives by its left stick, twenty times a second, in steps of 5 %: what moves less is noise.
  const steer = useRef(drive);
  steer.current = drive;
  useEffect(() => {
    if (!hand) return;
    const poll = setInterval(() => {
      const pad = navigator.getGamepads?.().find(one => one && one.axes.length >= 2);
      if (!pad) return;
      const stick = (axis: number) => { const v = -(pad.axes[axis] ?? 0); return Math.abs(v) < 0.1 ? 0 : Math.round(v * 20) / 20; };
      const next = { forward: stick(1), yaw_rate: stick(0) };
      if (next.forward === pushed.current.forward && next.yaw_rate === pushed.current.yaw_rate) return;
      pushed.current = next;
      steer.current();
    }, 50);
    return () => { clearInterval(poll); pushed.current = { forward: 0, yaw_rate: 0 }; };
  }, [hand?.name]);

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

  if (!state || !line || !about) return <main class="wait"><h1>Appell Studio</h1><p role="status">{link.problem || (DEMO ? tr('The studio is loaded into this page …') : link.isOpen ? tr('The run is being opened …') : tr('Looking for the studio … If it has ended, start it again with “appell studio”.'))}</p></main>;

  const driven = state.lines.filter(one => one.kind !== 'ghost');
  const others = state.lines.filter(one => one.id !== state.active && link.lines.has(one.id)).map(one => {
    const ghosts = state.lines.filter(l => l.kind === 'ghost');
    return { about: one, line: link.lines.get(one.id) as Line, color: one.kind === 'ghost' ? GHOSTS[ghosts.indexOf(one) % GHOSTS.length] : 'reference', dash: one.kind === 'ghost' };
  });
  const specs = plotted[line.scene.name] ?? suited;
  const setSpecs = (next: PlotSpec[] | null) => { const { [line.scene.name]: _, ...rest } = plotted; const all = next ? { ...rest, [line.scene.name]: next } : rest; setPlotted(all); remember('plots', all); };
  const events = about.events.filter(e => e.kind !== 'change').map(e => ({ n: e.n, t: e.t }));
  const t = cursorShown ?? end;
  const studio: Studio = {
    link, state, line, about, others, time: () => time.current(), seek, run, stream, at, follow, setFollow, measuring, setMeasuring, forces, setForces, placing, setPlacing,
    hand, specs, setSpecs, span, setSpan, theme, events, open: panel => setLayout(opened(layout, panel, where(layout, panel) ?? (panel === 'arena' ? 'main' : 'right'))),
  };
  const dock = { studio, layout, setLayout, built: BUILT, project: link.panels };

  return <>
    <header class="top">
      <span class="brand"><svg width="20" height="20" viewBox="0 0 20 20" aria-hidden="true"><path d="M2 15C6 15 6 5 10 5s4 10 8 10" fill="none" stroke="currentColor" stroke-width="2" /><circle cx="10" cy="13.5" r="2" fill="#E69F00" /></svg>Appell</span>
      <label class="file"><span class="sr">{tr('Scenario')}</span>
        <select value={state.file.replace(/\.toml$/, '')} title={tr('Scenario; the others of its folder can be opened')} onChange={e => void run({ do: 'open', name: (e.target as HTMLSelectElement).value }).then(() => { cursor.current = null; showCursor(null); setSpan(null); setFollow('fit'); })}>
          {!state.scenarios.includes(state.file.replace(/\.toml$/, '')) && <option value={state.file.replace(/\.toml$/, '')}>{state.file}</option>}
          {state.scenarios.map(name => <option value={name}>{name}.toml</option>)}
        </select>{state.saved ? <em>{tr('saved as')} {state.saved}.toml</em> : state.changed && <em>{tr('changed')}</em>}</label>
      {DEMO && <span class="demo" title={tr('The whole studio runs in this page; nothing is sent anywhere. Batches, plug-ins other than WebAssembly and panels of a folder need the program.')}>{tr('demo')}</span>}
      <span class="verdict" role="status" data-verdict={about.verdict ?? ''}>{verdictOf(about)}</span>
      <span class="grow" />
      <button onClick={() => void run({ do: 'undo' })} disabled={!state.undo} title={state.undo ? `${tr('Undo')}: ${state.undo}` : tr('Nothing to undo')}>{tr('Undo')} <kbd>Ctrl Z</kbd></button>
      <button class="opt" onClick={() => void run({ do: 'redo' })} disabled={!state.redo} title={state.redo ? `${tr('Redo')}: ${state.redo}` : tr('Nothing to redo')}>{tr('Redo')}</button>
      <button onClick={() => setDialog('save')} title={tr('Save what was done as a scenario that repeats it bit for bit')}>{tr('Save scenario')} <kbd>Ctrl S</kbd></button>
      <a class="button opt" href={`api/lines/${state.active}/recording.mcap`} download={`${line.scene.name}.mcap`} onClick={e => { if (DEMO) { e.preventDefault(); void takeFile(`api/lines/${state.active}/recording.mcap`, `${line.scene.name}.mcap`); } }} title={tr('The recording of this line, MCAP')}>{tr('Recording')}</a>
      <button onClick={() => setTheme(theme === 'dark' ? 'light' : 'dark')} title={`${tr('Light or dark')} (T)`}>{theme === 'dark' ? tr('Light') : tr('Dark')}</button>
      <button onClick={() => setDialog('keys')} title={`${tr('All keys')} (?)`} aria-label={tr('All keys')}>?</button>
      <select class="language" aria-label={tr('Language')} title={tr('Language')} value={language} onChange={e => { const next = (e.target as HTMLSelectElement).value as Language; setLanguage(next); speak(next); }}>{LANGUAGES.map(([code, name]) => <option value={code}>{name}</option>)}</select>
    </header>
    <Side state={state} line={line} run={run} at={at} change={change} placing={placing} setPlacing={setPlacing} />
    <main class="mid">
      <h1 class="sr">{line.scene.extra.title || line.scene.name}</h1>
      <Column areas={['main', 'under']} {...dock} />
      {error && <div class="error" role="alert"><b>{error.path || tr('Not done')}</b><span>{error.problem}</span>{error.hint && <em>{error.hint}</em>}<button class="x" aria-label={tr('Close')} onClick={() => setError(null)}>×</button></div>}
      {state.notice && <div class="error quiet" role="status"><span>{state.notice}</span></div>}
      {done && <div class="error quiet" role="status"><span>{done}</span></div>}
      {!link.isOpen && <div class="error" role="alert"><b>{tr('No connection')}</b><span>{link.problem || tr('The studio does not answer. What was driven stays with it; this page joins again by itself.')}</span></div>}
      {hand && <div class="card drive" role="status"><span>{tr('You drive')} <b>{hand.name}</b>:</span>{['W', 'A', 'S', 'D'].map(k => <kbd>{k}</kbd>)}<span>{state.playing ? '' : `– ${tr('press Space to let time run')}`}</span></div>}
      {placing && <div class="card drive" role="status">{tr('Click where the beacon shall stand; Esc to leave it.')}</div>}
    </main>
    <aside class="right" id="plots" tabIndex={-1} aria-label={tr('Panels')}><Column areas={['right', 'below']} {...dock} /></aside>
    <Transport state={state} line={line} about={about} lines={driven} times={id => link.lines.get(id)?.end ?? 0} t={t} cursor={cursorShown} replaying={replaying.current} play={play} seek={seek} run={run} branch={branch} />
    {dialog === 'keys' && <Dialog title={tr('Keys')} close={() => setDialog(null)}><dl class="keys">{KEYS.map(([key, what]) => <><dt>{key.split(', ').map((k, i) => <>{i > 0 && ', '}<kbd>{k}</kbd></>)}</dt><dd>{tr(what)}</dd></>)}</dl></Dialog>}
    {dialog === 'save' && <Save name={state.saved ?? `${line.scene.name}-mine`} close={() => setDialog(null)} save={(name, replace) => link.do({ do: 'save', name, replace }).then(value => { setDialog(null); if (DEMO) for (const file of [`${name}.toml`, ...new Set(state.plugins.named.map(one => one.file))]) void takeFile(`scenarios/${file}`, file); say(`${tr('Saved. It repeats this run bit for bit:')} ${DEMO ? `appell run ${name}.toml` : (value as { run: string }).run}`); })} />}
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
  return `${mark} ${about.name} ${tr(about.verdict ?? 'is over')}, ${(about.end ?? 0).toFixed(2)} s${about.verdict === 'failed' ? `: ${about.sentence}` : ''}`;
}

function Dialog({ title, close, children }: { title: string; close: () => void; children: preact.ComponentChildren }) {
  const box = useRef<HTMLDialogElement>(null);
  useEffect(() => { box.current?.showModal(); }, []);
  return <dialog ref={box} aria-label={title} onClose={close} onClick={e => { if (e.target === box.current) close(); }}><div class="inside"><header><h2>{title}</h2><button class="x" aria-label={tr('Close')} onClick={close}>×</button></header>{children}</div></dialog>;
}

function Save({ name, close, save }: { name: string; close: () => void; save: (name: string, replace: boolean) => Promise<void> }) {
  const [text, setText] = useState(name);
  const [replace, setReplace] = useState(false);
  const [refusal, setRefusal] = useState<Refusal | null>(null);
  return <Dialog title={tr('Save scenario')} close={close}><form onSubmit={e => { e.preventDefault(); save(text, replace).catch(setRefusal); }}>
    <label>{tr('Name')} <input type="text" value={text} onInput={e => setText((e.target as HTMLInputElement).value)} autoFocus /> .toml</label>
    <p class="note">{DEMO ? tr('Kept in this page and handed to you as a file. With every change at its time it repeats this line bit for bit.') : tr('Beside the scenario that was opened. With every change at its time it repeats this line bit for bit.')}</p>
    <label class="check"><input type="checkbox" checked={replace} onChange={e => setReplace((e.target as HTMLInputElement).checked)} /> {tr('replace a file of this name')}</label>
    {refusal && <p class="wrong" role="alert">{refusal.problem}{refusal.hint && `; ${refusal.hint}`}</p>}
    <footer><button type="button" onClick={close}>{tr('Cancel')}</button><button class="main" type="submit">{tr('Save')}</button></footer>
  </form></Dialog>;
}
