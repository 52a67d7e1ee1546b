"""Wrong in every way: garbage instead of messages, numbers that are none, and packets that are no RTPS.

    hostile.py DOMAIN SECONDS SEED

Ends with what the node still answers: the share of its odometries that came, while all this went on.
"""

import math
import random
import socket
import struct
import sys
import time
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import sequence, uint8

from ros2types import Clock, BEST, Odometry, Peer, Twist, twist

domain, seconds, seed = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
chance = random.Random(seed)


# By its name a twist, by its bytes none.
@dataclass
class Garbage(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    data: sequence[uint8]


honest, wrong = Peer(domain), Peer(domain)
clock = honest.reader("/clock", Clock, BEST)
odom = honest.reader("/odom", Odometry)
command = honest.writer("/cmd_vel", Twist)
garbage = wrong.writer("/cmd_vel", Garbage)
deadline = time.monotonic() + 60
while not (odom.get_matched_publications() and command.get_matched_subscriptions()):
    assert time.monotonic() < deadline, "nobody is there"
    time.sleep(0.01)
time.sleep(1)

base = 7400 + 250 * domain
ports = [base, base + 1] + [base + 10 + k for k in range(8)]
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
# A participant's own announcement, to be mutated: header, info_ts, data with parameters.
prefix = b"RTPS\x02\x03\x01\x10" + bytes(chance.randrange(256) for _ in range(12))


def submessage():
    kind = chance.choice([0x01, 0x02, 0x06, 0x07, 0x08, 0x09, 0x0C, 0x0D, 0x0E, 0x0F, 0x12, 0x13, 0x15, 0x16])
    kind = chance.choice([kind, chance.randrange(256)])
    length = chance.choice([0, 4, 20, 24, 28, 32, 100, 1000])
    body = bytearray(chance.randrange(256) for _ in range(length))
    if kind in (0x15, 0x16) and length >= 24:
        # To a reader that is there: extra flags, octets to inline qos, ids of the built-in endpoints.
        body[0:16] = struct.pack("<HHIII", 0, 16, 0xC7000100, 0xC2000100, 0) if chance.random() < 0.7 else body[0:16]
        body[20:24] = b"\x00\x03\x00\x00"
    told = length if chance.random() < 0.7 else chance.choice([0, 1, 65535, length + 3])
    return struct.pack("<BBH", kind, chance.randrange(256), told) + bytes(body)


sent = heard = 0
end = time.monotonic() + seconds
first = last = None
late = 0.0
last_heard = time.monotonic()
next_command = 0.0
while time.monotonic() < end:
    for _ in range(20):
        if chance.random() < 0.2:
            packet = bytes(chance.randrange(256) for _ in range(chance.randrange(200)))
        else:
            packet = prefix + b"".join(submessage() for _ in range(chance.randrange(1, 5)))
        try:
            out.sendto(packet, ("127.0.0.1", chance.choice(ports)))
        except ConnectionRefusedError:
            pass
        sent += 1
    if time.monotonic() > next_command:
        next_command = time.monotonic() + 0.02
        for wrong_value in (math.nan, math.inf, -math.inf):
            command.write(twist(wrong_value, 0.0))
            command.write(twist(0.2, wrong_value))
        garbage.write(Garbage([chance.randrange(256) for _ in range(chance.randrange(40))]))
        command.write(twist(0.2, 1.0))
    for one in odom.take(N=1000):
        heard += 1
        last = one
        first = first or one
        late = max(late, time.monotonic() - last_heard)
        last_heard = time.monotonic()
    time.sleep(0.001)
span = (last.header.stamp.ns() - first.header.stamp.ns()) / 1e9
speed = last.twist.twist.linear.x
print(sent, heard, span, late, speed)
assert span > 0.8 * seconds, "the node fell behind: %f of %f s" % (span, seconds)
assert late < 2.0, "silent for %f s" % late
assert time.monotonic() - last_heard < 1.0, "silent at the end"
assert abs(speed - 0.2) < 1e-9, "it no longer drives: %f" % speed
