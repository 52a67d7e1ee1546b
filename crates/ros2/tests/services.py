"""Asks the node's services as rmw_cyclonedds does: each request begins with who asks and its number, and so does the answer.

    services.py DOMAIN

The node rests at its begin, and keeps its controllers.
"""

import sys
import time
from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import int32, int64, sequence, uint8, uint32, uint64

from ros2types import Header, Odometry, Peer, Pose, PoseWithCovariance, Quaternion, Time, Vector3, RELIABLE

STD = "std_srvs::srv::dds_::"


@dataclass
class Empty(IdlStruct, typename=STD + "Empty_Request_"):
    guid: uint64
    number: int64
    nothing: uint8 = 0


@dataclass
class EmptyAnswer(IdlStruct, typename=STD + "Empty_Response_"):
    guid: uint64
    number: int64
    nothing: uint8


@dataclass
class Trigger(IdlStruct, typename=STD + "Trigger_Request_"):
    guid: uint64
    number: int64
    nothing: uint8 = 0


@dataclass
class TriggerAnswer(IdlStruct, typename=STD + "Trigger_Response_"):
    guid: uint64
    number: int64
    success: bool
    message: str


@dataclass
class SetBool(IdlStruct, typename=STD + "SetBool_Request_"):
    guid: uint64
    number: int64
    data: bool


@dataclass
class SetBoolAnswer(IdlStruct, typename=STD + "SetBool_Response_"):
    guid: uint64
    number: int64
    success: bool
    message: str


@dataclass
class SetPose(IdlStruct, typename="robot_localization::srv::dds_::SetPose_Request_"):
    guid: uint64
    number: int64
    header: Header
    pose: PoseWithCovariance


@dataclass
class SetPoseAnswer(IdlStruct, typename="robot_localization::srv::dds_::SetPose_Response_"):
    guid: uint64
    number: int64
    nothing: uint8


SWITCH = "controller_manager_msgs::srv::dds_::SwitchController_"


@dataclass
class Switch(IdlStruct, typename=SWITCH + "Request_"):
    guid: uint64
    number: int64
    activate: sequence[str]
    deactivate: sequence[str]
    strictness: int32 = 2
    asap: bool = True
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class SwitchAnswer(IdlStruct, typename=SWITCH + "Response_"):
    guid: uint64
    number: int64
    ok: bool
    message: str


peer = Peer(int(sys.argv[1]))


class Client:
    """A client of a service; `what` are the fields of its requests."""

    def __init__(self, name, request, answer):
        self.kind, self.number = request, 0
        self.ask = peer.writer(name + "Request", request, RELIABLE, prefix="rq/")
        self.answers = peer.reader(name + "Reply", answer, RELIABLE, prefix="rr/")
        deadline = time.monotonic() + 30
        while not (self.ask.get_matched_subscriptions() and self.answers.get_matched_publications()):
            assert time.monotonic() < deadline, "no service " + name
            time.sleep(0.01)
        time.sleep(0.3)
        # What rmw_cyclonedds tells of itself: the second half of the identity of the writer.
        self.guid = 0x1122334455667788 + id(self)

    def __call__(self, **what):
        self.number += 1
        self.ask.write(self.kind(self.guid, self.number, **what))
        deadline = time.monotonic() + 20
        while True:
            assert time.monotonic() < deadline, "no answer to %r" % what
            answers = self.answers.take(N=10)
            if answers:
                assert [(one.guid, one.number) for one in answers] == [(self.guid, self.number)], answers
                time.sleep(0.05)
                assert not self.answers.take(N=10), "answered twice"
                return answers[0]
            time.sleep(0.001)


truth = peer.reader("/ground_truth", Odometry)
pause = Client("/appell/pause", SetBool, SetBoolAnswer)
step = Client("/appell/step", Trigger, TriggerAnswer)
reset = Client("/appell/reset", Empty, EmptyAnswer)
place = Client("/set_pose", SetPose, SetPoseAnswer)
switch = Client("/controller_manager/switch_controller", Switch, SwitchAnswer)


def look(seconds=0.3):
    """The last truth, after it has had time to come."""
    time.sleep(seconds)
    truths = truth.take(N=100000)
    return truths[-1] if truths else None


def until(holds, what):
    deadline = time.monotonic() + 20
    while not holds(look()):
        assert time.monotonic() < deadline, what


assert look() is None, "it does not rest"
assert step().success and step().success
last = look()
assert 0 <= last.header.stamp.ns() < 50_000_000, last.header
assert pause(data=False).success
refused = step()
assert not refused.success and "paused" in refused.message, refused
# Its own controller drives, and then nobody.
answer = switch(activate=["scenario"], deactivate=[])
assert answer.ok and answer.message == "", answer
until(lambda one: one.twist.twist.linear.x > 0.3, "the controller does not drive")
refused = switch(activate=["nobody"], deactivate=[])
assert not refused.ok and "nobody" in refused.message, refused
refused = switch(activate=["scenario", "external"], deactivate=[])
assert not refused.ok and "one" in refused.message, refused
assert switch(activate=[], deactivate=["scenario"]).ok
until(lambda one: abs(one.twist.twist.linear.x) < 1e-3, "it does not stop")
before = look().header.stamp.ns()
pose = Pose(Vector3(1.0, 3.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
place(header=Header(Time(0, 0), "world"), pose=PoseWithCovariance(pose, [0.0] * 36))
last = look()
at = last.pose.pose.position
assert abs(at.x - 1) < 1e-3 and abs(at.y - 3) < 1e-3 and last.header.stamp.ns() > before, last
assert pause(data=True).success
reset()
look()
assert step().success
assert look().header.stamp.ns() == 0
print("all asked")
