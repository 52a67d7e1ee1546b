"""Commands of other kinds, each over DDS; prints what the robot does then.

    wire.py DOMAIN joints                 joint_command, and one that names no wheel of the robot
    wire.py DOMAIN mecanum NAMESPACE      a twist to the left, ahead and about, below a namespace
    wire.py DOMAIN hear [SECONDS]         whether odometry comes, within so long
"""

import json
import sys
import time

from ros2types import Header, JointState, Odometry, Peer, Time, Twist, Vector3

peer, what = Peer(int(sys.argv[1])), sys.argv[2]
space = sys.argv[3] if what == "mecanum" else ""
odom = peer.reader(space + "/odom", Odometry)
truth = peer.reader(space + "/ground_truth", Odometry)
states = peer.reader(space + "/joint_states", JointState)


def last(reader, seconds=20.0):
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        heard = reader.take(N=10000)
        if heard:
            return heard[-1]
        time.sleep(0.005)


def drive(command, messages, seconds):
    deadline = time.monotonic() + 30
    while not command.get_matched_subscriptions():
        assert time.monotonic() < deadline, "nobody listens"
        time.sleep(0.01)
    time.sleep(0.5)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for message in messages:
            command.write(message)
        time.sleep(1 / 15)


if what == "hear":
    heard = last(odom, float(sys.argv[3]) if len(sys.argv) > 3 else 20.0)
    print(json.dumps(heard is not None))
    sys.exit()
header = Header(Time(0, 0), "")
if what == "joints":
    command = peer.writer("/joint_command", JointState)
    right = JointState(header, ["right", "left"], [], [7.5, 2.5], [])
    wrong = [JointState(header, ["rear"], [], [1.0], []), JointState(header, ["left"], [], [float("nan")], []),
             JointState(header, ["left", "right"], [], [1.0], [])]
    drive(command, [right] + wrong, 2.0)
else:
    command = peer.writer(space + "/cmd_vel", Twist)
    drive(command, [Twist(Vector3(0.1, 0.2, 0.0), Vector3(0.0, 0.0, 0.3))], 2.0)
twist = lambda one: [one.twist.twist.linear.x, one.twist.twist.linear.y, one.twist.twist.angular.z]
told = {"truth": twist(last(truth)), "odom": twist(last(odom))}
state = last(states)
told["rates"] = dict(zip(state.name, state.velocity))
time.sleep(1.5)
told["after"] = twist(last(truth))
print(json.dumps(told))
