// Where panels stand: two columns of one or two areas, each with tabs. What is open is remembered.

import { useEffect, useRef, useState } from 'preact/hooks';
import { DARK, LIGHT } from '../../../sim/web/draw.js';
import { find } from './carrier';
import type { PanelInfo } from './net';
import type { Frame, Look, OwnHost, OwnModule, Panel, PanelScene } from './panel';
import { Sandbox } from './sandbox';
import type { Studio } from './studio';
import { remember, remembered } from './memory';
import { tr } from './words';

export const AREAS = ['main', 'under', 'right', 'below'] as const;
export type Area = typeof AREAS[number];
/** The areas in which something can be put under another. */
const SPLITS: Partial<Record<Area, Area>> = { main: 'under', right: 'below' };
export type Layout = Record<Area, { open: string[]; shown: string | null }>;

export const FIRST: Layout = {
  main: { open: ['arena', 'space', 'profile'], shown: 'arena' }, under: { open: [], shown: null },
  right: { open: ['plots', 'table', 'plugins'], shown: 'plots' }, below: { open: [], shown: null },
};

/** Opens a panel in an area, and takes it from where it was. */
export function opened(layout: Layout, panel: string, area: Area, before?: string): Layout {
  const next = structuredClone(layout);
  for (const one of AREAS) {
    const { open, shown } = next[one];
    const place = open.indexOf(panel);
    if (place < 0 || one === area && before === undefined) continue;
    open.splice(place, 1);
    if (shown === panel && one !== area) next[one].shown = open[Math.min(place, open.length - 1)] ?? null;
  }
  const { open } = next[area];
  if (!open.includes(panel)) open.splice(before === undefined || !open.includes(before) ? open.length : open.indexOf(before), 0, panel);
  next[area].shown = panel;
  return next;
}

export function closed(layout: Layout, panel: string): Layout {
  const next = structuredClone(layout);
  for (const one of AREAS) {
    const place = next[one].open.indexOf(panel);
    if (place < 0) continue;
    next[one].open.splice(place, 1);
    if (next[one].shown === panel) next[one].shown = next[one].open[Math.min(place, next[one].open.length - 1)] ?? null;
  }
  return next;
}

export function where(layout: Layout, panel: string): Area | null {
  return AREAS.find(area => layout[area].open.includes(panel)) ?? null;
}

/** Panels of the project are named so, apart from the built-in ones. */
export const OF_PROJECT = 'project:';

type Props = { studio: Studio; layout: Layout; setLayout: (layout: Layout) => void; built: Record<string, OwnModule>; project: PanelInfo[] };

export function Column({ areas, ...props }: Props & { areas: Area[] }) {
  const shown = areas.filter((area, k) => k === 0 || props.layout[area].open.length > 0);
  return <>{shown.map(area => <Tabs key={area} area={area} {...props} />)}</>;
}

export function titleOf(panel: string, built: Record<string, OwnModule>): string {
  return panel.startsWith(OF_PROJECT) ? titles.get(panel) ?? panel.slice(OF_PROJECT.length) : tr(built[panel]?.title ?? panel);
}
/** What panels of the project call themselves, once they were connected. */
const titles = new Map<string, string>();

function Tabs({ area, studio, layout, setLayout, built, project }: Props & { area: Area }) {
  const [, redraw] = useState(0);
  const { open, shown } = layout[area];
  const known = (panel: string) => panel in built || project.some(one => OF_PROJECT + one.name === panel);
  const all = [...Object.keys(built), ...project.map(one => OF_PROJECT + one.name)];
  const menu = useRef<HTMLDivElement>(null);
  const id = `menu-${area}`;
  const choose = (next: Layout) => { menu.current?.hidePopover(); setLayout(next); };
  const drop = (event: DragEvent, before?: string) => {
    const panel = event.dataTransfer?.getData('application/x-appell-panel');
    if (!panel) return;
    event.preventDefault();
    event.stopPropagation();
    setLayout(opened(layout, panel, area, before));
  };
  const keys = (event: KeyboardEvent) => {
    const by = event.key === 'ArrowRight' ? 1 : event.key === 'ArrowLeft' ? -1 : 0;
    const next = open[open.indexOf(shown ?? '') + by];
    if (!by || !next) return;
    event.preventDefault();
    event.stopPropagation();
    setLayout(opened(layout, next, area));
    const bar = event.currentTarget as HTMLElement;
    setTimeout(() => (bar.querySelector('[aria-selected=true]') as HTMLElement)?.focus());
  };
  const split = SPLITS[area];
  return <section class="area" data-area={area} aria-label={shown ? titleOf(shown, built) : tr('Panels')}>
    <div class="tabs" onDragOver={event => { if (event.dataTransfer?.types.includes('application/x-appell-panel')) event.preventDefault(); }} onDrop={event => drop(event)}>
      <div role="tablist" aria-label={tr('Panels')} onKeyDown={keys}>{open.map(panel => <button role="tab" key={panel} id={`tab-${panel}`} aria-selected={panel === shown} tabIndex={panel === shown ? 0 : -1} draggable
        title={tr('Drag it to another place')} onClick={() => setLayout(opened(layout, panel, area))}
        onDragStart={event => event.dataTransfer?.setData('application/x-appell-panel', panel)} onDrop={event => drop(event, panel)}>{titleOf(panel, built)}</button>)}</div>
      {shown && open.length > 0 && <button class="x" aria-label={`${tr('Close')} ${titleOf(shown, built)}`} title={tr('Close this panel')} onClick={() => setLayout(closed(layout, shown))}>×</button>}
      <button class="plus" popovertarget={id} aria-label={tr('Open a panel')} title={tr('Open a panel')}>+</button>
      <span class="grow" />
      <span class="slot" id={`slot-${area}`} />
      <div class="menu" popover="auto" id={id} ref={menu} role="group" aria-label={tr('Panels')} onToggle={event => {
        // Under its button, within the window.
        const button = (event.currentTarget as HTMLElement).parentElement?.querySelector('.plus')?.getBoundingClientRect();
        const box = event.currentTarget as HTMLElement;
        if (button) { box.style.left = `${Math.min(button.left, innerWidth - box.offsetWidth - 8)}px`; box.style.top = `${Math.min(button.bottom + 4, innerHeight - box.offsetHeight - 8)}px`; }
      }}>
        {all.map(panel => <div class="choice"><button onClick={() => choose(opened(layout, panel, area))}>{titleOf(panel, built)}{panel.startsWith(OF_PROJECT) && <em>{tr('of the project')}</em>}{where(layout, panel) && <em>{tr('open')}</em>}</button>
          {split && <button title={tr('Open it under the others')} aria-label={`${titleOf(panel, built)}: ${tr('Open it under the others')}`} onClick={() => choose(opened(layout, panel, split))}>▽</button>}</div>)}
        <div class="choice"><button onClick={() => choose(structuredClone(FIRST))}>{tr('Lay out anew')}</button></div>
      </div>
    </div>
    {shown && known(shown) && <Box key={shown + (project.find(one => OF_PROJECT + one.name === shown)?.version ?? '')} panel={shown} module={built[shown] ?? null} studio={studio} named={() => redraw(n => n + 1)} close={() => setLayout(closed(layout, shown))} />}
    {shown && !known(shown) && <div class="panel"><div class="closed"><p><b>{titleOf(shown, built)}</b></p><p>{tr('This panel is not there any more.')}</p><button onClick={() => setLayout(closed(layout, shown))}>{tr('Close')}</button></div></div>}
    {!shown && <div class="panel"><div class="closed"><p>{tr('Open a panel with + above.')}</p></div></div>}
  </section>;
}

const settingsOf = (panel: string): Record<string, unknown> => remembered<Record<string, Record<string, unknown>>>('panels', {})[panel] ?? {};
const keepSettings = (panel: string, settings: Record<string, unknown>) => remember('panels', { ...remembered<Record<string, object>>('panels', {}), [panel]: settings });

/** One open panel: it is connected while it is shown. */
function Box({ panel, module, studio, named, close }: { panel: string; module: OwnModule | null; studio: Studio; named: () => void; close: () => void }) {
  const root = useRef<HTMLDivElement>(null);
  const latest = useRef(studio);
  latest.current = studio;
  const [attempt, tryAgain] = useState(0);
  const [problem, setProblem] = useState('');
  const drawNow = useRef<() => void>(() => {});

  useEffect(() => {
    const element = root.current;
    if (!element || problem) return;
    let isOver = false;
    let connected: Panel | null = null;
    let sandbox: Sandbox | null = null;
    let watched: string[] = [];
    let shown = '';
    let handle = 0;
    const values: Record<string, number> = {};
    let asking = false, asked = '';
    const fail = (error: unknown) => {
      if (isOver) return;
      isOver = true;
      end();
      setProblem(String(error instanceof Error ? error.message || error : error));
    };
    const look = (): Look => ({ theme: latest.current.theme, language: document.documentElement.lang, colors: { ...LIGHT, ...(latest.current.theme === 'dark' ? DARK : {}), chrome: getComputedStyle(document.documentElement).getPropertyValue('--chrome').trim(), font: getComputedStyle(document.documentElement).getPropertyValue('--font') } });
    const scene = (): PanelScene => {
      const { scene } = latest.current.line;
      return { name: scene.name, title: scene.extra.title ?? '', signals: scene.signals, robots: scene.extra.robots, arena: scene.extra.arena, period: scene.period };
    };
    const series = (paths: Iterable<string>, from: number, to: number, points: number) => latest.current.link.series(latest.current.line.id, [...paths], from, to, points);
    const keep = (changed: Record<string, unknown>) => keepSettings(panel, { ...settingsOf(panel), ...changed });
    const frame = (): Frame => {
      const { line, state } = latest.current;
      const time = latest.current.time();
      for (const path of watched) if (path in line.run.signals) values[path] = line.at(path, time);
      // Those that the page does not have are asked for.
      const far = watched.filter(path => !(path in line.run.signals));
      const key = `${line.id} ${time} ${far}`;
      if (far.length > 0 && !asking && key !== asked) {
        asking = true;
        asked = key;
        void latest.current.link.series(line.id, far, time, time, 8).then(found => {
          asking = false;
          const at = Math.max(0, found.times.findLastIndex(t => t <= time + 1e-9));
          far.forEach((path, k) => { values[path] = found.columns[k]?.[at] ?? NaN; });
          shown = '';
        });
      }
      return { time, end: line.end, playing: state.playing, line: line.id, values: Object.fromEntries(watched.map(path => [path, values[path] ?? NaN])) };
    };
    const end = () => {
      isOver = true;
      cancelAnimationFrame(handle);
      sandbox?.close();
      drawNow.current = () => {};
      try { connected?.disconnect?.(); } catch { /* it goes anyway */ }
      element.replaceChildren();
    };
    if (module) {
      const host: OwnHost = {
        root: element, fail, keep, series,
        get scene() { return scene(); }, get look() { return look(); }, get settings() { return { ...module.settings, ...settingsOf(panel) }; },
        watch: paths => { watched = [...paths]; }, seek: t => latest.current.seek(t), studio: () => latest.current,
      };
      const draw = () => { try { connected?.draw(frame()); } catch (error) { fail(error); } };
      void (async () => {
        try {
          const panel = await module.connect(host);
          if (isOver) { panel.disconnect?.(); return; }
          connected = panel;
          drawNow.current = draw;
          draw();
        } catch (error) { fail(error); }
      })();
    } else {
      const name = panel.slice(OF_PROJECT.length);
      let style = '', drawn = '';
      const tick = () => {
        handle = requestAnimationFrame(tick);
        if (!sandbox) return;
        const now = latest.current.theme + document.documentElement.lang;
        if (now !== style) { if (style) sandbox.restyle(look()); style = now; shown = ''; }
        const { name } = latest.current.line.scene;
        const next = frame();
        const key = `${next.time} ${next.end} ${next.playing} ${next.line}`;
        // Another scenario, or another table of signals: the panel begins anew.
        if (drawn && drawn !== name) { drawn = name; tryAgain(n => n + 1); return; }
        drawn = name;
        if (key !== shown) { shown = key; sandbox.draw(next); }
      };
      find(`panels/${name}.js`).then(async answer => {
        if (!answer.ok) throw new Error(`panels/${name}.js ${tr('cannot be read')}: ${answer.status}`);
        const source = await answer.text();
        if (isOver) return;
        sandbox = new Sandbox(element, name, { source, scene: scene(), look: look(), settings: settingsOf(panel) }, {
          keep, series, watch: paths => { watched = paths; shown = ''; }, seek: t => latest.current.seek(t), resized: () => { shown = ''; },
          key: key => document.body.dispatchEvent(new KeyboardEvent('keydown', { ...key, bubbles: true })),
          began: title => { if (title && titles.get(panel) !== title) { titles.set(panel, title); named(); } },
          failed: fail,
        });
        tick();
      }).catch(fail);
    }
    return end;
  }, [attempt, problem, panel, module]);
  useEffect(() => drawNow.current());

  return <div class="panel" role="tabpanel" aria-labelledby={`tab-${panel}`} data-panel={panel}>
    <div class="panel-root" ref={root} />
    {problem && <div class="closed" role="alert"><p><b>{titleOf(panel, {})}</b> {tr('was closed')}:</p><pre>{problem}</pre><p>{tr('The run goes on untouched.')}</p>
      <div><button class="main" onClick={() => { setProblem(''); tryAgain(n => n + 1); }}>{tr('Connect again')}</button> <button onClick={close}>{tr('Close')}</button></div></div>}
  </div>;
}
