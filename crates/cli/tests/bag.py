"""Reads a bag by the package rosbags and holds every field of every message against the table of signals.

    bag.py BAG CSV ROBOT

The scenario is scenarios/noisy.toml: an odometry and an encoder with noise, beacons, flat ground.
"""

import csv
import math
import sys
from pathlib import Path

from rosbags.highlevel import AnyReader

BAG, CSV, ROBOT = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
WHEELS = {"left": (0.0, 0.08, 0.033), "right": (0.0, -0.08, 0.033), "ball": (-0.081, 0.0, 0.005)}
START = (0.5, 0.4, 0.0)
GRAVITY = 9.81

with open(CSV) as file:
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
times = {round(row["t"] * 1e9): row for row in rows}
before = {round(b["t"] * 1e9): a for a, b in zip(rows, rows[1:])}
checked = 0


def same(got, want, tolerance=0.0):
    global checked
    checked += 1
    assert abs(got - want) <= tolerance, (got, want, topic, time)


def vector(got, x, y, z, tolerance=0.0):
    same(got.x, x, tolerance), same(got.y, y, tolerance), same(got.z, z, tolerance)


def heading(q, yaw, pitch=0.0):
    """The turn about y by `pitch`, then about z by `yaw`."""
    sy, cy, sp, cp = math.sin(yaw / 2), math.cos(yaw / 2), math.sin(pitch / 2), math.cos(pitch / 2)
    for got, want in zip((q.x, q.y, q.z, q.w), (-sy * sp, cy * sp, sy * cp, cy * cp)):
        same(got, want, 1e-12)


def header(got, frame):
    same(got.stamp.sec * 10**9 + got.stamp.nanosec, time)
    assert got.frame_id == frame, (got.frame_id, frame)


def covariance(got, planar):
    """Of x, y, yaw among the six; what a plane leaves no choice is known."""
    known = 1e-12
    for i in range(6):
        for j in range(6):
            want = known if i == j else 0.0
            if i in planar and j in planar[i]:
                want = max(planar[i][j], known) if i == j else planar[i][j]
            same(got[6 * i + j], want, 1e-15 + 1e-9 * abs(want))


def signal(path):
    return row[f"robot.{ROBOT}.{path}"]


def clock(m):
    same(m.clock.sec * 10**9 + m.clock.nanosec, time)


def tf_static(m):
    (one,) = m.transforms
    header(one.header, "world")
    assert one.child_frame_id == "odom"
    vector(one.transform.translation, START[0], START[1], 0.0)
    heading(one.transform.rotation, START[2])


def tf(m):
    # The sensor gives a pose every 20 ms, rows are twice as often; the very last may lie between.
    has_odometry = m.transforms[0].child_frame_id == "base_link"
    if time % 20_000_000 == 0:
        assert has_odometry
    if has_odometry:
        first = m.transforms.pop(0)
        header(first.header, "odom")
        x, y = signal("sensor.odometry.x") - START[0], signal("sensor.odometry.y") - START[1]
        vector(first.transform.translation, x, y, 0.0, 1e-12)
        heading(first.transform.rotation, signal("sensor.odometry.yaw"))
    assert [one.child_frame_id for one in m.transforms] == list(WHEELS)
    for one, (name, (x, y, radius)) in zip(m.transforms, WHEELS.items()):
        header(one.header, "base_link")
        yaw = signal(f"wheel.{name}.steering_angle") if name == "ball" else 0.0
        trail = 0.010 if name == "ball" else 0.0
        place = (x - trail * math.cos(yaw), y - trail * math.sin(yaw), radius)
        vector(one.transform.translation, *place, 1e-12)
        heading(one.transform.rotation, yaw, signal(f"wheel.{name}.spin_angle"))


believed = []


def odom(m):
    header(m.header, "odom")
    assert m.child_frame_id == "base_link"
    x, y = signal("sensor.odometry.x") - START[0], signal("sensor.odometry.y") - START[1]
    vector(m.pose.pose.position, x, y, 0.0, 1e-12)
    yaw = signal("sensor.odometry.yaw")
    heading(m.pose.pose.orientation, yaw)
    twist = m.twist.twist
    same(twist.linear.z, 0.0), same(twist.angular.x, 0.0), same(twist.angular.y, 0.0)
    if believed:
        t, x0, y0, yaw0 = believed[-1]
        dt = time * 1e-9 - t
        turn = yaw - yaw0
        same(twist.angular.z, turn / dt, 1e-9)
        # The twist along an arc leads from one pose to the next.
        chord = math.hypot(x - x0, y - y0)
        arc = chord * (turn / 2 / math.sin(turn / 2) if abs(turn) > 1e-9 else 1.0)
        same(math.hypot(twist.linear.x, twist.linear.y), arc / dt, 1e-9)
        # Both wheels of 33 mm on a track of 0.16 m, each read twice.
        variance = 0.002**2 + (math.tau / 4096) ** 2 / 12
        forward = 2 * (0.033 / 2) ** 2 * 2 * variance / dt**2
        turning = 2 * (0.033 / 0.16) ** 2 * 2 * variance / dt**2
        planar = {0: {0: forward}, 1: {}, 5: {5: turning}}
        covariance(m.twist.covariance, planar)
        # Symmetric, and of the yaw what two readings leave: the first, and the last.
        p = m.pose.covariance.reshape(6, 6)
        first = (math.tau / 4096) ** 2 / 12
        same(p[5][5], 2 * (0.033 / 0.16) ** 2 * (first + variance), 1e-12)
        for i in range(6):
            for j in range(6):
                same(p[i][j], p[j][i], 1e-18)
                if i != j and not (i in (0, 1, 5) and j in (0, 1, 5)):
                    same(p[i][j], 0.0)
        same(p[2][2], 1e-12), same(p[3][3], 1e-12), same(p[4][4], 1e-12)
    believed.append((time * 1e-9, x, y, yaw))


def joint_states(m):
    header(m.header, "")
    assert m.name == ["left", "right", "ball", "ball_steering"]
    for k, name in enumerate(("left", "right")):
        same(m.position[k], signal(f"sensor.encoder.{name}"))
        same(m.velocity[k], signal(f"wheel.{name}.spin_rate"))
        same(m.effort[k], signal(f"wheel.{name}.torque"))
    same(m.position[2], signal("wheel.ball.spin_angle"))
    same(m.velocity[2], signal("wheel.ball.spin_rate"))
    same(m.position[3], signal("wheel.ball.steering_angle"))
    same(m.velocity[3], signal("wheel.ball.steering_rate"))
    same(m.effort[2], 0.0), same(m.effort[3], 0.0)


def imu(m):
    header(m.header, "base_link")
    heading(m.orientation, signal("pose.yaw"))
    rate = signal("twist.yaw_rate")
    vector(m.angular_velocity, 0.0, 0.0, rate)
    ahead = aside = 0.0
    if time in before:
        last = before[time]
        dt = row["t"] - last["t"]
        ahead = (signal("twist.forward") - last[f"robot.{ROBOT}.twist.forward"]) / dt
        aside = (signal("twist.left") - last[f"robot.{ROBOT}.twist.left"]) / dt
    ahead -= rate * signal("twist.left")
    aside += rate * signal("twist.forward")
    vector(m.linear_acceleration, ahead, aside, GRAVITY, 1e-9)
    for each in (m.orientation_covariance, m.angular_velocity_covariance, m.linear_acceleration_covariance):
        for k in range(9):
            same(each[k], 1e-12 if k % 4 == 0 else 0.0)


def ground_truth(m):
    header(m.header, "world")
    assert m.child_frame_id == "base_link"
    vector(m.pose.pose.position, signal("pose.x"), signal("pose.y"), 0.0)
    heading(m.pose.pose.orientation, signal("pose.yaw"))
    vector(m.twist.twist.linear, signal("twist.forward"), signal("twist.left"), 0.0)
    vector(m.twist.twist.angular, 0.0, 0.0, signal("twist.yaw_rate"))
    covariance(m.pose.covariance, {})
    covariance(m.twist.covariance, {})


def beacons(m):
    header(m.header, "base_link")
    seen = [name for name in ("dock", "lamp") if signal(f"sensor.beacon.{name}.visible") == 1.0]
    assert [one.id for one in m.detections] == seen
    for one in m.detections:
        header(one.header, "base_link")
        r, b = signal(f"sensor.beacon.{one.id}.range"), signal(f"sensor.beacon.{one.id}.bearing")
        (result,) = one.results
        assert result.hypothesis.class_id == "beacon"
        same(result.hypothesis.score, 1.0)
        for pose in (result.pose.pose, one.bbox.center):
            vector(pose.position, r * math.cos(b), r * math.sin(b), 0.0, 1e-12)
            heading(pose.orientation, 0.0)
        vector(one.bbox.size, 0.1, 0.1, 0.0)
        along, across, s, c = 0.01**2, (r * 0.01) ** 2, math.sin(b), math.cos(b)
        xx, yy, xy = c * c * along + s * s * across, s * s * along + c * c * across, s * c * (along - across)
        covariance(result.pose.covariance, {0: {0: xx, 1: xy}, 1: {0: xy, 1: yy}})


def twist(m):
    vector(m.linear, signal("command.forward"), signal("command.left"), 0.0)
    vector(m.angular, 0.0, 0.0, signal("command.yaw_rate"))


def stamped(m):
    header(m.header, "base_link")
    twist(m.twist)


TOPICS = {
    "/clock": ("rosgraph_msgs/msg/Clock", clock),
    "/tf": ("tf2_msgs/msg/TFMessage", tf),
    "/tf_static": ("tf2_msgs/msg/TFMessage", tf_static),
    "/odom": ("nav_msgs/msg/Odometry", odom),
    "/joint_states": ("sensor_msgs/msg/JointState", joint_states),
    "/imu": ("sensor_msgs/msg/Imu", imu),
    "/ground_truth": ("nav_msgs/msg/Odometry", ground_truth),
    "/beacons": ("vision_msgs/msg/Detection3DArray", beacons),
    "/cmd_vel": ("geometry_msgs/msg/Twist", twist),
    "/cmd_vel_stamped": ("geometry_msgs/msg/TwistStamped", stamped),
}

counts = dict.fromkeys(TOPICS, 0)
with AnyReader([BAG]) as reader:
    assert {c.topic: c.msgtype for c in reader.connections} == {k: v[0] for k, v in TOPICS.items()}
    announced = {c.topic: c.msgcount for c in reader.connections}
    profiles = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert profiles["/tf_static"].durability.name == "TRANSIENT_LOCAL"
    assert profiles["/imu"].reliability.name == "BEST_EFFORT"
    assert profiles["/odom"].reliability.name == "RELIABLE"
    for connection, time, raw in reader.messages():
        topic = connection.topic
        row = times[time]
        TOPICS[topic][1](reader.deserialize(raw, connection.msgtype))
        counts[topic] += 1

assert counts == announced, (counts, announced)
for topic in ("/clock", "/tf", "/joint_states", "/imu", "/ground_truth", "/cmd_vel", "/cmd_vel_stamped"):
    assert counts[topic] == len(rows), (topic, counts[topic], len(rows))
assert counts["/tf_static"] == 1
assert counts["/odom"] >= len(rows) // 2 and counts["/beacons"] >= len(rows) // 10
print(sum(counts.values()), "messages,", checked, "numbers")
