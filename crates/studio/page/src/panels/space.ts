// The arena in space: the ground as it slopes, robots, beacons, trails and forces, seen from where one likes.
// Drawn by three.js, which is loaded when the panel is opened first.

import {
  AmbientLight, ArrowHelper, BufferGeometry, CylinderGeometry, DirectionalLight, EdgesGeometry, ExtrudeGeometry, Float32BufferAttribute, Group, Line as Curve, LineBasicMaterial,
  LineDashedMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, PlaneGeometry, RingGeometry, Scene, Shape, SphereGeometry, Vector3, WebGLRenderer, type Material, type Object3D,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import { outlineOf, sideOf } from '../../../../sim/web/arena.js';
import { viridis } from '../../../../sim/web/draw.js';
import { stateAt, type Robot, type RobotState } from '../../../../sim/web/run.js';
import { heightOf, jumpAt, type Relief } from '../../../../sim/web/terrain.js';
import { color } from '../look';
import type { Line } from '../net';
import { eachPicture, type OwnHost, type Panel } from '../panel';
import { tr } from '../words';

/** Height of beacons, for which the scenario has none, m. */
const BEACON = 0.35;
/** Half width of a trail, m. */
const TRAIL = 0.012;

/** Parts of a cell, to each side, in which something jumps. */
const FINE = 12;

/** Uneven ground: smooth where it is, with flat faces in the cells in which it jumps, and lit, that one sees its form. */
function landscape(terrain: Relief, w: number, h: number): Mesh[] {
  const { columns } = terrain;
  const rows = terrain.levels.length / columns;
  const [dx, dy] = [w / columns, h / rows];
  const over = (x: number, y: number) => heightOf(terrain, x, y) - 0.002;
  const smooth: number[] = [], faces: number[] = [], nodes: number[] = [];
  for (let j = 0; j <= rows; j++) for (let i = 0; i <= columns; i++) nodes.push(i * dx, j * dy, over(i * dx, j * dy));
  const jumps = (i: number, j: number) => {
    const here = jumpAt(terrain, i * dx, j * dy);
    for (let b = 0; b <= 4; b++) for (let a = 0; a <= 4; a++) if (Math.abs(jumpAt(terrain, (i + a / 4) * dx, (j + b / 4) * dy) - here) > 1e-9) return true;
    return false;
  };
  for (let j = 0; j < rows; j++) for (let i = 0; i < columns; i++) {
    const n = j * (columns + 1) + i;
    if (!terrain.jumps?.length || !jumps(i, j)) { smooth.push(n, n + 1, n + columns + 1, n + 1, n + columns + 2, n + columns + 1); continue; }
    for (let b = 0; b < FINE; b++) for (let a = 0; a < FINE; a++) {
      const [x0, x1, y0, y1] = [i + a / FINE, i + (a + 1) / FINE, j + b / FINE, j + (b + 1) / FINE];
      const corner = (x: number, y: number) => faces.push(x * dx, y * dy, over(x * dx, y * dy));
      corner(x0, y0); corner(x1, y0); corner(x0, y1);
      corner(x1, y0); corner(x1, y1); corner(x0, y1);
    }
  }
  const meshes = [[nodes, smooth], [faces, null]].map(([points, index]) => {
    const geometry = new BufferGeometry().setAttribute('position', new Float32BufferAttribute(points as number[], 3));
    if (index) geometry.setIndex(index);
    geometry.computeVertexNormals();
    return new Mesh(geometry, new MeshLambertMaterial({ color: color('line') }));
  });
  return faces.length > 0 ? meshes : meshes.slice(0, 1);
}

const wheelCenter = (wheel: Robot['wheels'][number], heading: number): [number, number] => {
  const back = wheel.kind === 'caster' ? wheel.trail : 0;
  return [wheel.mount[0] - back * Math.cos(heading), wheel.mount[1] - back * Math.sin(heading)];
};

/** A robot whose parts are put to where a state has them. */
class Model {
  readonly group = new Group();
  private readonly wheels: { turn: Group; spin: Object3D }[] = [];

  constructor(private readonly robot: Robot, ghost: string | null) {
    const radius = Math.max(0.02, ...robot.wheels.filter(w => w.kind !== 'caster' && w.kind !== 'trailer').map(w => w.radius));
    const outline = outlineOf(robot) as [number, number][];
    const shape = new Shape();
    outline.forEach(([x, y], k) => { if (k === 0) shape.moveTo(x, y); else shape.lineTo(x, y); });
    const body = new ExtrudeGeometry(shape, { depth: radius * 0.5, bevelEnabled: false });
    const edges = new LineSegments(new EdgesGeometry(body, 20), new LineBasicMaterial({ color: color(ghost ?? 'bodyLine'), transparent: ghost !== null, opacity: ghost ? 0.7 : 1 }));
    edges.position.z = radius * 0.9;
    this.group.add(edges);
    if (ghost) return;
    const hull = new Mesh(body, new MeshLambertMaterial({ color: color('line'), polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
    hull.position.z = radius * 0.9;
    this.group.add(hull);
    // The heading, as a dot at the front.
    const front = Math.max(...outline.map(p => p[0]));
    const nose = new Mesh(new SphereGeometry(radius * 0.16, 12, 8), new MeshLambertMaterial({ color: color('ink') }));
    nose.position.set(front * 0.6, 0, radius * 1.42);
    this.group.add(nose);
    for (const wheel of robot.wheels) {
      const turn = new Group();
      const side = sideOf(wheel);
      const rim = new MeshLambertMaterial({ color: color(side === 'left' ? 'blue' : side === 'right' ? 'vermilion' : 'ink2') });
      const spin = new Group();
      const disc = new Mesh(new CylinderGeometry(wheel.radius, wheel.radius, Math.max(0.008, wheel.width), 32), rim);
      // Spokes, or rollers at their angle, show that it turns.
      const marks: number[] = [];
      const count = wheel.kind === 'rollers' ? 12 : 6;
      for (let k = 0; k < count; k++) {
        const a = k / count * 2 * Math.PI, w = Math.max(0.008, wheel.width) / 2 * 1.02, r = wheel.radius * 1.01;
        if (wheel.kind === 'rollers') {
          const d = Math.max(-0.8, Math.min(0.8, w / Math.max(0.2, Math.abs(Math.tan(wheel.roller_angle))) / r)) * Math.sign(wheel.roller_angle || 1);
          marks.push(r * Math.cos(a - d), -w, r * Math.sin(a - d), r * Math.cos(a + d), w, r * Math.sin(a + d));
        } else for (const y of [-w, w]) marks.push(0, y, 0, r * Math.cos(a), y, r * Math.sin(a));
      }
      const lines = new LineSegments(new BufferGeometry().setAttribute('position', new Float32BufferAttribute(marks, 3)), new LineBasicMaterial({ color: color('background') }));
      spin.add(disc, lines);
      spin.position.z = wheel.radius;
      turn.add(spin);
      if (wheel.kind === 'trailer') {
        const bar = new LineSegments(new BufferGeometry().setAttribute('position', new Float32BufferAttribute([0, 0, wheel.radius, -wheel.trail, 0, wheel.radius], 3)), new LineBasicMaterial({ color: color('ink2') }));
        turn.add(bar);
        spin.position.x = -wheel.trail;
        const other = spin.clone();
        spin.position.y = (wheel.track ?? 0) / 2;
        other.position.set(-wheel.trail, -(wheel.track ?? 0) / 2, wheel.radius);
        turn.add(other);
      } else if (wheel.kind === 'caster') spin.position.x = -wheel.trail;
      turn.position.set(wheel.mount[0], wheel.mount[1], 0);
      this.group.add(turn);
      this.wheels.push({ turn, spin });
    }
  }

  put(state: RobotState): void {
    this.group.position.set(state.x, state.y, state.z);
    this.group.rotation.set(state.roll, state.pitch, state.yaw, 'ZYX');
    this.wheels.forEach(({ turn, spin }, k) => {
      turn.rotation.z = state.wheels[k].heading;
      spin.rotation.y = state.wheels[k].spin % (2 * Math.PI);
    });
  }

  get name(): string { return this.robot.name; }
}

export function connect(host: OwnHost): Panel {
  const canvas = document.createElement('canvas');
  canvas.setAttribute('role', 'img');
  canvas.tabIndex = 0;
  canvas.style.cssText = 'width:100%;height:100%;display:block;touch-action:none';
  host.root.append(canvas);
  const renderer = new WebGLRenderer({ canvas, antialias: true });
  renderer.setPixelRatio(Math.min(2, devicePixelRatio));
  const camera = new PerspectiveCamera(38, 1, 0.02, 200);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.maxPolarAngle = 0.495 * Math.PI;
  let isMoved = true;
  controls.addEventListener('change', () => { isMoved = true; });
  let scene = new Scene();
  let ground = new Group();
  let models: Model[] = [];
  let ghosts: { model: Model; line: Line; robot: number }[] = [];
  let trail: Mesh | null = null;
  let forces = new Group();
  let built = '', key = '', trailed = -1;

  const clear = (object: Object3D) => object.traverse(one => {
    const { geometry, material } = one as Mesh;
    geometry?.dispose();
    for (const each of [material].flat() as Material[]) each?.dispose();
  });

  /** Height of the ground that is drawn, m. */
  const over = (x: number, y: number) => {
    const { terrain } = host.studio().line.run.arena;
    return terrain.kind === 'uneven' ? heightOf(terrain, x, y) : 0;
  };

  const build = () => {
    const { line, others } = host.studio();
    const { arena } = line.run;
    const [w, h] = arena.size;
    clear(scene);
    scene = new Scene();
    scene.background = null;
    renderer.setClearColor(color('chrome') || '#ffffff', 1);
    const sun = new DirectionalLight('#ffffff', 1.7);
    sun.position.set(-3, -4, 8);
    scene.add(new AmbientLight('#ffffff', 2), sun);
    ground = new Group();
    scene.add(ground);
    // What is drawn lies in the plane of the ground, which is tilted as a whole.
    const { terrain } = arena;
    if (terrain.kind === 'plane') {
      const heading = terrain.downhill_heading_deg * Math.PI / 180;
      ground.quaternion.setFromAxisAngle(new Vector3(-Math.sin(heading), Math.cos(heading), 0), terrain.slope_deg * Math.PI / 180);
    }
    const isUneven = terrain.kind === 'uneven';
    if (isUneven) ground.add(...landscape(terrain, w, h));
    else {
      const floor = new Mesh(new PlaneGeometry(w, h), new MeshBasicMaterial({ color: color('floor') }));
      floor.position.set(w / 2, h / 2, -0.002);
      ground.add(floor);
    }
    const grid: number[] = [];
    /** A line of the grid, in pieces that lie on the ground. */
    const ruled = (ax: number, ay: number, bx: number, by: number) => {
      const pieces = isUneven ? 640 : 1;
      const at = (k: number): [number, number, number] => {
        const [x, y] = [ax + (bx - ax) * k / pieces, ay + (by - ay) * k / pieces];
        return [x, y, over(x, y) + (isUneven ? 0.003 : 0)];
      };
      for (let k = 0; k < pieces; k++) grid.push(...at(k), ...at(k + 1));
    };
    for (let x = 0; x <= w + 1e-9; x += 0.5) ruled(x, 0, x, h);
    for (let y = 0; y <= h + 1e-9; y += 0.5) ruled(0, y, w, y);
    const inside = grid.length;
    ruled(0, 0, w, 0);
    ruled(w, 0, w, h);
    ruled(w, h, 0, h);
    ruled(0, h, 0, 0);
    const wall = grid.splice(inside);
    const segments = (points: number[], name: string) => new LineSegments(new BufferGeometry().setAttribute('position', new Float32BufferAttribute(points, 3)), new LineBasicMaterial({ color: color(name) }));
    ground.add(segments(grid, 'gridMajor'), segments(wall, 'wall'));
    for (const beacon of arena.beacons) {
      const post = new Mesh(new CylinderGeometry(beacon.radius, beacon.radius, BEACON, 28), new MeshLambertMaterial({ color: color('orange') }));
      post.rotation.x = Math.PI / 2;
      post.position.set(beacon.position[0], beacon.position[1], BEACON / 2 + over(beacon.position[0], beacon.position[1]));
      ground.add(post);
    }
    for (const patch of arena.patches ?? []) {
      const [a, b] = [patch.low, patch.high];
      const area = new Mesh(new PlaneGeometry(b[0] - a[0], b[1] - a[1]), new MeshBasicMaterial({ color: color('sky'), transparent: true, opacity: 0.25 }));
      area.position.set((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, 0.001 + over((a[0] + b[0]) / 2, (a[1] + b[1]) / 2));
      ground.add(area);
    }
    for (const robot of line.run.robots) {
      if (!robot.path || robot.path.length < 2) continue;
      const curve = new Curve(new BufferGeometry().setFromPoints(robot.path.map(p => new Vector3(p[0], p[1], 0.006 + over(p[0], p[1])))), new LineDashedMaterial({ color: color('reference'), dashSize: 0.06, gapSize: 0.05 }));
      curve.computeLineDistances();
      ground.add(curve);
    }
    models = line.run.robots.map(robot => new Model(robot, null));
    for (const model of models) ground.add(model.group);
    ghosts = others.slice(0, 4).flatMap(other => other.line.run.robots.map((robot, k) => ({ model: new Model(robot, other.color), line: other.line, robot: k })));
    for (const { model } of ghosts) ground.add(model.group);
    for (const other of others.slice(0, 4)) for (const tracks of other.line.tracks) {
      const points = tracks.x.flatMap((x, k) => k % 3 === 0 ? [new Vector3(Number(x), Number(tracks.y[k]), 0.008 + over(Number(x), Number(tracks.y[k])))] : []);
      ground.add(new Curve(new BufferGeometry().setFromPoints(points), new LineBasicMaterial({ color: color(other.color) })));
    }
    forces = new Group();
    ground.add(forces);
    trail = null;
    trailed = -1;
    canvas.setAttribute('aria-label', `${tr('Arena in space')}: ${line.scene.name}`);
  };

  /** A ribbon on the ground, colored by speed. */
  const drawTrail = () => {
    const { line } = host.studio();
    if (trail) { ground.remove(trail); clear(trail); }
    const position: number[] = [], colors: number[] = [], index: number[] = [];
    const fastest = line.speedLimit;
    for (const tracks of line.tracks) {
      let last: [number, number] | null = null;
      for (let k = 0; k < tracks.time.length; k++) {
        const [x, y] = [Number(tracks.x[k]), Number(tracks.y[k])];
        if (last && Math.hypot(x - last[0], y - last[1]) < 0.01) continue;
        const yaw = last ? Math.atan2(y - last[1], x - last[0]) : Number(tracks.yaw[k]);
        const [nx, ny] = [-Math.sin(yaw) * TRAIL, Math.cos(yaw) * TRAIL];
        const rgb = viridis(tracks.speed[k] / fastest).match(/[0-9a-f]{2}/gi)?.map((part: string) => (parseInt(part, 16) / 255) ** 2.2) ?? [0, 0, 0];
        if (last) { const n = position.length / 3; index.push(n - 2, n - 1, n, n - 1, n + 1, n); }
        const z = over(x, y) + 0.01;
        position.push(x + nx, y + ny, z, x - nx, y - ny, z);
        colors.push(...rgb, ...rgb);
        last = [x, y];
      }
    }
    const geometry = new BufferGeometry().setAttribute('position', new Float32BufferAttribute(position, 3)).setAttribute('color', new Float32BufferAttribute(colors, 3));
    geometry.setIndex(index);
    trail = new Mesh(geometry, new MeshBasicMaterial({ vertexColors: true, side: 2 }));
    ground.add(trail);
  };

  const drawForces = (states: RobotState[]) => {
    const { line, forces: wanted } = host.studio();
    ground.remove(forces);
    clear(forces);
    forces = new Group();
    ground.add(forces);
    const scale = wanted ? line.forceScale : 0;
    if (!(scale > 0)) return;
    line.run.robots.forEach((robot, i) => robot.wheels.forEach((wheel, k) => {
      const { force, load, heading } = states[i].wheels[k];
      if (!force) return;
      const { x, y, yaw } = states[i];
      const [bx, by] = wheelCenter(wheel, heading);
      const at = new Vector3(x + bx * Math.cos(yaw) - by * Math.sin(yaw), y + bx * Math.sin(yaw) + by * Math.cos(yaw), 0);
      at.z = over(at.x, at.y) + 0.012;
      const side = sideOf(wheel);
      const name = color(side === 'left' ? 'blue' : side === 'right' ? 'vermilion' : 'ink2');
      const turn = yaw + heading;
      const along = new Vector3(force[0] * Math.cos(turn) - force[1] * Math.sin(turn), force[0] * Math.sin(turn) + force[1] * Math.cos(turn), 0).multiplyScalar(scale);
      if (along.length() > 0.01) forces.add(new ArrowHelper(along.clone().normalize(), at, along.length(), name, Math.min(0.08, along.length() * 0.4), 0.04));
      const { friction } = line.run.arena;
      if (friction && load !== null && load > 0) {
        const limit = friction * load * scale;
        const ring = new Mesh(new RingGeometry(limit - 0.004, limit + 0.004, 48), new MeshBasicMaterial({ color: name, side: 2, transparent: true, opacity: 0.6 }));
        ring.position.copy(at);
        forces.add(ring);
      }
    }));
  };

  const look = () => {
    const [w, h] = host.studio().line.run.arena.size;
    controls.target.set(w / 2, h * 0.46, 0);
    const far = Math.max(w / Math.max(0.6, camera.aspect), h) * 1.5 + 0.5;
    camera.position.set(w / 2 - far * 0.2, h / 2 - far * 0.95, far * 0.72);
    controls.update();
  };
  let framed = '';

  const stop = eachPicture(host.fail, () => {
    const { line, others, time, theme, follow, forces: wanted } = host.studio();
    const [width, height] = [host.root.clientWidth, host.root.clientHeight];
    if (width < 2 || height < 2 || line.run.time.length === 0) return;
    const size = `${width}x${height}`;
    const nowBuilt = `${line.id} ${theme} ${others.map(o => `${o.about.id} ${o.about.over}`)}`;
    const t = time();
    const nowKey = `${size} ${t} ${line.run.time.length} ${wanted}`;
    if (nowBuilt === built && nowKey === key && !isMoved && follow !== 'follow') return;
    if (!key.startsWith(`${size} `)) {
      renderer.setSize(width, height, false);
      camera.aspect = width / height;
      camera.updateProjectionMatrix();
    }
    if (nowBuilt !== built) build();
    const wantedView = `${line.scene.name} ${follow === 'fit'}`;
    if (framed !== wantedView && follow !== 'follow') { framed = wantedView; look(); }
    built = nowBuilt;
    key = nowKey;
    isMoved = false;
    if (trailed < 0 || line.run.time.length - trailed > 12 || line.run.time.length < trailed) { drawTrail(); trailed = line.run.time.length; }
    const states = line.run.robots.map((robot, k) => stateAt(line.tracks[k], robot, t));
    models.forEach((model, k) => model.put(states[k]));
    for (const { model, line: other, robot } of ghosts) model.put(stateAt(other.tracks[robot], other.run.robots[robot], t));
    drawForces(states);
    if (follow === 'follow') {
      const at = ground.localToWorld(new Vector3(states[0].x, states[0].y, states[0].z));
      camera.position.add(at.clone().sub(controls.target));
      controls.target.copy(at);
      const away = camera.position.clone().sub(at);
      if (framed !== 'follow') { framed = 'follow'; camera.position.copy(at).add(away.setLength(2.4)); }
      controls.update();
    }
    renderer.render(scene, camera);
  });

  return {
    draw() {},
    disconnect() {
      stop();
      clear(scene);
      controls.dispose();
      renderer.dispose();
      renderer.forceContextLoss();
    },
  };
}
