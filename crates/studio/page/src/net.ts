// What the studio says becomes lines that grow, and a state; what people do becomes commands.

import { connect, DEMO, type Carrier } from './carrier';
import { forceScale, largestForce, roundSpeed } from '../../../sim/web/arena.js';
import type { Robot, Run, Tracks } from '../../../sim/web/run.js';

export type RunEvent = { n: number; t: number; robot: string; kind: string; text: string; detail: string | null; position: [number, number] | null };
export type LineState = {
  id: number; name: string; what: string; kind: 'driven' | 'ghost' | 'recorded'; parent: [string, number] | null; over: boolean; /** Whose random numbers it has. */ trial: number;
  verdict: 'passed' | 'failed' | 'stopped' | null; sentence: string | null; end: number | null; duration: number; events: RunEvent[];
  metrics: { robot: string; metrics: Metric[] }[] | null;
};
export type Metric = { name: string; value: number | string | null; unit: string };
/** A panel of the project, and what differs when its file was written anew. */
export type PanelInfo = { name: string; version: string };
export type RobotState = {
  name: string; platform: string; level: string; drive: string; task: string | null; driving: string | null; offers: string[];
  controllers: { name: string; kind: string; law: string | null; file: string | null }[];
};
export type State = {
  file: string; playing: boolean; speed: number; active: number; lines: LineState[]; undo: string | null; redo: string | null;
  changed: boolean; saved: string | null; notice: string | null; scenarios: string[]; changes: [number, string, number][];
  robots: RobotState[]; beacons: { name: string; position: [number, number]; radius: number }[]; ghosts: string[]; batch: boolean;
  /** What can be chosen: robot files, kinds of tasks, recordings that can be laid beside. */
  found: { platforms: string[]; tasks: string[]; recordings: string[] };
  plugins: { named: PluginInfo[]; files: { file: string; host: string; hash: string | null }[] };
};
/** A plug-in that the scenario names. */
export type PluginInfo = { robot: string; name: string; file: string; host: string; hash: string | null; period: number; standby: boolean; /** What a step has taken, s; null before the first. */ cost: { mean: number; longest: number; steps: number } | null };
export type PlotSpec = { title: string; unit: string; lines: { signal: string; label: string; role: string }[]; limits?: { value: number; label: string }[]; scale?: number; kind?: 'time' | 'phase' | 'spectrum'; /** What a phase plot has on its other axis. */ x?: string };
export type Scene = {
  extra: { title?: string; arena: Run['arena']; robots: Robot[] }; name: string; hash: string; step: number; period: number;
  signals: { path: string; unit: string }[]; drawn: number[]; plots: PlotSpec[]; numbers: [string, number, boolean][];
};
export type Refusal = { path: string; problem: string; hint: string };
export type Series = { times: Float64Array; columns: Float32Array[] };

/** A line with the rows that this page has of it. */
export class Line {
  readonly run: Run;
  readonly tracks: Tracks[];
  private columns: number[][] = [];
  private speeds: { forward: number; left: number; speed: number[] }[] = [];
  /** Largest force of each robot, N, and largest speed of all, m/s, in what has come. */
  private largest: number[];
  private fastest = 0;

  constructor(readonly id: number, readonly scene: Scene) {
    const signals: Record<string, { unit: string; values: number[] }> = {};
    for (const k of scene.drawn) {
      const values: number[] = [];
      this.columns.push(values);
      signals[scene.signals[k].path] = { unit: scene.signals[k].unit, values };
    }
    this.run = {
      version: '', scenario: { name: scene.name, title: scene.extra.title ?? '', text: '', file: '', hash: scene.hash, seed: 0, step: scene.step, integrator: '', recorded_period: scene.period },
      verdict: { status: '', sentence: '' }, arena: scene.extra.arena, robots: scene.extra.robots, time: [], signals,
      events: [], metrics: [], statistics: [], plots: [], comparison: null,
    } as Run;
    this.largest = scene.extra.robots.map(() => 0);
    // Tracks keep the arrays that rows are pushed onto.
    const find = (path: string) => signals[path]?.values ?? null;
    this.tracks = scene.extra.robots.map(robot => {
      const own = `robot.${robot.name}.`;
      const of = (wheel: string, name: string) => find(`${own}wheel.${wheel}.${name}`) ?? find(`${own}${wheel}.${name}`);
      const tracks: Tracks = {
        time: this.run.time, x: find(own + 'pose.x') ?? [], y: find(own + 'pose.y') ?? [], yaw: find(own + 'pose.yaw') ?? [],
        attitude: [find(own + 'pose.z'), find(own + 'pose.roll'), find(own + 'pose.pitch')], speed: [],
        wheels: robot.wheels.map(w => ({ spin: of(w.name, 'spin_angle'), steering: of(w.name, 'steering_angle'), along: of(w.name, 'force.longitudinal'), across: of(w.name, 'force.lateral'), load: of(w.name, 'load') })),
      };
      const place = (path: string) => scene.drawn.findIndex(k => scene.signals[k].path === own + path);
      this.speeds.push({ forward: place('twist.forward'), left: place('twist.left'), speed: tracks.speed });
      return tracks;
    });
  }

  get end(): number { return this.run.time.length > 0 ? this.run.time[this.run.time.length - 1] : 0; }

  /** Length of a force in the arena, m/N; 0 where there are none. */
  get forceScale(): number { return forceScale(this.run, this.largest); }
  /** The end of a scale of speeds, m/s. */
  get speedLimit(): number { return roundSpeed(this.fastest); }

  take(times: Float64Array, values: Float32Array): void {
    const width = this.columns.length;
    const before = this.run.time.length;
    for (let k = 0; k < times.length; k++) {
      this.run.time.push(times[k]);
      for (let i = 0; i < width; i++) this.columns[i].push(values[k * width + i]);
      for (const { forward, left, speed } of this.speeds) {
        const own = Math.hypot(forward < 0 ? 0 : values[k * width + forward], left < 0 ? 0 : values[k * width + left]);
        speed.push(own);
        if (own > this.fastest) this.fastest = own;
      }
    }
    this.tracks.forEach((tracks, i) => { this.largest[i] = Math.max(this.largest[i], largestForce(this.run, tracks, before)); });
  }

  /** The value of a drawn signal at an instant, or NaN. */
  at(path: string, t: number): number {
    const values = this.run.signals[path]?.values as number[] | undefined;
    const { time } = this.run;
    if (!values || values.length === 0) return NaN;
    let low = 0, high = time.length - 1;
    while (low < high) { const m = (low + high + 1) >> 1; if (time[m] <= t) low = m; else high = m - 1; }
    const next = Math.min(low + 1, time.length - 1);
    const f = next > low ? Math.min(1, Math.max(0, (t - time[low]) / (time[next] - time[low]))) : 0;
    return values[low] + (values[next] - values[low]) * f;
  }
}

type Waiting = { done: (value: unknown) => void; failed: (refusal: Refusal) => void };

export class Link {
  lines = new Map<number, Line>();
  state: State | null = null;
  panels: PanelInfo[] = [];
  isOpen = false;
  /** Why nothing is heard any more, where it is known. */
  problem = '';
  /** Bytes that came, for the foot of the page. */
  bytes = 0;
  private carrier: Carrier | null = null;
  private next = 1;
  private waiting = new Map<number, Waiting>();
  private asked = new Map<number, (series: Series) => void>();
  private retry = 500;

  constructor(private readonly onState: () => void, private readonly onRows: () => void) { void this.open(); }

  private async open(): Promise<void> {
    const carrier = await connect();
    this.carrier = carrier;
    carrier.onopen = () => { this.isOpen = true; this.retry = 500; this.lines.clear(); this.onState(); };
    carrier.onclose = () => {
      this.isOpen = false;
      this.problem = carrier.problem ?? '';
      for (const { failed } of this.waiting.values()) failed({ path: '', problem: 'the studio does not answer', hint: DEMO ? 'reload the page' : 'start it again; this page joins by itself' });
      this.waiting.clear();
      this.asked.clear();
      this.onState();
      if (DEMO) return;
      setTimeout(() => void this.open(), this.retry);
      this.retry = Math.min(5000, this.retry * 1.5);
    };
    carrier.onmessage = ({ data }) => typeof data === 'string' ? this.hear(data) : this.receive(data as ArrayBuffer);
  }

  private hear(text: string): void {
    this.bytes += text.length;
    const said = JSON.parse(text);
    if (said.kind === 'line') this.lines.set(said.id, new Line(said.id, said.scene));
    else if (said.kind === 'state') {
      this.state = said;
      for (const id of this.lines.keys()) if (!said.lines.some((line: LineState) => line.id === id)) this.lines.delete(id);
      for (const line of (said as State).lines) {
        const own = this.lines.get(line.id);
        if (own) own.run.events = line.events.filter(e => e.kind !== 'change') as Run['events'];
      }
      this.onState();
    } else if (said.kind === 'panels') {
      this.panels = said.panels;
      this.onState();
    } else {
      const waiting = this.waiting.get(said.re);
      this.waiting.delete(said.re);
      if (said.kind === 'done') waiting?.done(said.value); else waiting?.failed(said.error);
    }
  }

  private receive(data: ArrayBuffer): void {
    this.bytes += data.byteLength;
    const [kind, a, , c, d] = new Uint32Array(data, 0, 6);
    if (kind === 1) {
      const line = this.lines.get(a);
      if (line) line.take(new Float64Array(data, 24, c), new Float32Array(data, 24 + 8 * c, c * d));
      this.onRows();
    } else if (kind === 2) {
      const times = new Float64Array(data, 24, c);
      const columns = Array.from({ length: d }, (_, k) => new Float32Array(data, 24 + 8 * c + 4 * c * k, c));
      this.asked.get(a)?.({ times, columns });
      this.asked.delete(a);
    }
  }

  do(command: Record<string, unknown>): Promise<unknown> {
    return new Promise((done, failed) => {
      if (!this.isOpen) { failed({ path: '', problem: 'the studio does not answer', hint: '' } satisfies Refusal); return; }
      const id = this.next++;
      this.waiting.set(id, { done, failed });
      this.carrier?.send(JSON.stringify({ id, ...command }));
    });
  }

  /** Signals by time, or their amplitudes by frequency, Hz in the place of times. */
  series(line: number, signals: string[], from: number, to: number, points: number, spectrum = false): Promise<Series> {
    return new Promise(done => {
      if (!this.isOpen) return;
      const series = this.next++;
      this.asked.set(series, done);
      this.carrier?.send(JSON.stringify({ series, line, signals, from, to, points, ...(spectrum ? { spectrum } : {}) }));
    });
  }
}
