// What can drive a robot: controllers that are built in, of the scenario, and files beside it.

import { significant } from '../../../../sim/web/draw.js';
import { DEMO, put } from '../carrier';
import { componentPanel, type ViewProps } from '../panel';
import { tr } from '../words';

/** A short time, in the unit that suits it. */
const duration = (s: number) => s < 1e-6 ? `${(s * 1e9).toFixed(0)} ns` : s < 1e-3 ? `${significant(s * 1e6, 2)} µs` : `${significant(s * 1e3, 2)} ms`;

/** A name of a module as the studio lists it. */
const plain = (name: string) => `${name.replace(/\.wasm$/i, '').replace(/[^A-Za-z0-9_-]/g, '-').slice(0, 60)}.wasm`;

function PluginsView({ studio }: ViewProps) {
  const { state, run, at } = studio;
  const { named, files } = state.plugins;
  return <div class="view scrolls plugins-view">
    {state.robots.map(robot => {
      const own = named.filter(one => one.robot === robot.name);
      const failed = (name: string) => studio.about.events.findLast(e => e.robot === robot.name && e.kind === 'fault' && e.text.includes(name));
      return <section aria-label={robot.name}>
        <h2>{robot.name} <span>{robot.level}{robot.task ? `, ${robot.task}` : ''}</span></h2>
        <ul>{robot.controllers.map(controller => {
          const plugin = own.find(one => one.name === controller.name);
          const drives = robot.driving === controller.name;
          const fault = failed(controller.name);
          return <li data-state={fault ? 'failed' : drives ? 'drives' : 'ready'}>
            <i aria-hidden="true" /><b>{controller.name === 'controller' && !plugin ? controller.kind : controller.name}</b><span class="host">{plugin ? plugin.host : tr('built in')}</span>
            <span class="acts">{!drives && <button onClick={() => void run({ do: 'swap', robot: robot.name, to: controller.name, at: at() })}>{tr('Take over')}</button>}
              {plugin && <button title={tr('Take it anew from its file, as a version of its own')} onClick={() => void run({ do: 'reload', robot: robot.name, name: controller.name, at: at() })}>{tr('Reload')}</button>}
              {(plugin?.standby ?? controller.name !== 'controller') && !drives && <button class="x" aria-label={`${tr('Unload')} ${controller.name}`} title={tr('Unload')} onClick={() => void run({ do: 'unload', robot: robot.name, name: controller.name })}>×</button>}</span>
            <em>{plugin ? <><code title={plugin.hash ?? ''}>{plugin.hash?.slice(0, 8) ?? '–'}</code> {plugin.file} · {(plugin.period * 1000).toFixed(plugin.period < 0.01 ? 1 : 0)} ms{plugin.cost && <> · <span title={`${tr('What a step has taken: on average, and at most')} (${plugin.cost.steps})`}>{tr('a step')} {duration(plugin.cost.mean)}, ≤ {duration(plugin.cost.longest)}</span></>}</> : controller.law ?? controller.kind}</em><em class="state">{fault ? fault.text : drives ? tr('drives') : tr('ready')}</em></li>;
        })}
          {robot.offers.filter(name => name !== 'hand').map(name => <li data-state="offered"><i aria-hidden="true" /><b>{name}</b><span class="host">{tr('built in')}</span><span class="acts"><button onClick={() => void run({ do: 'engage', robot: robot.name, with: name, at: at() })}>{tr('Take over')}</button></span><em>{tr('law of path following')}</em></li>)}
          {robot.controllers.length > 0 && files.filter(file => own.every(one => one.file !== file.file)).map(file => <li data-state="offered"><i aria-hidden="true" /><b>{file.file}</b><span class="host">{file.host}</span><span class="acts"><button onClick={() => void run({ do: 'load', robot: robot.name, file: file.file })}>{tr('Load')}</button></span><em><code title={file.hash ?? ''}>{file.hash?.slice(0, 8) ?? '–'}</code> {tr('a file beside the scenario')}</em></li>)}
        </ul>
      </section>;
    })}
    {DEMO && <label class="button add">{tr('Add modules …')}<input type="file" class="sr" accept=".wasm" multiple onChange={e => { const input = e.target as HTMLInputElement; for (const file of input.files ?? []) void put(new File([file], plain(file.name))); input.value = ''; }} /></label>}
    <p class="note">{DEMO ? tr('Here plug-ins are modules of WebAssembly (.wasm), which stay in this page; one that is added again under its name is taken by “Reload”. Other languages need the program.') : tr('Files with .wasm, .py, .so, .fmu beside the scenario are listed. One that is reloaded is copied under a name of its own, so that the saved scenario repeats the run.')}</p>
  </div>;
}

export const plugins = componentPanel('Plug-ins', PluginsView);
