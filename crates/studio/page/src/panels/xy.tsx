// A plot whose axis is not time: a signal against others, or amplitudes by frequency.

import { useEffect, useRef, useState } from 'preact/hooks';
import type { ComponentChildren } from 'preact';
import { label, multiples, niceStep, pathText, px, significant, textWidth, tickText } from '../../../../sim/web/draw.js';
import type { Line, PlotSpec, Series } from '../net';
import { eachPicture } from '../panel';
import type { Studio } from '../studio';
import { tr } from '../words';
import { axisRange, colorsOf, shortPath } from './plots';

/** Newest rows of a curve: they are wanted as they are, since extremes of two signals do not belong together. */
const ROWS_MAX = 16000;

type Props = { studio: Studio; spec: PlotSpec; count: number; fail: (error: unknown) => void; children: ComponentChildren };

const extremes = (columns: Float32Array[]): [number, number] => {
  let [low, high] = [Infinity, -Infinity];
  for (const column of columns) for (const v of column) { if (v < low) low = v; if (v > high) high = v; }
  return high >= low ? [low, high] : [0, 1];
};

/** What is asked for to draw such a plot. */
export function ask(studio: Studio, spec: PlotSpec, bands: number): Promise<Series> {
  const { link, line, span } = studio;
  const [first, to] = span ?? [0, line.end];
  if (spec.kind === 'spectrum') return link.series(line.id, spec.lines.map(l => l.signal), first, to, bands, true);
  return link.series(line.id, [spec.x ?? '', ...spec.lines.map(l => l.signal)], Math.max(first, to - ROWS_MAX * line.scene.period), to, 8192);
}

/** Axes and curves, in a box of so many pixels, and what leads from values to places. */
function chartOf(line: Line, spec: PlotSpec, series: Series | null, width: number, height: number) {
  const isSpectrum = spec.kind === 'spectrum';
  const names = colorsOf(spec);
  const box = { left: 46, right: width - 10, top: 8, bottom: height - 34 };
  const xs = series ? isSpectrum ? Float32Array.from(series.times) : series.columns[0] ?? new Float32Array() : new Float32Array();
  const ys = series ? isSpectrum ? series.columns : series.columns.slice(1) : [];
  const [x0, x1] = isSpectrum ? [0, xs.length > 0 ? xs[xs.length - 1] : 1] : axisRange(...extremes([xs]));
  const [y0, y1] = isSpectrum ? [0, (extremes(ys)[1] || 1) * 1.08] : axisRange(...extremes(ys));
  const x = (v: number) => box.left + (v - x0) / (x1 - x0) * (box.right - box.left);
  const y = (v: number) => box.bottom - (v - y0) / (y1 - y0) * (box.bottom - box.top);
  const [xStep, yStep] = [niceStep(x1 - x0, Math.max(2, Math.round(width / 80))), niceStep(y1 - y0, Math.max(2, Math.round(height / 34)))];
  let svg = multiples(x0, x1, xStep).map((v: number) => `<path d="M${px(x(v))} ${box.top}V${box.bottom}" class="grid"/>${label(x(v), box.bottom + 15, tickText(v, xStep), 'tick', 'middle')}`).join('');
  svg += multiples(y0, y1, yStep).map((v: number) => `<path d="M${box.left} ${px(y(v))}H${box.right}" class="grid"/>${label(box.left - 6, y(v) + 4, tickText(v, yStep), 'tick', 'end')}`).join('');
  ys.forEach((column, k) => { svg += `<path d="${pathText(Array.from(column, (v, i) => [x(xs[i]), y(v)] as [number, number]))}" class="line s-${names[k]}"/>`; });
  const xUnit = line.scene.signals.find(s => s.path === spec.x)?.unit ?? '';
  return { box, xs, ys, x, y, svg, xTitle: isSpectrum ? `${tr('frequency')}, Hz` : `${shortPath(spec.x ?? '')}, ${xUnit}` };
}

const titleOf = (spec: PlotSpec) => `${tr(spec.title)}${spec.kind === 'spectrum' ? ` · ${tr('amplitude')}` : ''}${spec.unit === '1' || !spec.unit ? '' : `, ${spec.unit}`}`;

/** The plot as a picture by itself: its size, and its drawing with title and names of lines. */
export async function pictureOf(studio: Studio, spec: PlotSpec, width: number): Promise<{ svg: string; height: number }> {
  const height = 300;
  const { svg, box, xTitle } = chartOf(studio.line, spec, await ask(studio, spec, width), width, height);
  const names = colorsOf(spec);
  let right = width - 10;
  let keys = '';
  if (spec.lines.length > 1) [...spec.lines.keys()].reverse().forEach(k => {
    const words = spec.lines[k].label;
    keys += label(right, 14, words, 'tick', 'end') + `<path d="M${right - textWidth(words, 11.5) - 24} 10h18" class="line s-${names[k]}"/>`;
    right -= textWidth(words, 11.5) + 40;
  });
  return { svg: `${label(box.left, 15, titleOf(spec), 'bold')}${keys}<g transform="translate(0 22)">${svg}${label((box.left + box.right) / 2, height - 4, xTitle, 'tick', 'middle')}</g>`, height: height + 26 };
}

export function XyPlot(props: Props) {
  const { studio, spec } = props;
  const holder = useRef<HTMLDivElement>(null);
  const latest = useRef(props);
  latest.current = props;
  const [series, setSeries] = useState<Series | null>(null);
  const [size, setSize] = useState<[number, number]>([300, 170]);
  const [hover, setHover] = useState<number | null>(null);
  const isSpectrum = spec.kind === 'spectrum';
  const names = colorsOf(spec);

  useEffect(() => {
    const root = holder.current;
    if (!root) return;
    const resize = new ResizeObserver(() => {
      const room = (root.closest('.plots')?.clientHeight ?? 500) / Math.max(1, latest.current.count) - 23;
      setSize([root.clientWidth, Math.max(130, Math.min(260, Math.floor(room)))]);
    });
    resize.observe(root);
    let asking = false, shown = '', last = 0;
    const stop = eachPicture(props.fail, now => {
      const { line, span, time } = latest.current.studio;
      const key = `${span} ${line.run.time.length}`;
      if (!isSpectrum) root.querySelector('.here')?.setAttribute('transform', where(time()));
      if (asking || key === shown || now - last < 150) return;
      asking = true;
      last = now;
      void ask(latest.current.studio, spec, Math.max(100, root.clientWidth)).then(found => { asking = false; shown = key; setSeries(found); }).catch(props.fail);
    });
    return () => { stop(); resize.disconnect(); };
  }, [studio.line, spec]);

  const [width, height] = size;
  const chart = chartOf(studio.line, spec, series, width, height);
  const { box, xs, ys, x, y, xTitle } = chart;
  let { svg } = chart;
  const x1 = xs.length > 0 ? xs[xs.length - 1] : 1;
  const at = hover === null || !isSpectrum || xs.length === 0 ? null : Math.max(0, Math.min(xs.length - 1, Math.round((hover - box.left) / (box.right - box.left) * x1 / (xs[1] - xs[0] || 1)) - 1));
  if (at !== null) svg += `<path d="M${px(x(xs[at]))} ${box.top}V${box.bottom}" class="event"/>` + ys.map((c, k) => `<circle cx="${px(x(xs[at]))}" cy="${px(y(c[at]))}" r="3" class="f-${names[k]}"/>`).join('');
  // The highest peak, where nothing is pointed at.
  const peak = isSpectrum && ys[0] ? ys[0].reduce((best, v, k) => v > ys[0][best] ? k : best, 0) : null;
  const told = at ?? peak;
  const where = (t: number) => {
    if (!series || isSpectrum || series.times.length === 0) return 'translate(-99 -99)';
    let low = 0, high = series.times.length - 1;
    while (low < high) { const m = (low + high + 1) >> 1; if (series.times[m] <= t) low = m; else high = m - 1; }
    return `translate(${px(x(xs[low]))} ${px(y(ys[0]?.[low] ?? NaN))})`;
  };
  const unit = spec.unit === '1' ? '' : spec.unit;
  return <section class="plot" aria-label={`${tr('Plot of')} ${spec.title}`}>
    <header><h3>{tr(spec.title)}{isSpectrum ? ` · ${tr('amplitude')}` : ''}<span class="unit">{unit && `, ${unit}`}</span></h3>
      <span class="readout" data-hover={at !== null ? '' : undefined}>{isSpectrum && told !== null && xs.length > 0 && <b class="t-reference">{significant(xs[told], 3)} Hz</b>}{isSpectrum ? spec.lines.map((line, k) => <b class={`t-${names[k]}`} title={line.signal}>{told !== null && ys[k] ? significant(ys[k][told], 3) : '–'}</b>) : spec.lines.length > 1 && spec.lines.map((line, k) => <b class={`t-${names[k]}`}>{line.label}</b>)}</span>{props.children}</header>
    <div ref={holder} onPointerMove={event => setHover(event.clientX - (holder.current?.getBoundingClientRect().left ?? 0))} onPointerLeave={() => setHover(null)}>
      <svg class="picture" width={width} height={height} role="img" aria-label={`${spec.title}, ${xTitle}`}>
        <g dangerouslySetInnerHTML={{ __html: svg }} />
        <text class="tick" x={(box.left + box.right) / 2} y={height - 4} text-anchor="middle" data-axis="x">{xTitle}</text>
        <rect data-axis="x" x={box.left} y={box.bottom} width={Math.max(0, box.right - box.left)} height={34} fill="transparent" />
        {!isSpectrum && <circle class="here dot" r="4" transform={where(studio.time())} />}
        {xs.length === 0 && <text class="note" x={box.left + 8} y={box.top + 24}>{tr('Too few rows yet.')}</text>}
      </svg>
    </div>
  </section>;
}
