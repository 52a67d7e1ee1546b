// Stacked plots on one time axis. The server thins what is far apart: a million rows cost a page no more than
// its pixels.

import { useEffect, useRef, useState } from 'preact/hooks';
import uPlot from 'uplot';
import { significant } from '../../../sim/web/draw.js';
import type { Line, Link, PlotSpec } from './net';
import { color } from './look';

const ROLES: Record<string, string> = { left: 'blue', right: 'vermilion', main: 'ink', command: 'reference', reference: 'reference' };
const FREE = ['blue', 'vermilion', 'green', 'purple', 'sky', 'orange'];

export function colorsOf(spec: PlotSpec): string[] {
  let other = 0;
  return spec.lines.map(line => ROLES[line.role] ?? FREE[other++ % FREE.length]);
}

type Props = {
  link: Link; line: Line; other: Line | null; specs: PlotSpec[]; time: () => number; onSeek: (t: number) => void; setSpecs: (specs: PlotSpec[]) => void;
  span: [number, number] | null; setSpan: (span: [number, number] | null) => void; theme: string; events: { n: number; t: number }[]; duration: number;
};

export function Plots(props: Props) {
  const list = useRef<HTMLDivElement>(null);
  const [over, setOver] = useState(-1);
  const drop = (event: DragEvent, at: number) => {
    event.preventDefault();
    setOver(-1);
    const path = event.dataTransfer?.getData('text/plain') ?? '';
    const signal = props.line.scene.signals.find(s => s.path === path);
    if (!signal) return;
    const line = { signal: path, label: path.split('.').slice(2).join('.'), role: 'other' };
    const specs = props.specs.slice();
    const spec = specs[at];
    if (spec && spec.unit === signal.unit && spec.lines.length < 6) specs[at] = { ...spec, lines: [...spec.lines, line] };
    else specs.splice(at < 0 ? specs.length : at + 1, 0, { title: path.split('.').slice(1).join('.'), unit: signal.unit, lines: [{ ...line, role: 'main', label: '' }] });
    props.setSpecs(specs);
  };
  return <div class="plots" ref={list} onDragOver={event => { event.preventDefault(); setOver(-2); }} onDragLeave={() => setOver(-1)} onDrop={event => drop(event, -1)} data-over={over === -2}>
    {props.specs.length === 0 && <p class="empty">Drag a signal here from the list below, or press <kbd>Enter</kbd> on one, to plot it over time.</p>}
    {props.specs.map((spec, i) => <div key={spec.title + spec.lines.map(l => l.signal).join()} onDrop={event => { event.stopPropagation(); drop(event, i); }}>
      <Plot {...props} spec={spec} last={i === props.specs.length - 1} onClose={() => props.setSpecs(props.specs.filter(one => one !== spec))} />
    </div>)}
  </div>;
}

function Plot(props: Props & { spec: PlotSpec; last: boolean; onClose: () => void }) {
  const holder = useRef<HTMLDivElement>(null);
  const latest = useRef(props);
  latest.current = props;
  const { spec } = props;
  const names = colorsOf(spec);
  const scale = spec.scale ?? 1;
  const unit = scale === 1000 && spec.unit === 'mm' ? 'mm' : spec.unit === '1' ? '' : spec.unit;

  useEffect(() => {
    const root = holder.current;
    if (!root) return;
    const readout = root.parentElement?.querySelector('.readout') as HTMLElement;
    const paint = names.map(name => color(name));
    const faint = color('reference');
    const width = root.clientWidth;
    let asking = false, shownRows = -1, shownSpan = '', handle = 0, last = 0;
    const withOther = props.other !== null;
    const series: uPlot.Series[] = [{}];
    if (withOther) for (const _ of spec.lines) series.push({ stroke: faint, width: 1, points: { show: false } });
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
      for (const event of latest.current.events) {
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
    const room = (root.closest('.plots')?.clientHeight ?? 500) / Math.max(1, props.specs.length) - 21;
    const size = { width, height: Math.max(72, Math.min(190, Math.floor(room) - 2)) };
    const plot = new uPlot({
      ...size, series, pxAlign: 0, padding: [6, 10, props.last ? 0 : 4, 0],
      legend: { show: false },
      cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: false } },
      scales: { x: { time: false, range: () => range() }, y: { range: (_, low, high) => {
        const [a, b] = [Math.min(low ?? 0, spec.limits?.some(l => l.value === 0) ? 0 : low ?? 0), high ?? 1];
        const room = Math.max((b - a) * 0.08, 1e-6 * Math.max(1, Math.abs(a)), 1e-9);
        return [a - room, b + room];
      } } },
      axes: [{ ...axis, show: props.last, size: 24, values: (_, splits) => splits.map(v => v === null ? '' : String(Number(v.toPrecision(6))).replace('-', '−')) }, { ...axis, size: 46, space: 26, values: (_, splits) => splits.map(v => String(Number(v.toPrecision(4))).replace('-', '−')) }],
      hooks: { draw: [marks], setSelect: [u => {
        if (u.select.width > 5) latest.current.setSpan([u.posToVal(u.select.left, 'x'), u.posToVal(u.select.left + u.select.width, 'x')]);
        u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      }] },
    }, [[], ...series.slice(1).map(() => [])] as uPlot.AlignedData, root);
    function range(): [number, number] {
      const { span, line, other } = latest.current;
      return span ?? [0, Math.max(line.end, other ? other.end : 0, 1e-3)];
    }
    const over = plot.over;
    let downAt = NaN;
    over.addEventListener('pointerdown', e => { downAt = e.clientX; });
    over.addEventListener('pointerup', e => { if (Math.abs(e.clientX - downAt) < 4) latest.current.onSeek(plot.posToVal(e.clientX - over.getBoundingClientRect().left, 'x')); });
    over.addEventListener('dblclick', () => latest.current.setSpan(null));
    const needle = document.createElement('div');
    needle.className = 'needle';
    over.append(needle);

    const resize = new ResizeObserver(() => {
      const room = (root.closest('.plots')?.clientHeight ?? 500) / Math.max(1, latest.current.specs.length) - 23;
      plot.setSize({ width: root.clientWidth, height: Math.max(72, Math.min(190, Math.floor(room))) });
      shownRows = -1;
    });
    resize.observe(root);
    const column = root.closest('.plots');
    if (column) resize.observe(column);

    const frame = (now: number) => {
      handle = requestAnimationFrame(frame);
      const { link, line, other, span } = latest.current;
      const rows = line.run.time.length + (other ? other.run.time.length : 0);
      const spanText = String(span);
      const t = latest.current.time();
      const x = plot.valToPos(t, 'x');
      needle.style.transform = `translateX(${Number.isFinite(x) ? x : -9}px)`;
      if (!asking && (spanText !== shownSpan || rows !== shownRows && now - last > 80)) {
        asking = true;
        last = now;
        const [from, to] = range();
        const points = Math.max(60, Math.round(root.clientWidth * Math.min(2, devicePixelRatio)));
        const signals = spec.lines.map(l => l.signal);
        const mine = link.series(line.id, signals, from, to, points);
        const theirs = other ? link.series(other.id, signals, from, to, points) : null;
        void Promise.all([mine, theirs]).then(([mine, theirs]) => {
          asking = false;
          shownRows = rows;
          shownSpan = spanText;
          const scaled = (values: Float32Array) => scale === 1 ? values : values.map(v => v * scale);
          const table = [Array.from(mine.times), ...mine.columns.map(c => Array.from(scaled(c)))] as uPlot.AlignedData;
          if (theirs) {
            const before = [Array.from(theirs.times), ...theirs.columns.map(c => Array.from(scaled(c), v => Number.isNaN(v) ? null : v))] as uPlot.AlignedData;
            plot.setData(uPlot.join([before, table], [before.slice(1).map(() => 2), table.slice(1).map(() => 2)]) as uPlot.AlignedData);
          } else plot.setData(table);
        });
      }
      // What the plot shows at the time that is looked at.
      const times = plot.data[0];
      if (times && times.length > 0 && readout) {
        let low = 0, high = times.length - 1;
        while (low < high) { const m = (low + high + 1) >> 1; if (times[m] <= t) low = m; else high = m - 1; }
        const first = plot.data.length - spec.lines.length;
        const words = spec.lines.map((_, k) => {
          let at = low;
          const column = plot.data[first + k];
          while (at > 0 && (column[at] === null || column[at] === undefined)) at--;
          const value = column[at];
          return typeof value === 'number' && Number.isFinite(value) ? significant(value, 3) : '–';
        });
        const spans = readout.children;
        words.forEach((word, k) => { if (spans[k] && spans[k].lastChild && spans[k].lastChild.textContent !== word) spans[k].lastChild.textContent = word; });
      }
    };
    handle = requestAnimationFrame(frame);
    return () => { cancelAnimationFrame(handle); resize.disconnect(); plot.destroy(); };
  }, [props.line, props.other, props.theme, props.last, props.specs.length]);

  return <section class="plot" aria-label={`Plot of ${spec.title}`}>
    <header><h3>{spec.title}{unit && <span>, {unit}</span>}</h3><span class="readout">{spec.lines.map((line, k) => <b class={`t-${names[k]}`} title={line.signal}><span>{spec.lines.length > 1 ? line.label + ' ' : ''}</span><span class="v">–</span></b>)}</span>
      <button class="x" title="Take this plot away" aria-label={`Take away the plot of ${spec.title}`} onClick={props.onClose}>×</button></header>
    <div ref={holder} />
  </section>;
}
