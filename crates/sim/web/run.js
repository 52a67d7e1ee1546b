// The data of a run: its shape, its values at an instant, and its packed form in a page.

/** @typedef {{ unit: string, values: (number | null)[] }} Signal */
/** @typedef {{ unit: string, quantum: number, order: number, values: (number | null)[] }} PackedSignal a signal as integers: multiples of `quantum`, differenced `order` times */
/**
 * @typedef {object} WheelShape
 * @property {string} name
 * @property {'fixed' | 'steered' | 'caster' | 'rollers' | 'trailer'} kind
 * @property {[number, number]} mount place in the body frame, m
 * @property {number} angle direction at steering angle zero, rad
 * @property {number} radius m
 * @property {number} width m
 * @property {number} trail m
 * @property {number} [track] of a trailer, m
 * @property {[number, number][]} [footprint] of a trailer, from the middle of its axle, m
 * @property {number} roller_angle from the wheel's direction to the roller's axis, rad
 * @property {boolean} driven
 */
/**
 * @typedef {{ kind: 'homing', beacon: number, distance: number }
 *   | { kind: 'gate', pair: [number, number], direction: number, exit: number }
 *   | { kind: 'eight', pair: [number, number], laps: number }
 *   | { kind: 'slalom', chain: number[], sides: number[] }
 *   | { kind: 'route', tolerance: number, end: number }} Goal
 */
/**
 * @typedef {object} Robot
 * @property {string} name
 * @property {string} level
 * @property {string} drive
 * @property {string} [color]
 * @property {number} collision_radius m
 * @property {[number, number][]} footprint body frame, m
 * @property {[number, number]} center_of_mass body frame, m
 * @property {WheelShape[]} wheels
 * @property {[number, number, number]} start
 * @property {Goal | null} goal
 * @property {[number, number][] | null} path planned, m
 */
/** @typedef {{ n: number, t: number, robot: string, text: string, position: [number, number] | null, detail: string | null }} RunEvent */
/** @typedef {{ name: string, value: number | string | null, unit: string, note?: string, digits?: number }} Metric */
/** @typedef {{ signal: string, label: string, role: string }} PlotLine */
/**
 * @typedef {object} PlotSpec
 * @property {string} title
 * @property {string} unit
 * @property {PlotLine[]} lines
 * @property {{ value: number, label: string }[]} [limits]
 * @property {boolean} [symmetric_limit] the limits hold for both signs
 * @property {number} [scale] factor from the signal's unit to the shown one
 * @property {boolean} [mark_min]
 * @property {boolean} [mark_max]
 */
/**
 * @typedef {object} ComparedRun
 * @property {string} label
 * @property {string} status
 * @property {string} color
 * @property {boolean} [dash]
 * @property {number[]} time
 * @property {number[]} x
 * @property {number[]} y
 * @property {number[]} yaw
 * @property {Record<string, number | string | null>} metrics
 */
/** @typedef {{ run: number, time: number[], values: number[] }} Distance */
/** @typedef {{ note: string, runs: ComparedRun[], reference: number, distance: Distance[] }} Comparison */
/** @typedef {{ name: string, position: [number, number], radius: number }} Beacon */
/** @typedef {{ kind: 'flat' } | { kind: 'plane', slope_deg: number, downhill_heading_deg: number } | import('./terrain.js').Relief} Terrain */
/** @typedef {{ low: [number, number], high: [number, number], friction: number }} Patch a rectangle of other friction, m */
/**
 * @typedef {object} Run
 * @property {string} version
 * @property {{ name: string, title: string, text: string, file: string, hash: string, seed: number | string, step: number, integrator: string, recorded_period: number }} scenario
 * @property {{ status: string, sentence: string }} verdict
 * @property {{ size: [number, number], beacons: Beacon[], terrain: Terrain, friction: number | null, patches?: Patch[] }} arena
 * @property {Robot[]} robots
 * @property {number[]} time
 * @property {Record<string, Signal>} signals
 * @property {RunEvent[]} events
 * @property {Metric[]} metrics
 * @property {Statistics[]} statistics
 * @property {PlotSpec[]} plots
 * @property {Comparison | null} comparison
 */
/** @typedef {{ name: string, samples: number, decimals: number, rows: { signal: string, unit: string, mean: number | null, std: number | null }[] }} Statistics mean and standard deviation of signals */
/** @typedef {{ radius: number, heading: number, spin: number, force: [number, number] | null, load: number | null }} WheelState `heading` in the body frame, rad; `force` along and to the left of the wheel, N */
/** @typedef {{ x: number, y: number, yaw: number, z: number, roll: number, pitch: number, speed: number, wheels: WheelState[] }} RobotState height, roll and pitch are 0 on even ground */
/** @typedef {(number | null)[] | null} Track */
/**
 * @typedef {object} Tracks the signals of one robot that a picture of it needs
 * @property {number[]} time
 * @property {(number | null)[]} x
 * @property {(number | null)[]} y
 * @property {(number | null)[]} yaw
 * @property {[Track, Track, Track]} attitude height, roll and pitch, on uneven ground
 * @property {number[]} speed magnitude, m/s
 * @property {{ spin: Track, steering: Track, along: Track, across: Track, load: Track }[]} wheels
 */

/**
 * Values of a signal, or null when it was not recorded.
 * @param {Run} run
 * @param {string} name
 * @returns {Track}
 */
export function valuesOf(run, name) {
  const signal = run.signals[name];
  return signal && signal.values.length > 0 ? signal.values : null;
}

/**
 * The largest index whose time is not after `t`; 0 before the first.
 * @param {number[]} time
 * @param {number} t
 */
export function indexAt(time, t) {
  let low = 0;
  let high = time.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (time[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

/**
 * Value at time `t`, linear between samples and held outside.
 * @param {number[]} time
 * @param {(number | null)[]} values
 * @param {number} t
 */
export function valueAt(time, values, t) {
  const k = indexAt(time, t);
  const a = values[k];
  const b = values[k + 1];
  if (a === null || a === undefined) return NaN;
  if (b === null || b === undefined || !(time[k + 1] > time[k]) || t <= time[k]) return a;
  return a + (b - a) * Math.min(1, (t - time[k]) / (time[k + 1] - time[k]));
}

/**
 * Everything a picture of `robot` needs, looked up once.
 * @param {Run} run
 * @param {Robot} robot
 * @returns {Tracks}
 */
export function tracksOf(run, robot) {
  const own = `robot.${robot.name}.`;
  const still = run.time.length > 0 ? run.time : [0];
  const find = (/** @type {string} */ name) => valuesOf(run, own + name);
  const x = find('pose.x') || still.map(() => robot.start[0]);
  const y = find('pose.y') || still.map(() => robot.start[1]);
  const yaw = find('pose.yaw') || still.map(() => robot.start[2]);
  const forward = find('twist.forward');
  const left = find('twist.left');
  const speed = still.map((_, k) => {
    if (forward) return Math.hypot(Number(forward[k]), left ? Number(left[k]) : 0);
    const a = Math.max(0, k - 1);
    const b = Math.min(still.length - 1, k + 1);
    return b > a ? Math.hypot(Number(x[b]) - Number(x[a]), Number(y[b]) - Number(y[a])) / (still[b] - still[a]) : 0;
  });
  const wheels = robot.wheels.map(wheel => {
    const of = (/** @type {string} */ name) => find(`wheel.${wheel.name}.${name}`);
    return { spin: of('spin_angle'), steering: of('steering_angle'), along: of('force.longitudinal'), across: of('force.lateral'), load: of('load') };
  });
  /** @type {[Track, Track, Track]} */
  const attitude = [find('pose.z'), find('pose.roll'), find('pose.pitch')];
  return { time: still, x, y, yaw, attitude, speed, wheels };
}

/**
 * The robot at time `t`, between samples too.
 * @param {Tracks} tracks
 * @param {Robot} robot
 * @param {number} t
 * @returns {RobotState}
 */
export function stateAt(tracks, robot, t) {
  const at = (/** @type {Track} */ track) => track ? valueAt(tracks.time, track, t) : NaN;
  const or = (/** @type {number} */ value, /** @type {number} */ otherwise) => Number.isFinite(value) ? value : otherwise;
  return {
    x: or(at(tracks.x), robot.start[0]), y: or(at(tracks.y), robot.start[1]), yaw: or(at(tracks.yaw), robot.start[2]),
    z: or(at(tracks.attitude[0]), 0), roll: or(at(tracks.attitude[1]), 0), pitch: or(at(tracks.attitude[2]), 0), speed: at(tracks.speed),
    wheels: robot.wheels.map((wheel, i) => {
      const track = tracks.wheels[i];
      const along = at(track.along);
      const across = at(track.across);
      const load = at(track.load);
      return {
        radius: wheel.radius,
        heading: wheel.angle + or(at(track.steering), 0),
        spin: or(at(track.spin), 0),
        force: Number.isFinite(along) || Number.isFinite(across) ? [or(along, 0), or(across, 0)] : null,
        load: Number.isFinite(load) ? load : null,
      };
    }),
  };
}

/**
 * The instant a still picture should show: the most friction used, else the least clearance,
 * else the middle; a failed run shows its end.
 * @param {Run} run
 */
export function tellingTime(run) {
  const end = run.time.length > 0 ? run.time[run.time.length - 1] : 0;
  const robot = run.robots[0];
  if (run.verdict.status !== 'passed' || !robot) return end;
  const own = `robot.${robot.name}.`;
  const friction = run.arena.friction;
  let best = NaN;
  let at = NaN;
  const offer = (/** @type {number} */ value, /** @type {number} */ k) => {
    if (Number.isFinite(value) && !(value <= best)) { best = value; at = run.time[k]; }
  };
  for (const wheel of robot.wheels) {
    const along = valuesOf(run, `${own}wheel.${wheel.name}.force.longitudinal`);
    const across = valuesOf(run, `${own}wheel.${wheel.name}.force.lateral`);
    const load = valuesOf(run, `${own}wheel.${wheel.name}.load`);
    if (!friction || !load || (!along && !across)) continue;
    load.forEach((l, k) => offer(Math.hypot(Number(along && along[k]), Number(across && across[k])) / (friction * Math.max(Number(l), 1e-9)), k));
  }
  if (Number.isNaN(at)) (valuesOf(run, own + 'clearance') || []).forEach((v, k) => offer(v === null ? NaN : -v, k));
  return Number.isNaN(at) ? end / 2 : at;
}

/**
 * Names of the signals a page needs: the robots' motion and forces, and what its plots show.
 * @param {Run} run
 * @returns {string[]}
 */
export function reportSignals(run) {
  /** @type {Set<string>} */
  const names = new Set();
  for (const robot of run.robots) {
    for (const name of ['pose.x', 'pose.y', 'pose.yaw', 'twist.forward', 'twist.left']) names.add(`robot.${robot.name}.${name}`);
    for (const wheel of robot.wheels) {
      for (const name of ['spin_angle', 'steering_angle', 'force.longitudinal', 'force.lateral', 'load']) names.add(`robot.${robot.name}.wheel.${wheel.name}.${name}`);
    }
  }
  for (const plot of run.plots) for (const line of plot.lines) names.add(line.signal);
  return [...names].filter(name => run.signals[name]);
}

/**
 * Integers of a signal, differenced as often as makes them shortest.
 * @param {Signal} signal
 * @returns {PackedSignal}
 */
export function packSignal(signal) {
  let size = 0;
  for (const v of signal.values) if (v !== null && Number.isFinite(v)) size = Math.max(size, Math.abs(v));
  const quantum = size > 0 ? Number((Math.pow(10, Math.floor(Math.log10(size)) - 5)).toPrecision(1)) : 1;
  const whole = signal.values.map(v => v === null || !Number.isFinite(v) ? null : Math.round(v / quantum));
  // Digits of every seventh number tell the length of all.
  const digits = (/** @type {(number | null)[]} */ list) => {
    let sum = 0;
    for (let k = 0; k < list.length; k += 7) sum += Math.log10(1 + Math.abs(Number(list[k])));
    return sum;
  };
  let best = { order: 0, values: whole, length: digits(whole) };
  if (whole.includes(null)) return { unit: signal.unit, quantum, order: 0, values: whole };
  let values = whole;
  for (let order = 1; order <= 3; order++) {
    const before = values;
    values = before.map((v, k) => Number(v) - (k > 0 ? Number(before[k - 1]) : 0));
    const length = digits(values);
    if (length < best.length) best = { order, values, length };
  }
  return { unit: signal.unit, quantum, order: best.order, values: best.values };
}

/**
 * The signal that `packSignal` packed, to six significant digits of its largest value.
 * @param {Signal | PackedSignal} packed
 * @returns {Signal}
 */
export function unpackSignal(packed) {
  if (!('quantum' in packed)) return packed;
  let values = packed.values;
  for (let i = 0; i < packed.order; i++) {
    let sum = 0;
    values = values.map(v => sum += Number(v));
  }
  const { unit, quantum } = packed;
  // Dividing by the inverse gives the shortest decimal: 3 / 10, not 3 × 0.1.
  const inverse = Math.round(1 / quantum);
  return { unit, values: values.map(v => v === null ? null : quantum < 1 ? v / inverse : v * quantum) };
}

/**
 * The data a page embeds, as JSON: only the signals it needs, packed, and at most `limit` samples
 * of them. Escape `<` before it goes into a script element.
 * @param {Run} run
 * @param {number} [limit]
 */
export function reportData(run, limit = 8000) {
  const stride = Math.max(1, Math.ceil((run.time.length - 1) / limit));
  const thin = (/** @type {any[]} */ values) => stride === 1 ? values : values.filter((_, k) => k % stride === 0 || k === values.length - 1);
  /** @type {Record<string, PackedSignal>} */
  const signals = {};
  for (const name of reportSignals(run)) signals[name] = packSignal({ unit: run.signals[name].unit, values: thin(run.signals[name].values) });
  const time = packSignal({ unit: 's', values: thin(run.time) });
  const scenario = { ...run.scenario, text: '' };
  return JSON.stringify({ ...run, scenario, time, signals, metrics: [], comparison: null });
}

/**
 * The run inside a page's JSON.
 * @param {string} json
 * @returns {Run}
 */
export function readReportData(json) {
  const packed = JSON.parse(json);
  if (!Array.isArray(packed.time)) packed.time = unpackSignal(packed.time).values;
  for (const name of Object.keys(packed.signals)) packed.signals[name] = unpackSignal(packed.signals[name]);
  return packed;
}
