/* A controller to start from: drives to the beacon of the task and stops beside it.
 *
 *   npm install
 *   npm run build
 *
 * makes build/NAME.wasm, a module with the same bits on every machine: `Math` is compiled into it.
 */

// What it reads: signals of the robot with their units, and the place of the task's beacon. What it writes,
// and within which limits: more is a fault. Numbers that a scenario, --set and a batch can change.
const DESCRIPTION = String.UTF8.encode(
  `{"protocol": 1, "name": "NAME", "about": "Turns to the beacon and drives to it.",
    "inputs": [{"name": "pose.x", "unit": "m"}, {"name": "pose.y", "unit": "m"},
      {"name": "pose.yaw", "unit": "rad"},
      {"name": "task.beacon.x", "unit": "m"}, {"name": "task.beacon.y", "unit": "m"}],
    "outputs": [{"name": "command.forward", "unit": "m/s", "min": -1, "max": 1},
      {"name": "command.yaw_rate", "unit": "rad/s", "min": -2, "max": 2},
      {"name": "controller.distance", "unit": "m"}],
    "parameters": [{"name": "speed", "unit": "m/s", "default": 0.6, "min": 0, "max": 1},
      {"name": "gain", "unit": "1/s", "default": 2, "min": 0, "max": 10},
      {"name": "stop", "unit": "m", "default": 0.4, "min": 0, "max": 5,
        "about": "distance from the beacon"}]}`,
  true, // with the zero at its end
);

enum Input { X, Y, YAW, BEACON_X, BEACON_Y, COUNT }
enum Output { FORWARD, YAW_RATE, DISTANCE, COUNT }
enum Parameter { SPEED, GAIN, STOP }

// One life of the controller. All that lasts from step to step belongs into it: a module has many, and
// `speed` is what is saved.
@unmanaged
class Member {
  speed: f64;
  speedMax: f64;
  gain: f64;
  stop: f64;
}

// @ts-ignore: decorator
@inline
function at(numbers: usize, place: i32): f64 {
  return load<f64>(numbers + 8 * place);
}

function clamp(value: f64, least: f64, most: f64): f64 {
  return min(max(value, least), most);
}

export function appell_abi(): u32 {
  return 1;
}

export function appell_describe(): usize {
  return changetype<usize>(DESCRIPTION);
}

export function appell_create(parameters: usize, context: usize): usize {
  const member = changetype<Member>(heap.alloc(offsetof<Member>()));
  member.speed = 0.0;
  member.speedMax = at(parameters, Parameter.SPEED);
  member.gain = at(parameters, Parameter.GAIN);
  member.stop = at(parameters, Parameter.STOP);
  return changetype<usize>(member);
}

export function appell_destroy(member: usize): void {
  heap.free(member);
}

export function appell_step(member: usize, t: f64, dt: f64, inputs: usize, outputs: usize): i32 {
  const self = changetype<Member>(member);
  const dx = at(inputs, Input.BEACON_X) - at(inputs, Input.X);
  const dy = at(inputs, Input.BEACON_Y) - at(inputs, Input.Y);
  const left = Math.sqrt(dx * dx + dy * dy) - self.stop;
  const turn = Math.atan2(dy, dx) - at(inputs, Input.YAW);
  const bearing = turn - 2.0 * Math.PI * nearest(turn / (2.0 * Math.PI));

  // Speed up gently; brake so as to stop in time.
  const brakes = Math.sqrt(2.0 * 0.3 * max(left, 0.0));
  const wanted = abs(bearing) < 0.5 ? min(self.speedMax, brakes) : 0.0;
  self.speed += clamp(wanted - self.speed, -0.6 * dt, 0.6 * dt);
  store<f64>(outputs + 8 * Output.FORWARD, self.speed);
  store<f64>(outputs + 8 * Output.YAW_RATE, left > 0.02 ? clamp(self.gain * bearing, -1.2, 1.2) : 0.0);
  store<f64>(outputs + 8 * Output.DISTANCE, left);
  return 0;
}

// Many at once, at one price of a call.
export function appell_step_many(
  count: i32, members: usize, t: usize, dt: f64, inputs: usize, outputs: usize,
): i32 {
  for (let k = 0; k < count; k++) {
    const failed = appell_step(
      load<usize>(members + 4 * k), at(t, k), dt,
      inputs + 8 * Input.COUNT * k, outputs + 8 * Output.COUNT * k,
    );
    if (failed) return k + 1;
  }
  return 0;
}

export function appell_save(member: usize, bytes: usize, room: usize): usize {
  if (room >= 8) store<f64>(bytes, changetype<Member>(member).speed);
  return 8;
}

export function appell_restore(member: usize, bytes: usize, length: usize): i32 {
  if (length != 8) return 1;
  changetype<Member>(member).speed = load<f64>(bytes);
  return 0;
}

// One that takes over from another begins at its speed, as far as it may.
export function appell_take_over(member: usize, outputs: usize): i32 {
  changetype<Member>(member).speed = clamp(at(outputs, Output.FORWARD), -1.0, 1.0);
  return 0;
}

// A place for what Appell writes and reads, which is its own until it asks again.
const ROOM_MAX: usize = 1 << 28;
let room: usize = 0;
let roomSize: usize = 0;

export function appell_room(size: usize): usize {
  if (size > ROOM_MAX) return 0;
  if (!room || size > roomSize) {
    if (room) heap.free(room);
    room = heap.alloc(size);
    roomSize = size;
  }
  return room;
}
