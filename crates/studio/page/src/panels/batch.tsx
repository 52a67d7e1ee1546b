// A batch: how two of its figures lie together and each by itself; a click drives a trial again.

import { useEffect, useRef, useState } from 'preact/hooks';
import { label, multiples, niceStep, px, significant, textWidth, tickText } from '../../../../sim/web/draw.js';
import { find } from '../carrier';
import { color } from '../look';
import { componentPanel, type ViewProps } from '../panel';
import { tr } from '../words';

type Column = { name: string; unit: string; group: string };
type Variant = { name: string; trials: number[]; passed: boolean[]; values: (number | null)[][]; count: number; passes: number };
type BatchFigures = { scenario: string; title: string; seed: number; has_task: boolean; columns: Column[]; every: number; variants: Variant[] };

const BINS = 36;
const BOX = { top: 62, right: 62, bottom: 46 };
/** How near to a point a click must be, px. */
const NEAR = 14;

function BatchView({ host, studio }: ViewProps) {
  const { state, run, about } = studio;
  const [data, setData] = useState<BatchFigures | null>(null);
  const [missing, setMissing] = useState(false);
  const [of, choose] = useState({ variant: 0, x: Number(host.settings.x ?? -1), y: Number(host.settings.y ?? -1) });
  const [hover, setHover] = useState<number | null>(null);
  const [size, setSize] = useState<[number, number]>([600, 400]);
  const [wanted, setWanted] = useState('');
  const holder = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);

  useEffect(() => {
    setMissing(!state.batch);
    if (!state.batch) { setData(null); return; }
    find('api/batch').then(async answer => { if (answer.ok) setData(await answer.json()); else setMissing(true); }).catch(host.fail);
  }, [state.batch, state.file]);
  useEffect(() => {
    const element = holder.current;
    if (!element) return;
    const watch = new ResizeObserver(() => setSize([element.clientWidth, element.clientHeight]));
    watch.observe(element);
    return () => watch.disconnect();
  }, [data === null]);

  // What varies, and of the figures the first that does.
  const spread = (k: number) => { const values = data?.variants[0].values[k].filter((v): v is number => v !== null) ?? []; return values.length > 1 && Math.max(...values.slice(0, 5000)) > Math.min(...values.slice(0, 5000)); };
  const usable = data ? data.columns.map((_, k) => k).filter(spread) : [];
  const x = usable.includes(of.x) ? of.x : usable[0] ?? 0;
  const y = usable.includes(of.y) ? of.y : usable.find(k => k !== x && data?.columns[k].group !== 'drawn' && data?.columns[k].name !== 'time') ?? usable[1] ?? x;
  const variant = data?.variants[Math.min(of.variant, data.variants.length - 1)];
  const [width, height] = size;
  const right = width - BOX.right, bottom = height - BOX.bottom;
  const range = (k: number): [number, number] => {
    let [low, high] = [Infinity, -Infinity];
    for (const one of data?.variants ?? []) for (const v of one.values[k] ?? []) if (v !== null) { if (v < low) low = v; if (v > high) high = v; }
    if (!(high >= low)) return [0, 1];
    const room = (high - low) * 0.04 || Math.abs(high) * 0.1 || 1;
    return [low - room, high + room];
  };
  const [x0, x1] = range(x), [y0, y1] = range(y);
  const sx = niceStep(x1 - x0, Math.max(3, Math.round(width / 110))), sy = niceStep(y1 - y0, Math.max(3, Math.round(height / 60)));
  // The numbers of the upright axis, and its name beside them.
  const left = 40 + Math.max(20, ...multiples(y0, y1, sy).map((v: number) => textWidth(tickText(v, sy), 11.5)));
  const at = (v: number) => left + (v - x0) / (x1 - x0) * (right - left);
  const up = (v: number) => bottom - (v - y0) / (y1 - y0) * (bottom - BOX.top);
  const shownTrial = about.name.startsWith('trial ') ? about.trial : null;

  useEffect(() => {
    const element = canvas.current;
    if (!element || !variant) return;
    const context = element.getContext('2d') as CanvasRenderingContext2D;
    const fine = devicePixelRatio;
    [element.width, element.height] = [width * fine, height * fine];
    context.scale(fine, fine);
    const many = variant.trials.length > 4000;
    const [good, bad] = [color('blue'), color('vermilion')];
    context.globalAlpha = many ? 0.35 : 0.75;
    variant.trials.forEach((_, k) => {
      const [vx, vy] = [variant.values[x][k], variant.values[y][k]];
      if (vx === null || vy === null) return;
      const [px, py] = [at(vx), up(vy)];
      const passed = variant.passed[k] || !data?.has_task;
      context.beginPath();
      if (passed) { context.fillStyle = good; context.arc(px, py, many ? 1.6 : 3, 0, 7); context.fill(); }
      else { context.strokeStyle = bad; context.lineWidth = 1.8; context.moveTo(px - 3.5, py - 3.5); context.lineTo(px + 3.5, py + 3.5); context.moveTo(px - 3.5, py + 3.5); context.lineTo(px + 3.5, py - 3.5); context.stroke(); }
    });
    context.globalAlpha = 1;
    for (const k of [shownTrial === null ? -1 : variant.trials.indexOf(shownTrial), hover ?? -1]) {
      const [vx, vy] = [variant.values[x][k], variant.values[y][k]];
      if (k < 0 || vx === null || vy === null) continue;
      context.strokeStyle = color('ink');
      context.lineWidth = 2;
      context.beginPath();
      context.arc(at(vx), up(vy), 7, 0, 7);
      context.stroke();
    }
  });

  if (missing) return <div class="closed"><p>{tr('No batch is open.')}</p><pre>appell batch scenarios/robust.toml --out runs/robust{'\n'}appell studio runs/robust</pre></div>;
  if (!data || !variant) return <div class="closed"><p>{tr('The batch is being read …')}</p></div>;
  const nearest = (event: PointerEvent | MouseEvent): number | null => {
    const box = (event.currentTarget as Element).getBoundingClientRect();
    const [ex, ey] = [event.clientX - box.left, event.clientY - box.top];
    let best = NEAR, found: number | null = null;
    variant.trials.forEach((_, k) => {
      const [vx, vy] = [variant.values[x][k], variant.values[y][k]];
      if (vx === null || vy === null) return;
      const d = Math.hypot(at(vx) - ex, up(vy) - ey);
      if (d < best) { best = d; found = k; }
    });
    return found;
  };
  const replay = (trial: number) => void run({ do: 'trial', variant: variant.name, trial });
  const title = (k: number) => `${data.columns[k].name}${data.columns[k].unit && data.columns[k].unit !== '1' ? `, ${data.columns[k].unit}` : ''}`;
  let svg = multiples(x0, x1, sx).map((v: number) => `<path d="M${px(at(v))} ${BOX.top}V${px(bottom)}" class="grid"/>${label(at(v), bottom + 16, tickText(v, sx), 'tick', 'middle')}`).join('');
  svg += multiples(y0, y1, sy).map((v: number) => `<path d="M${left} ${px(up(v))}H${px(right)}" class="grid"/>${label(left - 8, up(v) + 4, tickText(v, sy), 'tick', 'end')}`).join('');
  // Each figure by itself, along the rims: those that passed, and on top those that did not.
  const rim = (k: number, low: number, high: number, upright: boolean) => {
    const counts = Array.from({ length: BINS }, () => [0, 0]);
    variant.values[k].forEach((v, i) => { if (v !== null) counts[Math.min(BINS - 1, Math.floor((v - low) / (high - low) * BINS))][variant.passed[i] || !data.has_task ? 0 : 1]++; });
    const most = Math.max(1, ...counts.map(([a, b]) => a + b));
    const room = (upright ? BOX.right : BOX.top) - 18;
    return counts.map(([a, b], n) => {
      const [la, lb] = [a / most * room, b / most * room];
      if (upright) { const h = (bottom - BOX.top) / BINS, top = bottom - (n + 1) * h; return `<rect x="${px(right + 4)}" y="${px(top)}" width="${px(la)}" height="${px(h - 1)}" class="f-blue"/><rect x="${px(right + 4 + la)}" y="${px(top)}" width="${px(lb)}" height="${px(h - 1)}" class="f-vermilion"/>`; }
      const w = (right - left) / BINS, from = left + n * w;
      return `<rect x="${px(from)}" y="${px(BOX.top - 4 - la)}" width="${px(w - 1)}" height="${px(la)}" class="f-blue"/><rect x="${px(from)}" y="${px(BOX.top - 4 - la - lb)}" width="${px(w - 1)}" height="${px(lb)}" class="f-vermilion"/>`;
    }).join('');
  };
  // The upright name is beside the middle of its axis, or as near as there is room for it.
  const half = textWidth(title(y), 13) / 2 + 4;
  const middle = Math.min(Math.max((BOX.top + bottom) / 2, half), Math.max(half, height - half));
  svg += rim(x, x0, x1, false) + rim(y, y0, y1, true);
  svg += label((left + right) / 2, height - 10, title(x), 'bold', 'middle') + `<text class="bold" text-anchor="middle" transform="translate(15 ${px(middle)}) rotate(-90)">${title(y)}</text>`;
  const pick = (which: 'x' | 'y', now: number) => <label>{which} <select value={now} onChange={e => { const next = { ...of, [which]: Number((e.target as HTMLSelectElement).value) }; choose(next); host.keep({ [which]: next[which] }); }}>{usable.map(k => <option value={k}>{title(k)}</option>)}</select></label>;
  const pointed = hover === null ? null : hover;
  return <div class="view batch-view">
    <div class="bar"><b>{data.title || data.scenario}</b><span>{data.has_task ? `${variant.passes} ${tr('of')} ${variant.count} ${tr('passed')}` : `${variant.count} ${tr('trials')}`}{data.every > 1 ? `; ${tr('every')} ${data.every}.` : ''}</span>
      {data.variants.length > 1 && <select aria-label={tr('variant')} value={of.variant} onChange={e => choose({ ...of, variant: Number((e.target as HTMLSelectElement).value) })}>{data.variants.map((one, k) => <option value={k}>{one.name}</option>)}</select>}
      {pick('x', x)}{pick('y', y)}
      <form onSubmit={e => { e.preventDefault(); const trial = Number(wanted); if (Number.isInteger(trial)) replay(trial); }}><label>{tr('trial')} <input type="number" min="0" max={variant.count - 1} value={wanted} onInput={e => setWanted((e.target as HTMLInputElement).value)} /></label><button type="submit">{tr('Drive it again')}</button></form></div>
    <div class="scatter" ref={holder} onPointerMove={e => setHover(nearest(e))} onPointerLeave={() => setHover(null)} onClick={e => { /* What was told of: a click has whole pixels, and points lie closer. */ const found = hover ?? nearest(e); if (found !== null) replay(variant.trials[found]); }} style={{ cursor: pointed === null ? 'default' : 'pointer' }}>
      <svg class="picture" width={width} height={height} role="img" aria-label={`${title(y)} ${tr('against')} ${title(x)}`} dangerouslySetInnerHTML={{ __html: svg }} /><canvas ref={canvas} style={{ width: `${width}px`, height: `${height}px` }} aria-hidden="true" />
      {pointed !== null && <p class="tip">{tr('trial')} {variant.trials[pointed]}: {significant(Number(variant.values[x][pointed]), 4)}; {significant(Number(variant.values[y][pointed]), 4)}{data.has_task ? `, ${tr(variant.passed[pointed] ? 'passed' : 'failed')}` : ''} · {tr('click to drive it again')}</p>}
    </div>
  </div>;
}

export const batch = componentPanel('Batch', BatchView);
