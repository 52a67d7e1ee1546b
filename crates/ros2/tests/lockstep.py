"""A controller in lock-step: a command for each odometry that it has heard. Prints a digest of all it heard.

    lockstep.py DOMAIN TICKS
"""

import hashlib
import struct
import sys
import time

from ros2types import Odometry, Peer, Twist, twist

domain, ticks = int(sys.argv[1]), int(sys.argv[2])
peer = Peer(domain)
odom = peer.reader("/odom", Odometry)
command = peer.writer("/cmd_vel", Twist)
digest = hashlib.sha256()
heard = answered = 0
deadline = time.monotonic() + 120
while heard < ticks:
    assert time.monotonic() < deadline, "heard %d of %d" % (heard, ticks)
    for one in odom.take(N=100):
        p, t = one.pose.pose, one.twist.twist
        digest.update(struct.pack("<Q6d", one.header.stamp.ns(), p.position.x, p.position.y,
                                  p.orientation.z, p.orientation.w, t.linear.x, t.angular.z))
        heard += 1
        # Toward the line y = 0.3, by what it has heard.
        command.write(twist(0.2, 2.0 * (0.3 - p.position.y) - 2.0 * p.orientation.z))
    time.sleep(0.0002)
print(heard, digest.hexdigest(), p.position.x, p.position.y)
