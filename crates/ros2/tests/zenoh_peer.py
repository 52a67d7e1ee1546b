"""The blog's command by Zenoh, as a node on rmw_zenoh gives it.

    zenoh_peer.py ENDPOINT SECONDS

Keys are a domain, a name, a type and its hash; beside each message stand its number, its time and whose it is.
"""

import json
import struct
import sys
import threading
import time

import zenoh
import zenoh.ext
from rosbags.typesys import Stores, get_typestore

endpoint, seconds = sys.argv[1], float(sys.argv[2])
store = get_typestore(Stores.ROS2_JAZZY)
config = zenoh.Config()
for key, value in {"mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False,
                   "timestamping/enabled": True}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)


def key(name, kind, space="fleet/"):
    # The hash by which ROS 2 tells this type, as another implementation computes it.
    return "7/%s%s/%s_/%s" % (space, name, kind.replace("/msg/", "::msg::dds_::"), store_hash(kind))


def store_hash(kind):
    return store.hash_rihs01(kind)


lock, heard, numbers = threading.Lock(), {}, {}


def hear(name, kind, space="fleet/", declare=session.declare_subscriber, **more):
    def take(sample):
        beside = bytes(sample.attachment)
        number, _, length = struct.unpack_from("<qqB", beside)
        assert length == 16 and len(beside) == 33, beside
        message = store.deserialize_cdr(bytes(sample.payload), kind)
        with lock:
            heard.setdefault(name, []).append(message)
            numbers.setdefault(name, []).append((beside[17:], number))

    return declare(key(name, kind, space), take, **more)


ODOMETRY, JOINTS, TF = "nav_msgs/msg/Odometry", "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
listeners = [hear("odom", ODOMETRY), hear("joint_states", JOINTS), hear("tf", TF, "")]
deadline = time.monotonic() + 60


def until(holds):
    while True:
        with lock:
            if holds():
                return
        assert time.monotonic() < deadline, {name: len(messages) for name, messages in heard.items()}
        time.sleep(0.01)


until(lambda: all(name in heard for name in ("odom", "joint_states", "tf")))
# One who comes late hears what is kept.
listeners.append(hear("tf_static", TF, "", lambda ke, take, **more: zenoh.ext.declare_advanced_subscriber(
    session, ke, take, **more), history=zenoh.ext.HistoryConfig(detect_late_publishers=True)))
until(lambda: "tf_static" in heard)
tokens = [str(reply.ok.key_expr) for reply in session.liveliness().get("@ros2_lv/7/**") if reply.ok]
parts = [token.split("/") for token in tokens]
assert any(p[5:] == ["NN", "%", "%fleet", "appell"] for p in parts), tokens
assert any(p[5] == "MP" and p[9] == "%fleet%odom" and p[11] == store_hash(ODOMETRY) and p[12] == "::,10:,:,:,," for p in parts)
assert any(p[5] == "MS" and p[9] == "%fleet%cmd_vel" and p[10] == "geometry_msgs::msg::dds_::Twist_" for p in parts)

TWIST = "geometry_msgs/msg/Twist"
Twist, Vector3 = store.types[TWIST], store.types["geometry_msgs/msg/Vector3"]
command = session.declare_publisher(key("cmd_vel", TWIST))


def send(forward, turn):
    message = Twist(Vector3(forward, 0.0, 0.0), Vector3(0.0, 0.0, turn))
    command.put(bytes(store.serialize_cdr(message, TWIST)), attachment=bytes(33))


with lock:
    begun = heard["odom"][-1].header.stamp.sec + 1
end = time.monotonic() + seconds + 1.2
deadline = end + 60
while time.monotonic() < end:
    send(0.2, 1.0)
    command.put(b"\x00\x01\x00\x00garbage")
    send(float("nan"), 0.0)
    time.sleep(1 / 15)
with lock:
    state = heard["joint_states"][-1]
time.sleep(1.5)
listeners.clear()
ns = lambda stamp: stamp.sec * 10**9 + stamp.nanosec
stamps = [ns(one.header.stamp) for one in heard["odom"] if one.header.stamp.sec >= begun]
for name, all_of in numbers.items():
    assert len({gid for gid, _ in all_of}) == 1, name
    counted = [number for _, number in all_of]
    assert counted == list(range(counted[0], counted[0] + len(counted))), "a message of %s was lost" % name
fixed = heard["tf_static"][0].transforms[0]
print(json.dumps({
    "stamps": stamps,
    "rates": list(state.velocity[:2]),
    "after": list(heard["joint_states"][-1].velocity[:2]),
    "fixed": [fixed.header.frame_id, fixed.child_frame_id, fixed.transform.translation.x],
    "frames": {t.child_frame_id: t.header.frame_id for t in heard["tf"][-1].transforms},
}))
session.close()
