"""The blog's command from another process: in by DDS, odometry and transforms out.

    drive.py DOMAIN SECONDS TIMEOUT

0.2 m/s and 1 rad/s at 15 Hz of the simulation, for so long; then nothing. Prints what came as JSON.
"""

import json
import math
import sys
import time

from ros2types import BEST, KEPT, Clock, JointState, Odometry, Peer, TFMessage, Twist, twist

domain, seconds, timeout = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
peer = Peer(domain)
clock = peer.reader("/clock", Clock, BEST)
odom = peer.reader("/odom", Odometry)
tf = peer.reader("/tf", TFMessage)
static = peer.reader("/tf_static", TFMessage, KEPT)
joints = peer.reader("/joint_states", JointState)
command = peer.writer("/cmd_vel", Twist)

odometry, transforms, states, fixed, clocks = [], [], [], [], []
began = next_command = stopped = None
deadline = time.monotonic() + 120
while time.monotonic() < deadline:
    clocks += [one.clock.ns() for one in clock.take(N=1000)]
    odometry += odom.take(N=1000)
    transforms += tf.take(N=1000)
    states += joints.take(N=1000)
    fixed += static.take(N=10)
    # What was said before all had met does not count.
    if began is None and clocks and odometry and states and transforms and fixed:
        began = max(clocks[-1], odometry[-1].header.stamp.ns()) + 500_000_000
        next_command = clocks[-1]
    if began is not None:
        now = clocks[-1]
        if stopped is None and now >= next_command:
            command.write(twist(0.2, 1.0))
            next_command += 66_666_667
            if now - began > seconds * 1e9:
                stopped = now
        if stopped is not None and now - stopped > (timeout + 1.5) * 1e9:
            break
    time.sleep(0.0005)
else:
    sys.exit("timed out: %d clocks, %d odometries" % (len(clocks), len(odometry)))

stamps = [one.header.stamp.ns() for one in odometry if began <= one.header.stamp.ns() <= stopped]
held = [one for one in states if began + 2e9 <= one.header.stamp.ns() <= stopped]
rates = [dict(zip(one.name, one.velocity)) for one in held]
# The circle through the poses while it drove: its centre is a radius to the left of each.
centers = []
for one in odometry:
    if began + 2e9 <= one.header.stamp.ns() <= stopped:
        p, q = one.pose.pose.position, one.pose.pose.orientation
        yaw = 2 * math.atan2(q.z, q.w)
        centers.append((p.x - 0.2 * math.sin(yaw), p.y + 0.2 * math.cos(yaw)))
spread = max(math.dist(a, centers[0]) for a in centers)
still = [one for one in states if one.header.stamp.ns() > stopped + (timeout + 1) * 1e9]
falls = [
    one.header.stamp.ns()
    for one in states
    if one.header.stamp.ns() > stopped and abs(dict(zip(one.name, one.velocity))["left"]) < 1e-9
]
frames = {t.child_frame_id: t.header.frame_id for one in transforms for t in one.transforms}
print(
    json.dumps(
        {
            "stamps": stamps,
            "left": [min(r["left"] for r in rates), max(r["left"] for r in rates)],
            "right": [min(r["right"] for r in rates), max(r["right"] for r in rates)],
            "spread": spread,
            "stopped_after": (falls[0] - stopped) / 1e9 if falls else None,
            "still": max(abs(v) for one in still for v in one.velocity[:2]),
            "frames": frames,
            "fixed": [[t.header.frame_id, t.child_frame_id, t.transform.position.x] for t in fixed[0].transforms],
            "clocks": len(clocks),
        }
    )
)
