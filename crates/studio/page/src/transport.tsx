// Time: what runs, how fast, where one looks, and the lines that branched.

import { useRef } from 'preact/hooks';
import { multiples, niceStep } from '../../../sim/web/draw.js';
import type { Line, LineState, State } from './net';
import { tr } from './words';

export const SPEEDS = [0.01, 0.1, 0.25, 0.5, 1, 2, 5, 10, 100, 0];

type Props = {
  state: State; line: Line; about: LineState; lines: LineState[]; times: (id: number) => number; t: number; cursor: number | null; replaying: boolean;
  play: () => void; seek: (t: number | null) => void; run: (command: Record<string, unknown>) => Promise<unknown>; branch: () => void;
};

export function Transport({ state, line, about, lines, times, t, cursor, replaying, play, seek, run, branch }: Props) {
  const rail = useRef<HTMLDivElement>(null);
  const longest = Math.max(1e-3, ...lines.map(one => times(one.id)));
  const top = about.over ? longest : Math.max(longest, Math.min(about.duration, Math.ceil(longest / 5 + 0.2) * 5));
  const where = (s: number) => `${Math.min(100, s / top * 100)}%`;
  const runs = state.playing || replaying;
  const pick = (event: PointerEvent) => {
    const box = rail.current?.getBoundingClientRect();
    if (box) seek(Math.max(0, Math.min(line.end, (event.clientX - box.left) / box.width * top)));
  };
  const step = niceStep(top, 9);
  const shownLines = lines.slice(-4);
  return <footer class="bot">
    <div class="tp">
      <button aria-label={tr('To the beginning')} title={`${tr('To the beginning')} (Home)`} onClick={() => seek(0)}><svg viewBox="0 0 16 16"><path d="M11 3v10L4 8zM3 3h1.6v10H3z" /></svg></button>
      <button class="main" aria-label={runs ? tr('Pause') : tr('Play')} title={(runs ? tr('Pause') : tr('Play')) + ' (Space)'} onClick={play}><svg viewBox="0 0 16 16">{runs ? <path d="M3.5 2.5h3v11h-3zM9.5 2.5h3v11h-3z" /> : <path d="M4 2.5v11l9-5.5z" />}</svg></button>
      <button aria-label={tr('One row on')} title={`${tr('One row on')} (→)`} onClick={() => { if (cursor === null && !about.over) void run({ do: 'step' }); else seek(t + line.scene.period); }}><svg viewBox="0 0 16 16"><path d="M5 3v10l7-5zM11.4 3H13v10h-1.6z" /></svg></button>
      <select aria-label={tr('speed')} title={`${tr('Seconds of the run per second')} (, .)`} value={state.speed} onChange={e => void run({ do: 'speed', factor: Number((e.target as HTMLSelectElement).value) })}>{SPEEDS.map(s => <option value={s}>{s === 0 ? tr('free') : `${s}×`}</option>)}</select>
      <span class="time"><b data-time>{t.toFixed(2)}</b> s</span>
      <span class="of">{about.over ? `${tr('of')} ${line.end.toFixed(2)} s` : cursor === null ? `${tr('limit')} ${about.duration} s` : `${tr('of')} ${line.end.toFixed(2)} s`}</span>
      <button onClick={branch} title={`${tr('A new line from here on; this one stays')} (B)`}>{tr('Branch here')}</button>
      {cursor !== null && !about.over && <button onClick={() => seek(null)} title={`${tr('To the newest instant')} (End)`}>{tr('To now')}</button>}
      <button onClick={() => void run({ do: 'restart' }).then(() => seek(null))} title={tr('Drive this line again from its beginning')}>{tr('Restart')}</button>
      <span class="grow" />
      <span class="hint"><kbd>Space</kbd> {tr('play')} <kbd>←</kbd><kbd>→</kbd> {tr('step')} <kbd>B</kbd> {tr('branch')} <span class="far"><kbd>W</kbd><kbd>A</kbd><kbd>S</kbd><kbd>D</kbd> {tr('steer')}</span> <kbd>?</kbd> {tr('all keys')}</span>
    </div>
    <div class="lanes">
      <div class="names">{shownLines.map(one => <button class="bare" aria-pressed={one.id === state.active} title={one.id === state.active ? `${tr('Line')} ${one.name}: ${one.what}` : `${tr('Go on with line')} ${one.name}: ${one.what}`} onClick={() => { if (one.id !== state.active) void run({ do: 'activate', line: one.id }); }}>{one.name.replace('trial ', '#')}</button>)}</div>
      <div class="rail" ref={rail}>
        <div class="grab" role="slider" tabIndex={0} aria-label={tr('time')} aria-valuemin={0} aria-valuemax={Number(line.end.toFixed(2))} aria-valuenow={Number(t.toFixed(2))} aria-valuetext={`${t.toFixed(2)} s`}
          onPointerDown={e => { (e.target as Element).setPointerCapture(e.pointerId); pick(e); }} onPointerMove={e => { if (e.buttons & 1) pick(e); }} />
        {shownLines.map(one => { const from = one.parent?.[1] ?? 0; const active = one.id === state.active; return <div class="lane" data-active={active}>
          <i class="whole" style={{ left: where(from), right: `calc(100% - ${where(times(one.id))})` }} />
          {active && <i class="gone" style={{ left: '0', right: `calc(100% - ${where(t)})` }} />}
          {one.parent && <i class="fork" style={{ left: where(from) }} title={`${tr('branch of')} ${one.parent[0]}, ${from.toFixed(2)} s: ${one.what}`} />}
          {active && one.events.slice(-60).map(e => <button class="mark" data-kind={e.kind} aria-label={`${tr('event')} ${e.n}, ${e.t.toFixed(2)} s: ${e.text}`} title={`${e.t.toFixed(2)} s: ${e.text}${e.detail ? `, ${e.detail}` : ''}`} style={{ left: where(e.t) }} onClick={() => seek(e.t)}>{e.kind === 'change' || e.kind === 'swap' ? '' : e.n}</button>)}
          {one.over && <span class="end" data-verdict={one.verdict} style={{ left: where(times(one.id)) }}>{one.verdict === 'passed' ? '✓' : one.verdict === 'failed' ? '✗' : '■'}</span>}
        </div>; })}
        <div class="ticks" aria-hidden="true">{multiples(0, top, step).map((v: number) => <span style={{ left: where(v) }}>{Number(v.toFixed(6))}{v + step > top ? ' s' : ''}</span>)}</div>
        <i class="now" style={{ left: where(t) }} />
      </div>
    </div>
  </footer>;
}
