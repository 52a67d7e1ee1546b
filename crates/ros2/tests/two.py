"""Two robots below their names, one of them commanded by twists with a stamp; prints where both believe to be.

    two.py DOMAIN
"""

import json
import sys
import time

from ros2types import Header, Odometry, Peer, Time, TwistStamped, twist

peer = Peer(int(sys.argv[1]))
odometries = {name: peer.reader("/%s/odom" % name, Odometry) for name in ("p3dx", "tri")}
command = peer.writer("/tri/cmd_vel", TwistStamped)
last = {}
deadline = time.monotonic() + 60
while len(last) < 2 or last["tri"].pose.pose.position.x < 0.3:
    assert time.monotonic() < deadline, last
    for name, reader in odometries.items():
        for one in reader.take(N=100):
            last[name] = one
    # A stamp of zero is none.
    command.write(TwistStamped(Header(Time(0, 0), ""), twist(0.2, 0.0)))
    time.sleep(0.02)
print(json.dumps({name: [one.header.frame_id, one.child_frame_id, one.pose.pose.position.x,
                         one.pose.pose.position.y, one.twist.twist.linear.x] for name, one in last.items()}))
