"""How long a command takes to the wheels, and how evenly /clock comes; beside the same from a peer in Python.

    latency.py DOMAIN SECONDS          against `appell ros … --rate 1000 --publish-rate 1000`
    latency.py DOMAIN SECONDS --peer   against a process of its own that answers in the same way

Prints milliseconds: percentiles of the time from a command to the joint state that shows it, and of the time between
two messages of /clock.
"""

import subprocess
import sys
import time

from ros2types import BEST, Clock, Header, JointState, Peer, Time, Twist, twist


def answer(domain, seconds):
    """The peer: a clock and joint states at 1 kHz, with the last command as rates."""
    peer = Peer(domain)
    command = peer.reader("/cmd_vel", Twist)
    clock = peer.writer("/clock", Clock, BEST)
    joints = peer.writer("/joint_states", JointState)
    rates, due = [0.0, 0.0], time.perf_counter()
    end = due + seconds
    ns = 0
    while due < end:
        for one in command.take(N=100):
            v, w = one.linear.x, one.angular.z
            rates = [(v - 0.1 * w) / 0.04, (v + 0.1 * w) / 0.04]
        stamp = Time(ns // 10**9, ns % 10**9)
        clock.write(Clock(stamp))
        joints.write(JointState(Header(stamp, ""), ["left", "right"], [0.0, 0.0], rates, []))
        ns += 1_000_000
        due += 0.001
        time.sleep(max(0.0, due - time.perf_counter()))


def percentiles(times):
    times = sorted(1e3 * t for t in times)
    return " ".join("%s %.3f" % (name, times[int(share * (len(times) - 1))])
                    for name, share in (("median", 0.5), ("99 %", 0.99), ("most", 1.0)))


domain, seconds = int(sys.argv[1]), float(sys.argv[2])
if "--answer" in sys.argv:
    answer(domain, seconds + 5)
    sys.exit()
other = None
if "--peer" in sys.argv:
    other = subprocess.Popen([sys.executable, __file__, str(domain), str(seconds), "--answer"])
peer = Peer(domain)
clock = peer.reader("/clock", Clock, BEST)
joints = peer.reader("/joint_states", JointState, BEST)
command = peer.writer("/cmd_vel", Twist)
while not (joints.get_matched_publications() and command.get_matched_subscriptions()):
    time.sleep(0.01)
time.sleep(1)
clock.take(N=10000), joints.take(N=10000)
ticks, delays = [], []
sent, wanted, k = None, None, 0
begun = time.perf_counter()
while time.perf_counter() - begun < seconds:
    now = time.perf_counter()
    if sent is None and k * 0.02 < now - begun:
        k += 1
        wanted = 0.1 + 0.001 * (k % 50)
        sent = time.perf_counter()
        command.write(twist(wanted, 0.0))
    ticks += [time.perf_counter() for _ in clock.take(N=100)]
    for one in joints.take(N=100):
        if sent is not None and abs(one.velocity[0] - wanted / 0.04) < 1e-9:
            delays.append(time.perf_counter() - sent)
            sent = None
print("command to wheels:", percentiles(delays), "of", len(delays))
print("between clocks:   ", percentiles([b - a for a, b in zip(ticks, ticks[1:])]), "of", len(ticks))
if other:
    other.terminate()
