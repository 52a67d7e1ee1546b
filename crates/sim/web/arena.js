// The arena seen from above, and the robot drawn from its data.
//
// Pure functions from a run to SVG text: meters in, px out, x to the right, y up. The report, the
// studio and the command line all draw with them.

import { DARK, FONT, LIGHT, clamp, colorName, escapeText, eventMark, label, multiples, niceStep, pathText, pictureStyle, plain, px, roundUp, simplify, textWidth, tickText, viridis } from './draw.js';
import { stateAt, tellingTime, tracksOf } from './run.js';
import { drawRelief } from './terrain.js';

/** @typedef {import('./draw.js').Point} Point */
/** @typedef {import('./run.js').Run} Run */
/** @typedef {import('./run.js').Robot} Robot */
/** @typedef {import('./run.js').RobotState} RobotState */
/** @typedef {import('./run.js').Tracks} Tracks */
/** @typedef {import('./run.js').WheelShape} WheelShape */
/** @typedef {import('./run.js').Goal} Goal */
/** @typedef {{ scale: number, x: (meters: number) => number, y: (meters: number) => number }} View `scale` in px per meter */
/** @typedef {{ x: number, y: number, width: number, height: number }} Box */
/** @typedef {{ low: Point, high: Point }} Bounds a rectangle of the ground, m */
/** @typedef {{ first: number, last: number, color: string, path: string }} TrailRun samples `first` to `last` of a trail in one color */
/**
 * @typedef {object} ArenaOptions
 * @property {number} [width] largest width, px
 * @property {number} [maxHeight] largest height of the ground with its labels, px
 * @property {number} [time] instant at which the robots stand, s
 * @property {string} [id] prefix of ids inside the picture
 * @property {string} [title] a line above
 * @property {boolean} [legend]
 * @property {boolean} [robots] whether to draw the robots and their forces
 */

const MARGIN = { left: 30, right: 20, top: 8, bottom: 26 };
const TRAIL_ORDER = ['blue', 'vermilion', 'purple', 'sky', 'green', 'orange'];

/**
 * @param {number} scale px per meter
 * @param {number} left px of x = 0
 * @param {number} bottom px of y = 0
 * @returns {View}
 */
export function viewOf(scale, left, bottom) {
  return { scale, x: x => left + x * scale, y: y => bottom - y * scale };
}

/**
 * Scale at which the whole arena fits, px per meter.
 * @param {Run} run
 * @param {number} width
 * @param {number} height
 */
export function fittingScale(run, width, height) {
  const [w, h] = run.arena.size;
  return Math.max(1e-3, Math.min((width - MARGIN.left - MARGIN.right) / (w > 0 ? w : 1), (height - MARGIN.top - MARGIN.bottom) / (h > 0 ? h : 1)));
}

/**
 * Width of the picture of the arena alone, px.
 * @param {Run} run
 * @param {number} width
 * @param {number} height
 */
export function arenaWidth(run, width, height) {
  // A tall arena still leaves room for its legend.
  return Math.min(width, Math.max(320, Math.ceil(run.arena.size[0] * fittingScale(run, width, height) + MARGIN.left + MARGIN.right)));
}

// What is free ------------------------------------------------------------------------------------

/** @typedef {{ line: (points: Point[], weight: number) => void, disc: (x: number, y: number, r: number, weight: number) => void, box: (b: Box, weight: number) => void, cost: (b: Box) => number, best: (boxes: Box[]) => Box }} Occupancy */

/**
 * A coarse raster of what is drawn already, so that labels find free places.
 * @param {Box} area where labels may be, px
 * @returns {Occupancy}
 */
export function occupancyOf(area) {
  const cell = 4;
  const columns = Math.ceil(area.width / cell) + 1;
  const rows = Math.ceil(area.height / cell) + 1;
  const weights = new Float32Array(columns * rows);
  const add = (/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ weight) => {
    const i = Math.floor((x - area.x) / cell);
    const j = Math.floor((y - area.y) / cell);
    if (i >= 0 && j >= 0 && i < columns && j < rows) weights[j * columns + i] = Math.max(weights[j * columns + i], weight);
  };
  const box = (/** @type {Box} */ b, /** @type {number} */ weight) => {
    const right = Math.min(b.x + b.width, area.x + area.width);
    const bottom = Math.min(b.y + b.height, area.y + area.height);
    for (let y = Math.max(b.y, area.y); y < bottom + cell; y += cell) for (let x = Math.max(b.x, area.x); x < right + cell; x += cell) add(Math.min(x, right), Math.min(y, bottom), weight);
  };
  const cost = (/** @type {Box} */ b) => {
    let sum = 0;
    const outside = Math.max(0, area.x - b.x) + Math.max(0, area.y - b.y) + Math.max(0, b.x + b.width - area.x - area.width) + Math.max(0, b.y + b.height - area.y - area.height);
    for (let j = Math.max(0, Math.floor((b.y - area.y) / cell)); j <= Math.min(rows - 1, Math.floor((b.y + b.height - area.y) / cell)); j++) {
      for (let i = Math.max(0, Math.floor((b.x - area.x) / cell)); i <= Math.min(columns - 1, Math.floor((b.x + b.width - area.x) / cell)); i++) sum += weights[j * columns + i];
    }
    return sum + 50 * outside;
  };
  return {
    box, cost,
    line(points, weight) {
      for (let k = 1; k < points.length; k++) {
        const [ax, ay] = points[k - 1];
        const [bx, by] = points[k];
        const n = Math.min(4000, Math.ceil(Math.hypot(bx - ax, by - ay) / (cell * 0.7)) || 1);
        for (let i = 0; i <= n; i++) add(ax + (bx - ax) * i / n, ay + (by - ay) * i / n, weight);
      }
    },
    disc(x, y, r, weight) {
      const step = cell * 0.7;
      for (let v = Math.max(-r, area.y - y); v <= Math.min(r, area.y + area.height - y); v += step) {
        for (let u = Math.max(-r, area.x - x); u <= Math.min(r, area.x + area.width - x); u += step) if (u * u + v * v <= r * r) add(x + u, y + v, weight);
      }
    },
    best(boxes) {
      // Earlier places are better by a little.
      let found = boxes[0];
      let least = Infinity;
      boxes.forEach((b, i) => {
        const c = cost(b) + i * 0.15;
        if (c < least) { least = c; found = b; }
      });
      return found;
    },
  };
}

// What does not move ------------------------------------------------------------------------------

/**
 * Steps of the grid in meters: fine lines, strong lines, and numbers.
 * @param {number} scale px per meter
 */
export function gridSteps(scale) {
  const fine = roundUp(40 / scale);
  const lead = Math.round(fine / Math.pow(10, Math.floor(Math.log10(fine) + 1e-9)));
  const strong = fine * (lead === 5 ? 2 : 5);
  return { fine, strong, numbers: strong * scale <= 150 ? strong : fine };
}

/**
 * Floor, grid and walls.
 * @param {View} view
 * @param {Run} run
 * @param {{ numbers?: boolean, bounds?: Bounds }} [options]
 */
export function drawGround(view, run, options = {}) {
  const [w, h] = run.arena.size;
  const low = options.bounds ? options.bounds.low.map(v => Math.max(0, v)) : [0, 0];
  const high = options.bounds ? [Math.min(w, options.bounds.high[0]), Math.min(h, options.bounds.high[1])] : [w, h];
  const { fine, strong, numbers } = gridSteps(view.scale);
  const rect = `x="${px(view.x(0))}" y="${px(view.y(h))}" width="${px(w * view.scale)}" height="${px(h * view.scale)}"`;
  const isStrong = (/** @type {number} */ v) => Math.abs(v / strong - Math.round(v / strong)) < 1e-6;
  let fineLines = '';
  let strongLines = '';
  for (const x of multiples(low[0], high[0], fine)) {
    const d = `M${px(view.x(x))} ${px(view.y(high[1]))}V${px(view.y(low[1]))}`;
    if (isStrong(x)) strongLines += d; else fineLines += d;
  }
  for (const y of multiples(low[1], high[1], fine)) {
    const d = `M${px(view.x(low[0]))} ${px(view.y(y))}H${px(view.x(high[0]))}`;
    if (isStrong(y)) strongLines += d; else fineLines += d;
  }
  let svg = `<rect ${rect} class="floor"/><path d="${fineLines}" class="grid"/><path d="${strongLines}" class="grid-major"/>`;
  if (options.numbers) {
    const xs = multiples(0, w, numbers);
    const ys = multiples(0, h, numbers);
    xs.forEach((x, i) => { svg += label(view.x(x), view.y(0) + 17, tickText(x, numbers) + (i === xs.length - 1 ? ' m' : ''), 'tick', 'middle'); });
    ys.forEach(y => { svg += label(view.x(0) - 7, view.y(y) + 4, tickText(y, numbers), 'tick', 'end'); });
  }
  return { below: svg, above: `<rect ${rect} class="wall"/>` };
}

/**
 * The origin's axes.
 * @param {View} view
 */
export function drawOrigin(view) {
  const x = view.x(0);
  const y = view.y(0);
  return `<path d="M${px(x)} ${px(y - 24)}V${px(y)}H${px(x + 24)}" class="origin"/><path d="M${px(x + 24)} ${px(y - 3.5)}l7 3.5l-7 3.5zM${px(x - 3.5)} ${px(y - 24)}l3.5-7l3.5 7z" class="origin-tip"/><circle cx="${px(x)}" cy="${px(y)}" r="3" class="origin-tip"/>`;
}

/**
 * Contours and shading of the ground, and patches of other friction. `step` is the height between two
 * contours, m.
 * @param {View} view
 * @param {Run} run
 * @param {string} id
 */
export function drawTerrain(view, run, id) {
  const { terrain, size: [w, h] } = run.arena;
  const patches = (run.arena.patches || []).map(({ low, high, friction }) => `<rect x="${px(view.x(low[0]))}" y="${px(view.y(high[1]))}" width="${px((high[0] - low[0]) * view.scale)}" height="${px((high[1] - low[1]) * view.scale)}" class="patch"/>${label(view.x(low[0]) + 5, view.y(high[1]) + 14, `μ ${plain(friction)}`, 'note halo')}`).join('');
  if (terrain.kind === 'uneven') {
    const { svg, step } = drawRelief(view, terrain);
    const clip = `<clipPath id="${id}-floor"><rect x="${px(view.x(0))}" y="${px(view.y(h))}" width="${px(w * view.scale)}" height="${px(h * view.scale)}"/></clipPath>`;
    return { svg: `${clip}<g clip-path="url(#${id}-floor)">${svg}</g>${patches}`, step };
  }
  if (terrain.kind !== 'plane' || !(Math.abs(terrain.slope_deg) > 0)) return { svg: patches, step: 0 };
  const rise = Math.tan(Math.abs(terrain.slope_deg) * Math.PI / 180);
  const heading = (terrain.downhill_heading_deg + (terrain.slope_deg < 0 ? 180 : 0)) * Math.PI / 180;
  const along = [0, w].flatMap(x => [0, h].map(y => x * Math.cos(heading) + y * Math.sin(heading)));
  const low = Math.min(...along);
  const high = Math.max(...along);
  const step = niceStep((high - low) * rise, 5);
  const width = step / rise;
  const reach = (w + h) * view.scale;
  const at = (/** @type {number} */ s) => px(s * view.scale);
  let svg = '';
  const edges = multiples(low, high, width);
  for (let s = Math.floor(low / width) * width; s < high; s += width) {
    const depth = clamp((s - low) / (high - low), 0, 1);
    svg += `<rect x="${at(s)}" y="${px(-reach)}" width="${at(width)}" height="${px(2 * reach)}" class="slope" fill-opacity="${(0.015 + 0.13 * depth).toFixed(3)}"/>`;
  }
  for (const s of edges) svg += `<line x1="${at(s)}" x2="${at(s)}" y1="${px(-reach)}" y2="${px(reach)}" class="contour"/>`;
  const clip = `<clipPath id="${id}-floor"><rect x="${px(view.x(0))}" y="${px(view.y(h))}" width="${px(w * view.scale)}" height="${px(h * view.scale)}"/></clipPath>`;
  return { svg: `${clip}<g clip-path="url(#${id}-floor)"><g transform="translate(${px(view.x(0))} ${px(view.y(0))}) rotate(${px(-heading * 180 / Math.PI)})">${svg}</g></g>${patches}`, step };
}

/**
 * The arrow that points downhill on a plane, about a place.
 * @param {Run} run
 * @param {number} x
 * @param {number} y
 */
export function drawDownhill(run, x, y) {
  const { terrain } = run.arena;
  if (terrain.kind !== 'plane') return '';
  const heading = terrain.downhill_heading_deg + (terrain.slope_deg < 0 ? 180 : 0);
  return `<g transform="translate(${px(x)} ${px(y)}) rotate(${px(-heading)})"><path d="M-13 0H9" class="origin"/><path d="M8-5l9 5l-9 5z" class="origin-tip"/></g>`;
}

/**
 * The same with the slope's angle, centered in a box of 96 × 30 px.
 * @param {Run} run
 * @param {number} x
 * @param {number} y
 */
function downhillArrow(run, x, y) {
  const { terrain } = run.arena;
  if (terrain.kind !== 'plane') return '';
  return `${drawDownhill(run, x + 16, y + 15)}${label(x + 38, y + 12, 'downhill', 'note halo')}${label(x + 38, y + 26, plain(Math.abs(terrain.slope_deg)) + '°', 'bold halo')}`;
}

/**
 * What a goal asks: ring, chord or chevrons.
 * @param {View} view
 * @param {Run} run
 * @param {Robot} robot
 * @param {Occupancy} [taken] chevrons look for a free place
 */
export function drawGoal(view, run, robot, taken) {
  const { goal } = robot;
  const { beacons } = run.arena;
  if (!goal) return '';
  const at = (/** @type {number} */ x, /** @type {number} */ y) => `${px(view.x(x))} ${px(view.y(y))}`;
  const chevron = (/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ heading) => {
    const k = clamp(0.05 * view.scale, 5, 10);
    return `<path transform="translate(${at(x, y)}) rotate(${px(-heading * 180 / Math.PI)})" d="M${px(-k * 0.5)} ${px(-k)}L${px(k * 0.5)} 0L${px(-k * 0.5)} ${px(k)}" class="chevron"/>`;
  };
  if (goal.kind === 'homing') {
    const b = beacons[goal.beacon];
    return b ? `<circle cx="${px(view.x(b.position[0]))}" cy="${px(view.y(b.position[1]))}" r="${px(goal.distance * view.scale)}" class="goal"/>` : '';
  }
  if (goal.kind === 'route') {
    // The corridor that the robot must keep, and the circle at its end.
    if (!robot.path || robot.path.length < 2) return '';
    const line = pathText(simplify(robot.path.map(p => [view.x(p[0]), view.y(p[1])]), 0.15));
    const [x, y] = robot.path[robot.path.length - 1];
    return `<path d="${line}" class="corridor" stroke-width="${px(2 * goal.tolerance * view.scale)}"/><circle cx="${px(view.x(x))}" cy="${px(view.y(y))}" r="${px(Math.max(3, goal.end * view.scale))}" class="goal"/>`;
  }
  if (goal.kind === 'slalom') {
    return goal.chain.map((index, i) => {
      const b = beacons[index];
      const before = beacons[goal.chain[Math.max(0, i - 1)]];
      const after = beacons[goal.chain[Math.min(goal.chain.length - 1, i + 1)]];
      if (!b || !before || !after) return '';
      const heading = Math.atan2(after.position[1] - before.position[1], after.position[0] - before.position[0]);
      const side = goal.sides[i] < 0 ? -1 : 1;
      const n = [-Math.sin(heading) * side, Math.cos(heading) * side];
      const clear = robot.collision_radius + b.radius;
      const offset = (/** @type {number} */ s) => /** @type {Point} */ ([b.position[0] + n[0] * s, b.position[1] + n[1] * s]);
      let chosen = clear + 0.5;
      if (taken) {
        const boxes = [0.52, 0.4, 0.64, 0.28, 0.1].map(s => { const [x, y] = offset(clear + s); return { x: view.x(x) - 9, y: view.y(y) - 12, width: 18, height: 24, s: clear + s }; });
        const found = taken.best(boxes);
        chosen = Number(Object(found).s);
        taken.box(found, 3);
      }
      const end = offset(Math.max(chosen + 0.12, clear + 0.5));
      if (taken) taken.line([offset(clear), end].map(p => [view.x(p[0]), view.y(p[1])]), 0.5);
      const mark = offset(chosen);
      return `<path d="M${at(...offset(clear))}L${at(...end)}" class="chord"/>${chevron(mark[0], mark[1], heading)}`;
    }).join('');
  }
  const a = beacons[goal.pair[0]];
  const b = beacons[goal.pair[1]];
  if (!a || !b) return '';
  const length = Math.hypot(b.position[0] - a.position[0], b.position[1] - a.position[1]) || 1;
  const e = [(b.position[0] - a.position[0]) / length, (b.position[1] - a.position[1]) / length];
  const point = (/** @type {number} */ s, /** @type {number} */ f) => /** @type {Point} */ ([a.position[0] + e[0] * s - e[1] * f, a.position[1] + e[1] * s + e[0] * f]);
  const chord = `<path d="M${at(...point(0, 0))}L${at(...point(length, 0))}" class="${goal.kind === 'gate' ? 'none gate' : 'chord'}"/>`;
  if (taken) taken.line([point(0, 0), point(length, 0)].map(p => [view.x(p[0]), view.y(p[1])]), 1);
  if (goal.kind === 'eight') return chord;
  const ways = goal.direction > 0 ? [1] : goal.direction < 0 ? [-1] : [1, -1];
  return chord + ways.map(way => {
    // Chevrons at a sixth of the chord: the middle is where the robot should drive.
    const heading = Math.atan2(e[0] * way, -e[1] * way);
    const marks = (goal.direction === 0 ? [way > 0 ? 0.2 : 0.8] : [0.2, 0.8]).map(s => point(s * length, 0));
    const exit = goal.exit > 0 ? `<path d="M${at(...point(0, goal.exit * way))}L${at(...point(length, goal.exit * way))}" class="chord"/>` : '';
    return marks.map(p => chevron(p[0], p[1], heading)).join('') + exit;
  }).join('');
}

/**
 * A label of `text` beside a place, as candidates for `Occupancy.best`.
 * @param {number} x
 * @param {number} y
 * @param {number} gap from the place to the label, px
 * @param {number} width
 * @param {number} height
 * @returns {Box[]}
 */
function around(x, y, gap, width, height) {
  const boxes = [];
  for (const far of [0, 10, 22, 38]) {
    for (const [u, v] of [[0, -1], [0, 1], [1, 0], [-1, 0], [0.75, -0.75], [-0.75, -0.75], [0.75, 0.75], [-0.75, 0.75]]) {
      const d = gap + far;
      boxes.push({ x: x + u * (d + width / 2) - width / 2, y: y + v * (d + height / 2) - height / 2, width, height });
    }
  }
  return boxes;
}

/**
 * Beacons at their true size; with `taken` their names find a free place, else they stand below.
 * @param {View} view
 * @param {Run} run
 * @param {Occupancy} [taken]
 */
export function drawBeacons(view, run, taken) {
  let names = '';
  const discs = run.arena.beacons.map(b => {
    const x = view.x(b.position[0]);
    const y = view.y(b.position[1]);
    const r = Math.max(1.5, b.radius * view.scale);
    const width = textWidth(b.name, 12.5);
    const boxes = around(x, y, r + 4, width + 2, 12);
    const box = taken ? taken.best(boxes) : boxes[1];
    if (taken) taken.box(box, 4);
    names += label(box.x + box.width / 2, box.y + 10.5, b.name, 'bold halo', 'middle');
    return `<circle cx="${px(x)}" cy="${px(y)}" r="${px(r)}" class="beacon"/>`;
  });
  return discs.join('') + names;
}

/**
 * A bar of a round length, its left end at (x, y).
 * @param {number} x
 * @param {number} y
 * @param {number} meters
 * @param {number} scale px per meter
 */
export function drawScaleBar(x, y, meters, scale) {
  const w = meters * scale;
  return `<path d="M${px(x)} ${px(y - 4)}v8m0-4h${px(w)}m0-4v8" class="bar"/>${label(x + w / 2, y - 7, `${plain(meters)} m`, 'halo', 'middle')}`;
}

/**
 * The class of a robot's own color, when there are several, or nothing.
 * @param {Run} run
 * @param {number} index
 */
export function robotColor(run, index) {
  if (run.robots.length < 2) return null;
  return colorName(run.robots[index].color) || TRAIL_ORDER[index % TRAIL_ORDER.length];
}

/**
 * A round number not below the fastest speed: the end of the speed scale, m/s.
 * @param {Run} run
 */
export function speedLimit(run) {
  let most = 0;
  for (const robot of run.robots) for (const v of tracksOf(run, robot).speed) if (v > most) most = v;
  return roundSpeed(most);
}

/**
 * A round speed that is no less than one; 1 m/s for none.
 * @param {number} most m/s
 */
export function roundSpeed(most) {
  if (!(most > 0)) return 1;
  const power = Math.pow(10, Math.floor(Math.log10(most * 0.999)));
  return Number(([1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].find(m => m * power >= most * 0.999) || 10).toPrecision(2)) * power;
}

/**
 * A trail cut into pieces of one color each, viridis by speed.
 * @param {View} view
 * @param {Tracks} tracks
 * @param {number} fastest speed at the end of the scale, m/s
 * @param {Bounds} [bounds] only what lies within
 * @param {(u: number) => string} [color] of what is between 0 and 1
 * @returns {TrailRun[]}
 */
export function trailRuns(view, tracks, fastest, bounds, color = viridis) {
  const levels = 40;
  /** @type {TrailRun[]} */
  const runs = [];
  /** @type {Point[]} */
  let points = [];
  let first = 0;
  let sum = 0;
  let length = 0;
  let level = -1;
  const close = (/** @type {number} */ last) => {
    if (points.length > 1) runs.push({ first, last, color: color(sum / points.length / fastest), path: pathText(simplify(points, 0.12)) });
  };
  for (let k = 0; k < tracks.time.length; k++) {
    const x = Number(tracks.x[k]);
    const y = Number(tracks.y[k]);
    const inside = tracks.x[k] !== null && tracks.y[k] !== null && Number.isFinite(x + y) && (!bounds || (x >= bounds.low[0] && x <= bounds.high[0] && y >= bounds.low[1] && y <= bounds.high[1]));
    if (!inside) { close(k - 1); points = []; continue; }
    /** @type {Point} */
    const p = [view.x(x), view.y(y)];
    const end = points[points.length - 1];
    const moved = end ? Math.hypot(p[0] - end[0], p[1] - end[1]) : 0;
    if (end && moved < 0.8 && k < tracks.time.length - 1) continue;
    const v = tracks.speed[k];
    const here = Math.round(clamp(v / fastest, 0, 1) * levels);
    if (end && here !== level && length + moved >= 5) {
      points.push(p);
      sum += v;
      close(k);
      points = [];
    }
    if (points.length === 0) { first = k; sum = 0; length = 0; level = here; }
    else length += moved;
    points.push(p);
    sum += v;
  }
  close(tracks.time.length - 1);
  return runs;
}

/**
 * The whole path driven, thinned to what can be seen, in px.
 * @param {View} view
 * @param {Tracks} tracks
 * @param {Bounds} [bounds]
 * @returns {Point[]}
 */
export function trailPoints(view, tracks, bounds) {
  /** @type {Point[]} */
  const points = tracks.time.map((_, k) => {
    const x = tracks.x[k];
    const y = tracks.y[k];
    if (x === null || y === null || x === undefined || y === undefined) return [NaN, NaN];
    if (bounds && !(x >= bounds.low[0] && x <= bounds.high[0] && y >= bounds.low[1] && y <= bounds.high[1])) return [NaN, NaN];
    return [view.x(x), view.y(y)];
  });
  return simplify(points, 0.15);
}

/**
 * The path driven: by speed, or in the robot's own color when there are several.
 * @param {View} view
 * @param {Run} run
 * @param {number} index of the robot
 * @param {number} fastest
 * @param {Bounds} [bounds]
 */
export function drawTrail(view, run, index, fastest, bounds) {
  const tracks = tracksOf(run, run.robots[index]);
  const path = pathText(trailPoints(view, tracks, bounds));
  const own = robotColor(run, index);
  const body = own
    ? `<path d="${path}" class="trail s-${own}"/>`
    : trailRuns(view, tracks, fastest, bounds).map(r => `<path d="${r.path}" stroke="${r.color}"/>`).join('');
  return `<path d="${path}" class="casing"/><g class="trail">${body}</g>`;
}

/**
 * The place of an event: its own, or where its robot was.
 * @param {Run} run
 * @param {import('./run.js').RunEvent} event
 * @returns {Point}
 */
export function eventPlace(run, event) {
  if (event.position) return event.position;
  const robot = run.robots.find(r => r.name === event.robot) || run.robots[0];
  if (!robot) return [NaN, NaN];
  const state = stateAt(tracksOf(run, robot), robot, event.t);
  return [state.x, state.y];
}

/**
 * Events as dots on the path and numbers beside it.
 * @param {View} view
 * @param {Run} run
 * @param {Occupancy} taken
 */
export function drawEvents(view, run, taken) {
  let dots = '';
  let marks = '';
  run.events.slice(0, 80).forEach(event => {
    const [mx, my] = eventPlace(run, event);
    if (!Number.isFinite(mx + my)) return;
    const x = view.x(mx);
    const y = view.y(my);
    const boxes = [];
    for (const d of [20, 26, 34, 46, 60, 76]) {
      for (let i = 0; i < 16; i++) {
        const angle = Math.PI / 2 + (i % 2 ? 1 : -1) * Math.ceil(i / 2) * Math.PI / 8;
        boxes.push({ x: x + Math.cos(angle) * d - 10, y: y - Math.sin(angle) * d - 10, width: 20, height: 20 });
      }
    }
    const box = taken.best(boxes);
    taken.box(box, 5);
    const cx = box.x + 10;
    const cy = box.y + 10;
    const d = Math.hypot(cx - x, cy - y) || 1;
    if (d > 14) dots += `<path d="M${px(x + (cx - x) * 3 / d)} ${px(y + (cy - y) * 3 / d)}L${px(cx - (cx - x) * 9 / d)} ${px(cy - (cy - y) * 9 / d)}" class="leader"/>`;
    dots += `<circle cx="${px(x)}" cy="${px(y)}" r="3" class="dot"/>`;
    marks += eventMark(cx, cy, event.n);
  });
  return dots + marks;
}

// What moves --------------------------------------------------------------------------------------

/**
 * The outline in the body frame, m, with a notch that tells the front. Points within the notch's
 * strip are cut away where the outline crosses it ahead of the origin.
 * @param {Robot} robot
 * @returns {Point[]}
 */
export function outlineOf(robot) {
  const r = robot.collision_radius;
  /** @type {Point[]} */
  const outline = robot.footprint.length >= 3 ? robot.footprint : Array.from({ length: 32 }, (_, i) => [r * Math.cos(i * Math.PI / 16 + 0.1), r * Math.sin(i * Math.PI / 16 + 0.1)]);
  const size = Math.max(...outline.map(p => Math.abs(p[1])));
  const half = 0.28 * size;
  /** @type {Point[]} */
  const out = [];
  let front = -Infinity;
  /** @type {Point[]} */
  const cuts = [];
  outline.forEach((a, i) => {
    const b = outline[(i + 1) % outline.length];
    const inStrip = (/** @type {Point} */ p) => Math.abs(p[1]) < half - 1e-9 && p[0] > 0;
    if (!inStrip(a)) out.push(a);
    const crossings = [half, -half].filter(y => (a[1] - y) * (b[1] - y) < 0).map(y => (y - a[1]) / (b[1] - a[1])).sort((s, t) => s - t);
    for (const s of crossings) {
      /** @type {Point} */
      const p = [a[0] + (b[0] - a[0]) * s, a[1] + (b[1] - a[1]) * s];
      if (p[0] <= 0) continue;
      front = Math.max(front, p[0]);
      cuts.push(p);
      out.push(p);
    }
  });
  if (cuts.length !== 2) return outline;
  // The tip goes between the two cuts, which are neighbors in `out` (around its end too).
  const i = out.indexOf(cuts[0]);
  const next = out[(i + 1) % out.length] === cuts[1];
  const at = next ? i + 1 : out.indexOf(cuts[1]) + 1;
  out.splice(at, 0, [Math.min(cuts[0][0], cuts[1][0]) - half * 0.72, 0]);
  return out;
}

/**
 * The side of a wheel, as a class: left is blue, right is vermilion, casters and middle wheels gray.
 * @param {WheelShape} wheel
 * @returns {'left' | 'right' | 'other'}
 */
export function sideOf(wheel) {
  if (wheel.kind === 'caster' || wheel.kind === 'trailer' || Math.abs(wheel.mount[1]) < 1e-6) return 'other';
  return wheel.mount[1] > 0 ? 'left' : 'right';
}

/**
 * One wheel from above, in the body frame turned to px: tread or rollers move with the spin.
 * @param {WheelShape} wheel
 * @param {import('./run.js').WheelState} state
 * @param {number} scale px per meter
 */
function drawWheel(wheel, state, scale) {
  if (wheel.kind === 'trailer') return drawTrailer(wheel, state, scale);
  const r = wheel.radius * scale;
  const w = Math.max(2.5, wheel.width * scale);
  const offset = wheel.kind === 'caster' ? -wheel.trail * scale : 0;
  let svg = '';
  if (offset) svg += `<path d="M0 0H${px(offset)}" class="fork"/>`;
  svg += `<rect x="${px(offset - r)}" y="${px(-w / 2)}" width="${px(2 * r)}" height="${px(w)}" rx="${px(Math.min(w * 0.28, 4))}" class="wheel-${sideOf(wheel)}"/>`;
  if (w >= 2.5 && r > 3) {
    const count = wheel.kind === 'rollers' ? 16 : 12;
    const pitch = 2 * Math.PI / count;
    // A roller's axis points along (cos δ, sin δ); y is down here.
    const slant = wheel.kind === 'rollers' ? wheel.roller_angle : Math.PI / 2;
    const reach = Math.min(w / 2 / Math.max(Math.abs(Math.sin(slant)), 1e-6), r * pitch * (Math.abs(Math.sin(slant)) < 0.2 ? 0.38 : 10));
    const dx = Math.cos(slant) * reach;
    const dy = Math.sin(slant) * reach;
    let tread = '';
    for (let i = 0; i < count; i++) {
      const angle = state.spin % (2 * Math.PI) + i * pitch;
      if (Math.cos(angle) < 0.1) continue;
      const x = Math.sin(angle) * r;
      const room = r - Math.abs(x);
      const f = Math.abs(dx) > room ? room / Math.abs(dx) : 1;
      tread += `M${px(offset + x - dx * f)} ${px(dy * f)}L${px(offset + x + dx * f)} ${px(-dy * f)}`;
    }
    svg += `<path d="${tread}" class="tread"/>`;
  }
  if (wheel.kind === 'caster' || wheel.kind === 'steered') svg += `<circle r="${px(Math.max(1.2, Math.min(0.009 * scale, 4)))}" class="pivot"/>`;
  return `<g transform="translate(${px(wheel.mount[0] * scale)} ${px(-wheel.mount[1] * scale)}) rotate(${px(-state.heading * 180 / Math.PI)})">${svg}</g>`;
}

/**
 * A trailer from above: its outline, bar and wheels, turned about the hitch.
 * @param {WheelShape} trailer
 * @param {import('./run.js').WheelState} state
 * @param {number} scale px per meter
 */
function drawTrailer(trailer, state, scale) {
  const axle = -trailer.trail * scale;
  const half = (trailer.track || 0) / 2 * scale;
  const r = trailer.radius * scale;
  const w = Math.max(2.5, trailer.width * scale);
  const outline = (trailer.footprint || []).map(p => `${px(axle + p[0] * scale)} ${px(-p[1] * scale)}`);
  const body = outline.length > 2 ? `<path d="M${outline.join('L')}Z" class="body"/>` : '';
  const wheels = [half, -half].map(y => `<rect x="${px(axle - r)}" y="${px(y - w / 2)}" width="${px(2 * r)}" height="${px(w)}" rx="${px(Math.min(w * 0.28, 4))}" class="wheel-other"/>`).join('');
  const bar = `<path d="M0 0H${px(axle)}M${px(axle)} ${px(-half)}V${px(half)}" class="fork"/><circle r="${px(Math.max(1.6, Math.min(0.015 * scale, 5)))}" class="pivot"/>`;
  return `<g transform="translate(${px(trailer.mount[0] * scale)} ${px(-trailer.mount[1] * scale)}) rotate(${px(-state.heading * 180 / Math.PI)})">${body}${bar}${wheels}</g>`;
}

/**
 * The robot to scale at its place. A ghost is an outline in the class given.
 * @param {View} view
 * @param {Robot} robot
 * @param {RobotState} state
 * @param {{ ghost?: string, style?: string, ring?: string | null }} [options] `ring`: color of the outline when robots are several
 */
export function drawRobot(view, robot, state, options = {}) {
  const s = view.scale;
  const body = 'M' + outlineOf(robot).map(p => `${px(p[0] * s)} ${px(-p[1] * s)}`).join('L') + 'Z';
  let svg = '';
  if (options.ghost !== undefined) {
    svg += `<path d="${body}" class="none ${options.ghost}"/>`;
    robot.wheels.forEach((wheel, i) => {
      if (wheel.kind === 'caster' || wheel.kind === 'trailer') return;
      svg += `<rect transform="translate(${px(wheel.mount[0] * s)} ${px(-wheel.mount[1] * s)}) rotate(${px(-state.wheels[i].heading * 180 / Math.PI)})" x="${px(-wheel.radius * s)}" y="${px(-wheel.width / 2 * s)}" width="${px(2 * wheel.radius * s)}" height="${px(wheel.width * s)}" class="none ${options.ghost}"/>`;
    });
  } else {
    let axles = '';
    robot.wheels.forEach((a, i) => {
      const b = robot.wheels.find((w, j) => j > i && ![w, a].some(x => x.kind === 'caster' || x.kind === 'trailer') && Math.abs(w.mount[0] - a.mount[0]) < 1e-6 && w.mount[1] * a.mount[1] < 0);
      if (b) axles += `M${px(a.mount[0] * s)} ${px(-a.mount[1] * s)}L${px(b.mount[0] * s)} ${px(-b.mount[1] * s)}`;
    });
    const ring = options.ring ? ` s-${options.ring}` : '';
    svg += `<path d="${body}" class="body${ring}"/>`;
    if (axles) svg += `<path d="${axles}" class="axle"/>`;
    robot.wheels.forEach((wheel, i) => { svg += drawWheel(wheel, state.wheels[i], s); });
    const r = Math.max(3.2, Math.min(0.02 * s, 8));
    svg += `<path transform="translate(${px(robot.center_of_mass[0] * s)} ${px(-robot.center_of_mass[1] * s)})" d="M${px(-r)} 0a${px(r)} ${px(r)} 0 1 0 ${px(2 * r)} 0a${px(r)} ${px(r)} 0 1 0 ${px(-2 * r)} 0H${px(r)}M0 ${px(-r)}V${px(r)}" class="com"/>`;
  }
  const style = options.style ? ` style="${escapeText(options.style)}"` : '';
  return `<g transform="translate(${px(view.x(state.x))} ${px(view.y(state.y))}) rotate(${(-state.yaw * 180 / Math.PI % 360).toFixed(2)})"${style}>${svg}</g>`;
}

/**
 * The largest force of a robot's wheels in rows from one on, N: what friction allows where it is known.
 * @param {Run} run
 * @param {Tracks} tracks
 * @param {number} [from]
 */
export function largestForce(run, tracks, from = 0) {
  const { friction } = run.arena;
  let most = 0;
  for (const { along, across, load } of tracks.wheels) {
    const force = along || across;
    if (!force) continue;
    const allowed = friction ? load : null;
    const values = allowed || force;
    for (let k = from; k < values.length; k++) most = Math.max(most, allowed && friction ? friction * Number(values[k]) : Math.abs(Number(values[k])));
  }
  return most;
}

/**
 * Length on the ground that stands for one newton, m/N: the largest force or friction limit of the
 * run spans about 0.6 of its robot. Zero when no forces were recorded.
 * @param {Run} run
 * @param {number[]} [largest] the largest force of each robot
 */
export function forceScale(run, largest = run.robots.map(robot => largestForce(run, tracksOf(run, robot)))) {
  let scale = 0;
  run.robots.forEach((robot, i) => {
    const own = largest[i] > 0 ? 0.85 * reachOf(robot) / largest[i] : 0;
    if (own > 0) scale = scale > 0 ? Math.min(scale, own) : own;
  });
  return scale;
}

/**
 * The farthest part of the robot from its origin, m.
 * @param {Robot} robot
 */
export function reachOf(robot) {
  const parts = robot.footprint.map(p => Math.hypot(p[0], p[1])).concat(robot.wheels.map(w => Math.hypot(w.mount[0], w.mount[1]) + w.radius * 0.5));
  return Math.max(0.02, ...(parts.length > 0 ? parts : [robot.collision_radius]));
}

/**
 * Contact forces as arrows from the contacts, with the friction circle μN where it is known.
 * @param {View} view
 * @param {Robot} robot
 * @param {RobotState} state
 * @param {{ scale: number, friction: number | null, head?: number }} options `scale` in m/N
 */
export function drawForces(view, robot, state, options) {
  let svg = '';
  robot.wheels.forEach((wheel, i) => {
    const { force, load, heading } = state.wheels[i];
    if (!force || !(options.scale > 0)) return;
    const side = sideOf(wheel);
    const color = side === 'left' ? 'blue' : side === 'right' ? 'vermilion' : 'ink2';
    const turn = state.yaw + heading;
    const trail = wheel.kind === 'caster' || wheel.kind === 'trailer' ? wheel.trail : 0;
    const bx = wheel.mount[0] - trail * Math.cos(heading);
    const by = wheel.mount[1] - trail * Math.sin(heading);
    const x = view.x(state.x + bx * Math.cos(state.yaw) - by * Math.sin(state.yaw));
    const y = view.y(state.y + bx * Math.sin(state.yaw) + by * Math.cos(state.yaw));
    const k = options.scale * view.scale;
    if (options.friction && load !== null) {
      const limit = Math.max(0, options.friction * load);
      const over = Math.hypot(force[0], force[1]) > limit * (1 + 1e-9);
      svg += `<circle cx="${px(x)}" cy="${px(y)}" r="${px(limit * k)}" class="friction s-${color}${over ? ' over' : ''}"/>`;
    }
    const fx = (force[0] * Math.cos(turn) - force[1] * Math.sin(turn)) * k;
    const fy = -(force[0] * Math.sin(turn) + force[1] * Math.cos(turn)) * k;
    const arrow = drawArrow(x, y, x + fx, y + fy, options.head || 7);
    // A rim sets the arrow off from its wheel; round a tiny one it would look like a hole.
    const rim = Math.hypot(fx, fy) > 14 && arrow ? `<path d="${arrow[0]}${arrow[1]}" class="force-casing"/>` : '';
    if (arrow) svg += `${rim}<path d="${arrow[0]}" class="force s-${color}"/><path d="${arrow[1]}" class="f-${color}"/>`;
  });
  return svg;
}

/**
 * Shaft and head of an arrow as two paths; nothing when it is too short to see.
 * @param {number} ax
 * @param {number} ay
 * @param {number} bx
 * @param {number} by
 * @param {number} head length of the head, px
 */
export function drawArrow(ax, ay, bx, by, head) {
  const d = Math.hypot(bx - ax, by - ay);
  if (!(d >= 1.5)) return null;
  const h = Math.min(head, d * 0.7);
  const ux = (bx - ax) / d * h;
  const uy = (by - ay) / d * h;
  const cx = bx - ux;
  const cy = by - uy;
  return [`M${px(ax)} ${px(ay)}L${px(cx)} ${px(cy)}`, `M${px(bx)} ${px(by)}L${px(cx - uy * 0.5)} ${px(cy + ux * 0.5)}L${px(cx + uy * 0.5)} ${px(cy - ux * 0.5)}Z`];
}

/**
 * Robots and forces at time `t`: the layer that is drawn anew when time moves.
 * @param {View} view
 * @param {Run} run
 * @param {Tracks[]} tracks of every robot
 * @param {number} t
 * @param {{ scale: number, head?: number, only?: number }} options `scale` of forces, m/N
 */
export function drawMoving(view, run, tracks, t, options) {
  let svg = '';
  let forces = '';
  run.robots.forEach((robot, i) => {
    const state = stateAt(tracks[i], robot, t);
    svg += drawRobot(view, robot, state, { ring: robotColor(run, i) });
    if (options.only === undefined || options.only === i) forces += drawForces(view, robot, state, { scale: options.scale, friction: run.arena.friction, head: options.head });
  });
  return svg + forces;
}

// Legend ------------------------------------------------------------------------------------------

/**
 * What the picture uses, in words: swatches of `width` × 16 px with their labels.
 * @param {Run} run
 * @param {{ scale: number, contour: number, fastest: number, id: string }} options `scale` of forces in px/N
 * @returns {{ width: number, svg: string, words: string }[]}
 */
function legendItems(run, options) {
  /** @type {{ width: number, svg: string, words: string }[]} */
  const items = [];
  const some = (/** @type {(r: Robot) => unknown} */ test) => run.robots.some(r => Boolean(test(r)));
  if (run.robots.length === 1 && run.time.length > 1) {
    const stops = Array.from({ length: 11 }, (_, i) => `<stop offset="${i / 10}" stop-color="${viridis(i / 10)}"/>`).join('');
    const most = plain(options.fastest);
    const wide = textWidth(most, 11.5);
    items.push({
      width: 122 + wide, words: 'speed on the path, m/s',
      svg: `<linearGradient id="${options.id}-speed">${stops}</linearGradient>${label(0, 12, '0', 'tick')}<rect x="11" y="3.5" width="104" height="9" fill="url(#${options.id}-speed)"/>${label(120, 12, most, 'tick')}`,
    });
  }
  if (isCrowd(run)) items.push({ width: 26, words: `${run.robots.length} robots`, svg: '<path d="M0 8H26" class="trail s-blue"/>' });
  else if (run.robots.length > 1) run.robots.forEach((robot, i) => items.push({ width: 26, words: robot.name, svg: `<path d="M0 8H26" class="trail s-${robotColor(run, i)}"/>` }));
  if (some(r => r.path && r.path.length > 1)) items.push({ width: 26, words: some(r => r.goal && r.goal.kind === 'route') ? 'path to follow' : 'planned path', svg: '<path d="M0 8H26" class="ref"/>' });
  if (some(r => r.goal && r.goal.kind === 'slalom')) items.push({ width: 26, words: 'to be crossed here, this way', svg: '<path d="M13-1V17" class="chord"/><path d="M10 2L16 8L10 14" class="chevron"/>' });
  if (some(r => r.goal && r.goal.kind === 'gate')) items.push({ width: 26, words: 'gate', svg: '<path d="M0 8H26" class="none gate"/>' });
  const corridors = new Set(run.robots.map(r => r.goal && r.goal.kind === 'route' ? r.goal.tolerance : 0));
  for (const tolerance of corridors) if (tolerance > 0) items.push({ width: 26, words: `within ${plain(tolerance)} m of it`, svg: '<path d="M0 8H26" class="corridor" stroke-width="12"/>' });
  const docks = new Set(run.robots.map(r => r.goal && r.goal.kind === 'homing' ? r.goal.distance : 0));
  for (const distance of docks) if (distance > 0) items.push({ width: 18, words: `goal, within ${plain(distance)} m`, svg: '<circle cx="9" cy="8" r="8" class="goal"/>' });
  if (run.arena.beacons.length > 0) {
    const radii = run.arena.beacons.map(b => b.radius);
    const same = radii.every(r => r === radii[0]);
    items.push({ width: 14, words: same ? `beacon, true radius ${plain(radii[0])} m` : 'beacon, true radius', svg: '<circle cx="7" cy="8" r="6" class="beacon"/>' });
  }
  if (options.contour > 0) items.push({ width: 26, words: `contours every ${plain(options.contour)} m of height, darker is lower`, svg: '<rect y="1" width="13" height="14" class="slope" fill-opacity="0.04"/><rect x="13" y="1" width="13" height="14" class="slope" fill-opacity="0.14"/><path d="M13 1V15" class="contour"/>' });
  if (options.scale > 0) {
    let newtons = niceStep(38 / options.scale, 1);
    if (newtons * options.scale < 12) newtons *= 2;
    const w = clamp(newtons * options.scale, 6, 44);
    const arrow = (/** @type {number} */ y) => drawArrow(0, y, w, y, 7) || ['', ''];
    items.push({ width: w, words: `${plain(newtons)} N on a left, right wheel`, svg: `<path d="${arrow(3.5)[0]}" class="force s-blue"/><path d="${arrow(3.5)[1]}" class="f-blue"/><path d="${arrow(12.5)[0]}" class="force s-vermilion"/><path d="${arrow(12.5)[1]}" class="f-vermilion"/>` });
    if (run.arena.friction) items.push({ width: 18, words: 'friction limit μN, same scale; filled if exceeded', svg: '<circle cx="9" cy="8" r="7.5" class="friction s-blue"/>' });
  }
  if (run.robots.length > 0) items.push({ width: 14, words: 'center of mass', svg: '<path d="M1 8a6 6 0 1 0 12 0a6 6 0 1 0 -12 0H13M7 2V14" class="com"/>' });
  return items;
}

/**
 * Whether there are too many robots to name each.
 * @param {Run} run
 */
function isCrowd(run) {
  return run.robots.length > 12;
}

/**
 * The legend in rows.
 * @param {ReturnType<typeof legendItems>} items
 * @param {number} left
 * @param {number} top
 * @param {number} right
 */
function drawLegend(items, left, top, right) {
  let x = left;
  let y = top;
  let svg = '';
  for (const item of items) {
    const words = textWidth(item.words, 12);
    const width = item.width + 7 + words;
    if (x > left && x + width > right) { x = left; y += 23; }
    svg += `<g transform="translate(${px(x)} ${px(y)})">${item.svg}${label(item.width + 7, 12.2, item.words, 'note')}</g>`;
    x += width + 24;
  }
  return { svg, height: items.length > 0 ? y - top + 18 : 0 };
}

// Whole pictures ----------------------------------------------------------------------------------

/**
 * The whole arena in layers; `data-layer` names what a player replaces: `trails`, `moving`.
 * @param {Run} run
 * @param {ArenaOptions} [options]
 */
export function drawArena(run, options = {}) {
  const { width: most = 1120, maxHeight = 560, id = 'arena', legend = true, robots = true } = options;
  const [w, h] = run.arena.size;
  const scale = fittingScale(run, most, maxHeight);
  const narrow = arenaWidth(run, most, maxHeight);
  const width = Math.min(most, Math.max(narrow, options.title ? 560 : 0));
  const top = MARGIN.top + (options.title ? 34 : 0);
  const left = MARGIN.left + (width - w * scale - MARGIN.left - MARGIN.right) / 2;
  const view = viewOf(scale, left, top + h * scale);
  const time = options.time === undefined ? tellingTime(run) : options.time;
  const area = { x: view.x(0) + 2, y: view.y(h) + 2, width: w * scale - 4, height: h * scale - 4 };
  const taken = occupancyOf(area);
  const tracks = run.robots.map(robot => tracksOf(run, robot));
  const fastest = speedLimit(run);
  const newton = forceScale(run);

  // What labels must not cover.
  taken.box({ x: view.x(0), y: view.y(0) - 32, width: 8, height: 32 }, 2);
  taken.box({ x: view.x(0), y: view.y(0) - 8, width: 32, height: 8 }, 2);
  run.robots.forEach((robot, i) => {
    taken.line(trailPoints(view, tracks[i]), 4);
    if (robot.path) taken.line(robot.path.map(p => [view.x(p[0]), view.y(p[1])]), 2);
    const state = stateAt(tracks[i], robot, time);
    taken.disc(view.x(state.x), view.y(state.y), reachOf(robot) * scale * (newton > 0 ? 1.7 : 1.1), 1.5);
  });
  for (const b of run.arena.beacons) taken.disc(view.x(b.position[0]), view.y(b.position[1]), Math.max(2, b.radius * scale), 6);

  const ground = drawGround(view, run, { numbers: true });
  const terrain = drawTerrain(view, run, id);
  // Robots with one goal in common draw it once.
  const goals = [...new Set(run.robots.map(robot => drawGoal(view, run, robot, taken)))].join('');
  const beacons = drawBeacons(view, run, taken);
  const events = drawEvents(view, run, taken);
  const starts = run.robots.map((robot, i) => {
    const [x, y, yaw] = robot.start;
    const name = isCrowd(run) ? '' : run.robots.length > 1 ? robot.name : 'start';
    const boxes = around(view.x(x), view.y(y), 12, textWidth(name, 12), 12);
    const box = taken.best(boxes);
    if (name) taken.box(box, 3);
    const color = robotColor(run, i);
    return `<path transform="translate(${px(view.x(x))} ${px(view.y(y))}) rotate(${px(-yaw * 180 / Math.PI)})" d="M0-9V9M0-4.5L6 0L0 4.5" class="start"/>${label(box.x + box.width / 2, box.y + 10.5, name, color ? `halo bold t-${color}` : 'note halo', 'middle')}`;
  }).join('');
  const corner = (/** @type {number} */ cw, /** @type {number} */ ch) => {
    const xs = [area.x + area.width - cw - 8, area.x + 8];
    const ys = [area.y + area.height - ch - 6, area.y + 8];
    const found = taken.best([[0, 0], [0, 1], [1, 1], [1, 0]].map(([i, j]) => ({ x: xs[i] + (i && !j ? 34 : 0), y: ys[j], width: cw, height: ch })).concat([0.25, 0.5, 0.75].map(f => ({ x: area.x + (area.width - cw) * f, y: ys[0], width: cw, height: ch }))));
    taken.box(found, 6);
    return found;
  };
  const bar = niceStep(Math.min(140, w * scale * 0.4) / scale, 1);
  const barBox = corner(bar * scale, 24);
  let furniture = drawScaleBar(barBox.x, barBox.y + 19, bar, scale);
  if (terrain.step > 0 && run.arena.terrain.kind === 'plane') { const b = corner(96, 30); furniture += downhillArrow(run, b.x, b.y); }

  const paths = run.robots.map(robot => robot.path && robot.path.length > 1 ? `<path d="${pathText(simplify(robot.path.map(p => [view.x(p[0]), view.y(p[1])]), 0.15))}" class="ref"/>` : '').join('');
  const trails = run.robots.map((_, i) => `<g data-robot="${i}">${drawTrail(view, run, i, fastest)}</g>`).join('');
  const moving = robots ? drawMoving(view, run, tracks, time, { scale: newton }) : '';
  const keyTop = view.y(0) + MARGIN.bottom + 8;
  const key = legend ? drawLegend(legendItems(run, { scale: newton * scale, contour: terrain.step, fastest, id }), left < MARGIN.left + 40 ? left : 12, keyTop, width - 6) : { svg: '', height: 0 };
  const height = Math.ceil(legend && key.height ? keyTop + key.height + 2 : view.y(0) + MARGIN.bottom);
  const titleLeft = left < MARGIN.left + 40 ? left : 12;
  let words = options.title || '';
  if (textWidth(words, 18) > width - titleLeft - 8) {
    while (words && textWidth(words + '…', 18) > width - titleLeft - 8) words = words.slice(0, -1);
    words += '…';
  }
  const title = words ? label(titleLeft, 22, words, 'title') : '';
  const svg = `${title}${ground.below}${terrain.svg}${ground.above}${drawOrigin(view)}${goals}${paths}${starts}<g data-layer="trails">${trails}</g>${beacons}${furniture}${events}<g data-layer="moving">${moving}</g>${key.svg}`;
  return { svg, width, height, view };
}

/**
 * The robot close up, the world moving under it: everything in its neighborhood.
 * @param {Run} run
 * @param {number} index of the robot
 * @param {{ width: number, height: number, time: number, id: string, spare?: number }} options `spare`: how far the robot may move, in windows, until the picture must be drawn anew
 */
export function drawCloseUp(run, index, options) {
  const robot = run.robots[index];
  const { width, height, time, id } = options;
  const newton = forceScale(run);
  const tracks = run.robots.map(r => tracksOf(run, r));
  const state = stateAt(tracks[index], robot, time);
  // The footprint may lie far from the axle's middle; the camera holds its center.
  const xs = robot.footprint.map(p => p[0]);
  const middle = xs.length > 0 ? (Math.min(...xs) + Math.max(...xs)) / 2 : 0;
  const reach = Math.max(reachOf(robot) - Math.abs(middle) * 0.5, 0.02);
  const scale = Math.min(height, width) / (reach * (newton > 0 ? 3.5 : 2.9));
  const view = viewOf(scale, 0, 0);
  const place = closeUpPlace(view, state, middle, width, height);
  const half = Math.hypot(width, height) / 2 / scale;
  const far = half * (1 + (options.spare || 0)) + 0.1;
  /** @type {Bounds} */
  const bounds = { low: [state.x - far - Math.abs(middle), state.y - far - Math.abs(middle)], high: [state.x + far + Math.abs(middle), state.y + far + Math.abs(middle)] };
  const ground = drawGround(view, run, { bounds });
  const terrain = drawTerrain(view, run, id);
  const fastest = speedLimit(run);
  const within = (/** @type {Point} */ p) => p[0] > bounds.low[0] && p[0] < bounds.high[0] && p[1] > bounds.low[1] && p[1] < bounds.high[1];
  const paths = run.robots.map(r => r.path ? `<path d="${pathText(simplify(r.path.map(p => within(p) ? [view.x(p[0]), view.y(p[1])] : [NaN, NaN]), 0.2))}" class="ref"/>` : '').join('');
  const goals = [...new Set(run.robots.map(r => drawGoal(view, run, r)))].join('');
  const trails = run.robots.map((_, i) => `<g data-robot="${i}">${drawTrail(view, run, i, fastest, bounds)}</g>`).join('');
  const bar = niceStep(90 / scale, 1);
  const words = forceWords(run, robot, state).slice(0, 8);
  // Words stand below the picture, two to a row, so that they cover nothing.
  const rows = Math.ceil(words.length / 2);
  const notes = words.map((word, i) => `<text x="${i % 2 ? px(width / 2 + 4) : 2}" y="${px(height + 18 + Math.floor(i / 2) * 18)}"><tspan class="bold t-${word.color}">${escapeText(word.name)}</tspan> <tspan class="note f-ink2">${word.text}</tspan></text>`).join('');
  return {
    height: height + (rows > 0 ? rows * 18 + 8 : 0), view, middle, bounds, reach: half * (options.spare || 0),
    svg: `<clipPath id="${id}-clip"><rect width="${px(width)}" height="${px(height)}" rx="8"/></clipPath><g clip-path="url(#${id}-clip)"><rect width="${px(width)}" height="${px(height)}" class="ground"/><g data-layer="world" transform="${place}">${ground.below}${terrain.svg}${ground.above}${goals}${paths}<g data-layer="trails">${trails}</g>${drawBeacons(view, run)}<g data-layer="moving">${drawMoving(view, run, tracks, time, { scale: newton, head: 11, only: index })}</g></g>${drawScaleBar(width - 14 - bar * scale, height - 14, bar, scale)}</g><g data-layer="words">${notes}</g><rect x=".5" y=".5" width="${px(width - 1)}" height="${px(height - 1)}" rx="8" class="frame"/>`,
  };
}

/**
 * Transform of the close-up's world that brings the robot to the middle.
 * @param {View} view
 * @param {RobotState} state
 * @param {number} middle of the footprint along the body's x, m
 * @param {number} width
 * @param {number} height
 */
export function closeUpPlace(view, state, middle, width, height) {
  const x = state.x + middle * Math.cos(state.yaw);
  const y = state.y + middle * Math.sin(state.yaw);
  return `translate(${px(width / 2 - view.x(x))} ${px(height / 2 - view.y(y))})`;
}

/**
 * How hard each wheel pushes, in words: `8.2 of 28.2 N`.
 * @param {Run} run
 * @param {Robot} robot
 * @param {RobotState} state
 */
export function forceWords(run, robot, state) {
  const friction = run.arena.friction;
  return robot.wheels.flatMap((wheel, i) => {
    const { force, load } = state.wheels[i];
    if (!force) return [];
    const side = sideOf(wheel);
    const size = Math.hypot(force[0], force[1]).toFixed(1);
    return [{ name: wheel.name, color: side === 'left' ? 'blue' : side === 'right' ? 'vermilion' : 'ink', text: friction && load !== null ? `${size} of ${(friction * load).toFixed(1)} N` : `${size} N` }];
  });
}

/**
 * A complete SVG document of a picture's inside.
 * @param {string} inside
 * @param {number} width
 * @param {number} height
 * @param {string} title
 * @param {'light' | 'dark'} [theme]
 */
export function standalone(inside, width, height, title, theme = 'light') {
  const palette = theme === 'dark' ? DARK : LIGHT;
  return `<svg xmlns="http://www.w3.org/2000/svg" class="picture" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" role="img" font-family="${escapeText(FONT)}"><title>${escapeText(title)}</title><style>${pictureStyle(name => palette[name])}</style><rect width="${width}" height="${height}" class="ground"/>${inside}</svg>\n`;
}

/**
 * The trajectory as a picture of its own: arena, path, events, robot, legend.
 * @param {Run} data
 * @param {ArenaOptions & { theme?: 'light' | 'dark' }} [options]
 */
export function renderArena(data, options = {}) {
  const title = options.title === undefined ? data.scenario.title || data.scenario.name : options.title;
  const picture = drawArena(data, { maxHeight: 720, ...options, title });
  return standalone(picture.svg, picture.width, picture.height, title || 'arena', options.theme);
}
