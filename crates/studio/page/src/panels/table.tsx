// Numbers: what came of each line, beside the one looked at, and values of signals at an instant.

import { useState } from 'preact/hooks';
import { significant } from '../../../../sim/web/draw.js';
import type { Metric } from '../net';
import { componentPanel, type ViewProps } from '../panel';
import { tr } from '../words';
import { shortPath } from './plots';

const text = (metric: Metric | undefined) => metric === undefined || metric.value === null ? '–' : typeof metric.value === 'number' ? significant(metric.value, 4) : String(metric.value);

function TableView({ studio, host, frame }: ViewProps) {
  const { state, about, others } = studio;
  const [filter, setFilter] = useState(String(host.settings.filter ?? ''));
  const shown = [about, ...others.map(o => o.about)].slice(0, 4);
  const robot = about.metrics?.[0]?.robot ?? state.robots[0]?.name;
  const of = (line: typeof about) => line.metrics?.find(one => one.robot === robot)?.metrics ?? [];
  const names = [...new Set(shown.flatMap(line => of(line).map(m => m.name)))];
  const words = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const signals = studio.line.scene.signals.filter(s => words.length > 0 && words.every(w => s.path.toLowerCase().includes(w))).slice(0, 40);
  host.watch(signals.map(s => s.path));
  return <div class="view scrolls table-view">
    <h2>{tr('Figures')}</h2>
    {names.length === 0 ? <p class="empty">{tr('Figures stand here when a line is over: let time run, or choose free as its speed.')}</p>
      : <table data-lines={shown.length}><thead><tr><th scope="col">{robot}</th>{shown.map((line, k) => <th scope="col" title={line.what}>{line.name}{k > 0 && <em>− {about.name}</em>}</th>)}</tr></thead><tbody>
        <tr><th scope="row">{tr('verdict')}</th>{shown.map(line => <td data-verdict={line.verdict}>{line.verdict ? tr(line.verdict) : '–'}</td>)}</tr>
        {names.map(name => {
          const all = shown.map(line => of(line).find(m => m.name === name));
          const unit = all.find(Boolean)?.unit ?? '';
          const own = all[0]?.value;
          return <tr><th scope="row" title={name}>{name}{unit && unit !== '1' && <em>, {unit}</em>}</th>{all.map((metric, k) => <td>{text(metric)}{k > 0 && typeof own === 'number' && typeof metric?.value === 'number' && <em>{metric.value >= own ? '+' : '−'}{significant(Math.abs(metric.value - own), 2)}</em>}</td>)}</tr>;
        })}
      </tbody></table>}
    <h2>{tr('Signals')} <span>{frame.time.toFixed(2)} s</span></h2>
    <input type="text" class="find" placeholder={tr('find: left torque')} aria-label={tr('Find signals')} value={filter} onInput={e => { const value = (e.target as HTMLInputElement).value; setFilter(value); host.keep({ filter: value }); }} />
    {signals.length > 0 && <table><tbody>{signals.map(s => <tr><th scope="row" title={s.path}>{shortPath(s.path)}<em>, {s.unit}</em></th><td>{Number.isFinite(frame.values[s.path]) ? significant(frame.values[s.path], 4) : '–'}</td></tr>)}</tbody></table>}
  </div>;
}

export const table = componentPanel('Table', TableView);
