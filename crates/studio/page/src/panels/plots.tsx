// Stacked plots on one time axis, signals against signals, and spectra. The server thins what is far apart: a
// million rows cost a page no more than its pixels.

import { useEffect, useRef, useState } from 'preact/hooks';
import uPlot from 'uplot';
import { significant } from '../../../../sim/web/draw.js';
import { standalone } from '../../../../sim/web/arena.js';
import { drawPlots, panelOf, prefixOf } from '../../../../sim/web/plot.js';
import type { Line, PlotSpec } from '../net';
import { color } from '../look';
import { componentPanel, eachPicture, type ViewProps } from '../panel';
import { saveFile, savePng, saveSvg } from '../save';
import type { Studio } from '../studio';
import { tr } from '../words';
import { pictureOf, XyPlot } from './xy';

const ROLES: Record<string, string> = { left: 'blue', right: 'vermilion', main: 'ink', command: 'reference', reference: 'reference' };
const FREE = ['blue', 'vermilion', 'green', 'purple', 'sky', 'orange'];
/** Lines beside the one looked at that a plot shows. */
const OVERLAYS = 3;
/** Rows of a file of values. */
const FILE_POINTS = 8192;
/** Width of a picture of plots, px. */
const FILE_WIDTH = 1000;

export function colorsOf(spec: PlotSpec): string[] {
  const used = new Set(spec.lines.map(line => ROLES[line.role]));
  const free = FREE.filter(name => !used.has(name));
  let other = 0;
  return spec.lines.map(line => ROLES[line.role] ?? free[other++ % free.length]);
}

export const shortPath = (path: string) => path.split('.').slice(path.startsWith('robot.') ? 2 : 1).join('.');

/** Plots that suit what runs. */
export function preferred(line: Line): PlotSpec[] {
  const wanted = ['speed', 'motor voltage', 'wheel torque', 'friction used', 'clearance'];
  const known = new Set(line.scene.signals.map(s => s.path));
  const plots = line.scene.plots.map(p => ({ ...p, title: p.title.replace(' by the contact force', '').replace(' to the nearest beacon', ''), lines: p.lines.filter(l => known.has(l.signal)).slice(0, 6) })).filter(p => p.lines.length > 0);
  const rank = (p: PlotSpec) => { const k = wanted.findIndex(w => p.title.includes(w)); return k < 0 ? wanted.length : k; };
  return plots.map((p, i) => [p, i] as const).sort((a, b) => rank(a[0]) - rank(b[0]) || a[1] - b[1]).map(([p]) => p).slice(0, 5);
}

const keyOf = (spec: PlotSpec) => [spec.kind, spec.x, spec.title, ...spec.lines.map(l => l.signal)].join();

function PlotsView({ host, studio }: ViewProps) {
  const { line, specs, setSpecs, span, setSpan } = studio;
  const [over, setOver] = useState(-1);
  // The time over which the pointer is, in all plots.
  const hover = useRef<number | null>(null);
  const drop = (event: DragEvent, at: number) => {
    event.preventDefault();
    setOver(-1);
    const signal = line.scene.signals.find(s => s.path === event.dataTransfer?.getData('text/plain'));
    if (!signal) return;
    const next = specs.slice();
    const spec = next[at];
    const added = { signal: signal.path, label: shortPath(signal.path), role: 'other' };
    const onAxis = spec?.kind === 'phase' && (event.target as Element).closest('[data-axis]');
    if (onAxis) next[at] = { ...spec, x: signal.path };
    else if (spec && spec.unit === signal.unit && spec.lines.length < 6) { if (spec.lines.every(l => l.signal !== signal.path)) next[at] = { ...spec, lines: [...spec.lines, added] }; }
    else next.splice(at < 0 ? next.length : at + 1, 0, single(signal));
    setSpecs(next);
  };
  const change = (i: number, spec: PlotSpec | null) => setSpecs(spec ? specs.map((one, k) => k === i ? spec : one) : specs.filter((_, k) => k !== i));
  const last = specs.findLastIndex(spec => (spec.kind ?? 'time') === 'time');
  return <div class="view plots-view">
    <div class="bar">{span && <button onClick={() => setSpan(null)} title={tr('The whole time (double click)')}>{tr('All time')}</button>}<span class="grow" /><button onClick={() => setSpecs(null)} title={tr('The plots that suit this scenario')}>{tr('Reset')}</button>
      {(['svg', 'png', 'csv'] as const).map(kind => <button onClick={() => void take(studio, specs, kind).catch(host.fail)} title={`${tr('What is plotted, as')} ${kind.toUpperCase()}`}>{kind.toUpperCase()}</button>)}</div>
    <div class="plots" onDragOver={event => { event.preventDefault(); setOver(-2); }} onDragLeave={() => setOver(-1)} onDrop={event => drop(event, -1)} data-over={over === -2}>
      {specs.length === 0 && <p class="empty">{tr('Drag a signal here from the list below, or press Enter on one, to plot it over time.')}</p>}
      {specs.map((spec, i) => <div key={keyOf(spec)} onDrop={event => { event.stopPropagation(); drop(event, i); }}>
        {(spec.kind ?? 'time') === 'time' ? <Plot studio={studio} fail={host.fail} spec={spec} hasAxis={i === last} count={specs.length} hover={hover} change={next => change(i, next)} />
          : <XyPlot studio={studio} fail={host.fail} spec={spec} count={specs.length}><Menu studio={studio} spec={spec} change={next => change(i, next)} /></XyPlot>}
      </div>)}
    </div>
    <Signals line={line} add={path => { const signal = line.scene.signals.find(s => s.path === path); if (signal) setSpecs([...specs, single(signal)]); }} />
  </div>;
}

const single = (signal: { path: string; unit: string }): PlotSpec => ({ title: shortPath(signal.path), unit: signal.unit, lines: [{ signal: signal.path, label: shortPath(signal.path), role: 'main' }] });

/** Takes plots along as a picture or as numbers. */
async function take(studio: Studio, specs: PlotSpec[], kind: 'svg' | 'png' | 'csv'): Promise<void> {
  const { link, line, span, theme } = studio;
  const [from, to] = span ?? [0, line.end];
  const paths = [...new Set(specs.flatMap(spec => [...spec.lines.map(l => l.signal), ...(spec.x ? [spec.x] : [])]))].slice(0, 60);
  const { times, columns } = await link.series(line.id, paths, from, to, FILE_POINTS);
  if (kind === 'csv') {
    const unit = (path: string) => line.scene.signals.find(s => s.path === path)?.unit ?? '';
    const rows = Array.from(times, (t, k) => [t, ...columns.map(column => column[k])].join());
    saveFile(`${line.scene.name}.csv`, [['t [s]', ...paths.map(path => `${path} [${unit(path)}]`)].join(), ...rows, ''].join('\n'), 'text/csv');
    return;
  }
  const signals = Object.fromEntries(paths.map((path, k) => [path, { unit: '', values: Array.from(columns[k], v => Number.isNaN(v) ? null : v) }]));
  const overTime = specs.filter(spec => (spec.kind ?? 'time') === 'time');
  // Those over time share an axis; the others stand below, one by one.
  const margin = 16;
  let inside = '', height = 0;
  if (overTime.length > 0) {
    const panels = overTime.map(spec => panelOf({ ...line.run, time: Array.from(times), signals }, spec)).filter(panel => panel !== null);
    const picture = drawPlots(panels, { height: overTime.length === 1 ? 260 : 110, events: line.run.events, t0: from, t1: to, width: FILE_WIDTH - 2 * margin });
    inside = `<g transform="translate(${margin} ${margin})">${picture.svg}</g>`;
    height = picture.height + 2 * margin;
  }
  for (const spec of specs.filter(spec => !overTime.includes(spec))) {
    const picture = await pictureOf(studio, spec, FILE_WIDTH - 2 * margin);
    inside += `<g transform="translate(${margin} ${height + margin})">${picture.svg}</g>`;
    height += picture.height + margin;
  }
  const svg = standalone(inside, FILE_WIDTH, height + margin, specs.map(spec => spec.title).join(', '), theme);
  if (kind === 'svg') saveSvg(line.scene.name, svg); else await savePng(line.scene.name, svg);
}

/** What can be done with one plot. */
function Menu({ studio, spec, change }: { studio: Studio; spec: PlotSpec; change: (spec: PlotSpec | null) => void }) {
  const box = useRef<HTMLDivElement>(null);
  const id = useRef(`plot-${Math.random().toString(36).slice(2)}`);
  const kind = spec.kind ?? 'time';
  const choose = (next: PlotSpec | null) => { box.current?.hidePopover(); change(next); };
  // A hundred robots have thousands of signals: they are listed when someone looks.
  const [isOpen, setOpen] = useState(false);
  const others = isOpen || spec.x ? studio.line.scene.signals.filter(s => isOpen ? spec.lines.every(l => l.signal !== s.path) : s.path === spec.x) : [];
  return <><button class="x" popovertarget={id.current} aria-label={`${tr('Plot of')} ${spec.title}: ${tr('more')}`} title={tr('Kind, files, take away')}>⋯</button>
    <div class="menu" popover="auto" id={id.current} ref={box} onToggle={event => { setOpen((event as ToggleEvent).newState === 'open'); const element = event.currentTarget as HTMLElement; const button = element.previousElementSibling?.getBoundingClientRect(); if (button) { element.style.left = `${Math.min(button.left, innerWidth - element.offsetWidth - 8)}px`; element.style.top = `${Math.min(button.bottom + 4, innerHeight - element.offsetHeight - 8)}px`; } }}>
      <div class="choice"><button aria-pressed={kind === 'time'} onClick={() => choose({ ...spec, kind: 'time', x: undefined })}>{tr('Over time')}</button></div>
      <div class="choice"><button aria-pressed={kind === 'spectrum'} onClick={() => choose({ ...spec, kind: 'spectrum', x: undefined })}>{tr('Spectrum')}</button></div>
      <label class="choice">{tr('Against')} <select value={spec.x ?? ''} onChange={e => { const x = (e.target as HTMLSelectElement).value; if (x) choose({ ...spec, kind: 'phase', x }); }}><option value="">…</option>{others.map(s => <option value={s.path}>{shortPath(s.path)}</option>)}</select></label>
      {(['svg', 'png', 'csv'] as const).map(file => <div class="choice"><button onClick={() => { box.current?.hidePopover(); void take(studio, [spec], file); }}>{tr('Save as')} {file.toUpperCase()}</button></div>)}
      <div class="choice"><button onClick={() => choose(null)}>{tr('Take away')}</button></div>
    </div></>;
}

/** The least and greatest value of an axis: never so near each other that its numbers say nothing. */
export function axisRange(low: number | null, high: number | null, include: number[] = []): [number, number] {
  const a = Math.min(low ?? 0, ...include), b = Math.max(high ?? 1, ...include);
  const size = Math.max(Math.abs(a), Math.abs(b));
  if (size < 1e-12) return [-1, 1];
  const room = b - a < 1e-4 * size ? 0.1 * size : 0.08 * (b - a);
  return [a - room, b + room];
}

export const numberText = (value: number) => String(Number(value.toPrecision(4))).replace('-', '−');

/** Where there is no room for front-left: FL. */
const initials = (name: string) => name.includes('-') ? name.split('-').map(part => part[0]).join('').toUpperCase() : name;

type PlotProps = { studio: Studio; spec: PlotSpec; hasAxis: boolean; count: number; hover: { current: number | null }; change: (spec: PlotSpec | null) => void; fail: (error: unknown) => void };

function Plot(props: PlotProps) {
  const holder = useRef<HTMLDivElement>(null);
  const latest = useRef(props);
  latest.current = props;
  const { spec, studio } = props;
  const names = colorsOf(spec);
  const scale = spec.scale ?? 1;
  const unit = spec.unit === '1' ? '' : spec.unit;
  const overlays = studio.others.slice(0, OVERLAYS);

  useEffect(() => {
    const root = holder.current;
    if (!root) return;
    const section = root.parentElement as HTMLElement;
    const readout = section.querySelector('.readout') as HTMLElement;
    const title = section.querySelector('.unit') as HTMLElement;
    const paint = names.map(name => color(name));
    let asking = false, shownRows = -1, shownSpan = '', last = 0, factor = 1;
    const series: uPlot.Series[] = [{}];
    for (const one of overlays) for (const _ of spec.lines) series.push({ stroke: color(one.color), width: 1, dash: one.dash ? [5, 4] : undefined, points: { show: false } });
    spec.lines.forEach((line, k) => series.push({ stroke: paint[k], width: 1.5, dash: names[k] === 'reference' ? [6, 4] : undefined, points: { show: false }, label: line.label }));
    const axis = { stroke: color('ink2'), font: '11.5px ' + getComputedStyle(document.body).fontFamily, grid: { stroke: color('grid'), width: 1 }, ticks: { show: false } };
    const marks = (u: uPlot) => {
      const { ctx, bbox } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      ctx.lineWidth = devicePixelRatio;
      ctx.setLineDash([]);
      ctx.strokeStyle = color('event');
      for (const event of latest.current.studio.events) {
        const x = Math.round(u.valToPos(event.t, 'x', true)) + 0.5;
        ctx.beginPath(); ctx.moveTo(x, bbox.top); ctx.lineTo(x, bbox.top + bbox.height); ctx.stroke();
      }
      ctx.strokeStyle = color('vermilion');
      ctx.setLineDash([7 * devicePixelRatio, 4 * devicePixelRatio]);
      for (const limit of spec.limits ?? []) {
        const y = Math.round(u.valToPos(limit.value * scale, 'y', true)) + 0.5;
        ctx.beginPath(); ctx.moveTo(bbox.left, y); ctx.lineTo(bbox.left + bbox.width, y); ctx.stroke();
      }
      ctx.restore();
    };
    // As many as there are share the column's height.
    const size = () => {
      const head = (section.querySelector('header') as HTMLElement).offsetHeight;
      const room = (root.closest('.plots')?.clientHeight ?? 500) / Math.max(1, latest.current.count) - head - 3;
      return { width: root.clientWidth, height: Math.max(72, Math.min(190, Math.floor(room))) };
    };
    const zeros = spec.limits?.some(l => l.value === 0) ? [0] : [];
    const plot = new uPlot({
      ...size(), series, pxAlign: 0, padding: [6, 10, props.hasAxis ? 0 : 4, 0],
      legend: { show: false },
      cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: false } },
      scales: { x: { time: false, range: () => range() }, y: { range: (_, low, high) => {
        const [a, b] = axisRange(low, high, zeros);
        const prefix = prefixOf(spec.unit, Math.max(Math.abs(a), Math.abs(b)));
        factor = prefix.factor;
        const shown = unit && `, ${prefix.prefix}${unit}`;
        if (title.textContent !== shown) title.textContent = shown;
        return [a, b];
      } } },
      axes: [{ ...axis, show: props.hasAxis, size: 24, values: (_, splits) => splits.map(v => v === null ? '' : numberText(v)) }, { ...axis, size: 46, space: 26, values: (_, splits) => splits.map(v => numberText(v * factor)) }],
      hooks: { draw: [marks], setSelect: [u => {
        if (u.select.width > 5) latest.current.studio.setSpan([u.posToVal(u.select.left, 'x'), u.posToVal(u.select.left + u.select.width, 'x')]);
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      }] },
    }, [[], ...series.slice(1).map(() => [])] as uPlot.AlignedData, root);
    function range(): [number, number] {
      const { span, line, others } = latest.current.studio;
      return span ?? [0, Math.max(line.end, ...others.slice(0, OVERLAYS).map(o => o.line.end)) || 1];
    }
    const over = plot.over;
    let downAt = NaN;
    const timeAt = (e: PointerEvent) => plot.posToVal(e.clientX - over.getBoundingClientRect().left, 'x');
    over.addEventListener('pointerdown', e => { downAt = e.clientX; });
    over.addEventListener('pointerup', e => { if (Math.abs(e.clientX - downAt) < 4) latest.current.studio.seek(timeAt(e)); });
    over.addEventListener('pointermove', e => { props.hover.current = timeAt(e); });
    over.addEventListener('pointerleave', () => { props.hover.current = null; });
    over.addEventListener('dblclick', () => latest.current.studio.setSpan(null));
    const line = (className: string) => { const element = document.createElement('div'); element.className = className; over.append(element); return element; };
    const needle = line('needle'), hair = line('needle hair');
    const put = (element: HTMLElement, t: number | null) => { const x = t === null ? NaN : plot.valToPos(t, 'x'); element.hidden = !(x >= 0 && x <= over.clientWidth); if (!element.hidden) element.style.transform = `translateX(${x}px)`; };

    const resize = new ResizeObserver(() => { plot.setSize(size()); shownRows = -1; });
    resize.observe(root);
    const column = root.closest('.plots');
    if (column) resize.observe(column);

    const stop = eachPicture(props.fail, now => {
      const { link, line, span } = latest.current.studio;
      const others = latest.current.studio.others.slice(0, OVERLAYS);
      const rows = others.reduce((n, o) => n + o.line.run.time.length, line.run.time.length);
      const spanText = String(span);
      const t = latest.current.studio.time();
      const hovered = props.hover.current;
      put(needle, t);
      put(hair, hovered);
      if (!asking && (spanText !== shownSpan || rows !== shownRows && now - last > 80)) {
        asking = true;
        last = now;
        const [from, to] = range();
        const points = Math.max(60, Math.round(root.clientWidth * Math.min(2, devicePixelRatio)));
        const signals = spec.lines.map(l => l.signal);
        const asked = [...others.map(o => o.line.id), line.id].map(id => link.series(id, signals, from, to, points));
        void Promise.all(asked).then(found => {
          asking = false;
          shownRows = rows;
          shownSpan = spanText;
          if (found.length !== overlays.length + 1) return;
          const tables = found.map(one => [Array.from(one.times), ...one.columns.map(column => Array.from(column, v => Number.isNaN(v) ? null : v * scale))] as uPlot.AlignedData);
          plot.setData(tables.length === 1 ? tables[0] : uPlot.join(tables, tables.map(table => table.map(() => 2))) as uPlot.AlignedData);
        }).catch(props.fail);
      }
      // What the plot shows at the time under the pointer, or else that is looked at.
      const times = plot.data[0];
      if (times && times.length > 0 && readout) {
        const wanted = hovered ?? t;
        let low = 0, high = times.length - 1;
        while (low < high) { const m = (low + high + 1) >> 1; if (times[m] <= wanted) low = m; else high = m - 1; }
        const first = plot.data.length - spec.lines.length;
        spec.lines.forEach((_, k) => {
          let at = low;
          const column = plot.data[first + k];
          while (at > 0 && (column[at] === null || column[at] === undefined)) at--;
          const value = column[at];
          const word = typeof value === 'number' && Number.isFinite(value) ? significant(value * factor, 3) : '–';
          const shown = readout.children[k]?.lastChild;
          if (shown && shown.textContent !== word) shown.textContent = word;
        });
        readout.toggleAttribute('data-hover', hovered !== null);
      }
    });
    return () => { stop(); resize.disconnect(); plot.destroy(); };
  }, [studio.line, overlays.map(o => o.line.id).join(), studio.theme, props.hasAxis, props.count]);

  return <section class="plot" aria-label={`${tr('Plot of')} ${spec.title}`}>
    <header data-many={spec.lines.length > 2}><h3>{tr(spec.title)}<span class="unit">{unit && `, ${unit}`}</span></h3><span class="readout">{spec.lines.map((line, k) => <b class={`t-${names[k]}`} title={line.signal}><span>{spec.lines.length > 1 && <><span class="long">{line.label} </span><span class="short">{initials(line.label)} </span></>}</span><span class="v">–</span></b>)}</span>
      <Menu studio={studio} spec={spec} change={props.change} />
      <button class="x" title={tr('Take this plot away')} aria-label={`${tr('Take away the plot of')} ${spec.title}`} onClick={() => props.change(null)}>×</button></header>
    <div ref={holder} />
  </section>;
}

function Signals({ line, add }: { line: Line; add: (path: string) => void }) {
  const [filter, setFilter] = useState('');
  const [isOpen, setOpen] = useState(false);
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const found = isOpen ? line.scene.signals.filter(s => words.every(w => s.path.toLowerCase().includes(w))) : [];
  return <details class="signals" onToggle={event => setOpen((event.currentTarget as HTMLDetailsElement).open)}><summary>{tr('Signals')} <span>{line.scene.signals.length}</span></summary>
    <input type="text" placeholder={tr('find: left torque')} aria-label={tr('Find signals')} value={filter} onInput={e => setFilter((e.target as HTMLInputElement).value)} />
    <ul>{found.slice(0, 200).map(s => <li><button draggable onDragStart={e => e.dataTransfer?.setData('text/plain', s.path)} onClick={() => add(s.path)} title={`${s.path}, ${s.unit}: ${tr('drag it into a plot, or press Enter')}`}>{s.path.replace(/^robot\./, '')}<em>{s.unit}</em></button></li>)}</ul>
    {isOpen && found.length === 0 && <p class="empty">{tr('No signal has all these words.')}</p>}
  </details>;
}

export const plots = componentPanel('Plots', PlotsView);
