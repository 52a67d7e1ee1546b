"""A viewer of its own: looks at the node by the published protocol, and reads messages by the definitions that it is told.

    foxglove.py ADDRESS PROTOCOL DOMAIN

First it misbehaves, then it drives the robot by DDS and looks. Prints what came as JSON.
"""

import asyncio
import json
import os
import random
import struct
import sys
import threading
import time

import websockets
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros2types import Peer, Twist, twist

address, protocol, domain = sys.argv[1], sys.argv[2], int(sys.argv[3])
chance = random.Random(1)


def connect(protocols):
    return websockets.connect(address, subprotocols=protocols, open_timeout=20, ping_interval=None)


async def misbehave():
    """What no viewer should send: none of it is answered by more than a complaint or a closed door."""
    host, port = address.removeprefix("ws://").rsplit(":", 1)
    for garbage in (b"", b"GET / HTTP/1.1\r\n\r\n", b"\x00" * 100, bytes(chance.randrange(256) for _ in range(5000))):
        _, writer = await asyncio.open_connection(host, int(port))
        writer.write(garbage)
        await writer.drain()
        writer.close()
    try:
        async with connect(["something.else"]):
            sys.exit("spoke with one of another protocol")
    except websockets.InvalidStatus as refused:
        assert refused.response.status_code == 400, refused
    wrong = ["", "{", "[]", "null", '{"op": 3}', '{"op": "advertise", "channels": []}', '{"op": "subscribe"}',
             '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 0}]}',
             '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99999}]}',
             '{"op": "unsubscribe", "subscriptionIds": [7]}', "[" * 60000]
    told = 0
    for text in wrong:
        async with connect([protocol]) as socket:
            await socket.send(text)
            await socket.send(bytes(chance.randrange(256) for _ in range(chance.randrange(100))))
            async for message in socket:
                told += isinstance(message, str) and json.loads(message)["op"] == "status"
                if isinstance(message, bytes):
                    break
    assert told == len(wrong) - 1, told
    # Too long, and with bits that no frame has.
    for frame in (b"\x81\xff" + struct.pack(">Q", 1 << 40) + os.urandom(4), b"\xff" * 64, b"\x01\x80\x00\x00\x00\x00" * 9):
        async with connect([protocol]) as socket:
            socket.transport.write(frame)
            try:
                async for _ in socket:
                    pass
            except websockets.ConnectionClosed:
                pass


def driven(odometries):
    return sum(one.twist.twist.linear.x > 0 for _, one in odometries) > 50


async def look():
    async with connect([protocol]) as socket:
        assert socket.subprotocol == protocol, socket.subprotocol
        server = json.loads(await socket.recv())
        channels = json.loads(await socket.recv())["channels"]
        assert server["op"] == "serverInfo" and "time" in server["capabilities"], server
        store = get_typestore(Stores.EMPTY)
        for channel in channels:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg"), channel
            store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
        topics = {channel["topic"]: channel for channel in channels}
        wanted = {10 + k: topic for k, topic in enumerate(("/odom", "/tf", "/tf_static", "/clock", "/joint_states"))}
        await socket.send(json.dumps({"op": "subscribe", "subscriptions": [
            {"id": id, "channelId": topics[topic]["id"]} for id, topic in wanted.items()]}))
        heard = {topic: [] for topic in wanted.values()}
        times = []
        while min(len(heard["/clock"]), len(times)) < 50 or not driven(heard["/odom"]):
            frame = await asyncio.wait_for(socket.recv(), 20)
            if frame[0] == 2:
                times.append(struct.unpack("<Q", frame[1:])[0])
                continue
            kind, id, stamp = struct.unpack_from("<BIQ", frame)
            assert kind == 1, frame
            topic = wanted[id]
            heard[topic].append((stamp, store.deserialize_cdr(frame[13:], topics[topic]["schemaName"])))
        # What is no longer wanted comes no more.
        await socket.send(json.dumps({"op": "unsubscribe", "subscriptionIds": list(wanted)}))
        await asyncio.sleep(0.3)
        while True:
            frame = await asyncio.wait_for(socket.recv(), 20)
            if frame[0] == 2 and struct.unpack("<Q", frame[1:])[0] > times[-1] + 1_000_000_000:
                break
            late = frame[0] == 1 and struct.unpack_from("<Q", frame, 5)[0] > times[-1] + 600_000_000
            assert not late, "a message after all"
        return topics, heard, times


def drive():
    command = Peer(domain).writer("/cmd_vel", Twist)
    while True:
        command.write(twist(0.2, 1.0))
        time.sleep(1 / 15)


asyncio.run(misbehave())
threading.Thread(target=drive, daemon=True).start()
topics, heard, times = asyncio.run(look())
ns = lambda stamp: stamp.sec * 10**9 + stamp.nanosec
assert all(time == ns(one.header.stamp) for time, one in heard["/odom"] + heard["/joint_states"])
assert all(time == ns(one.clock) for time, one in heard["/clock"])
assert times == sorted(times)
odom = heard["/odom"][-1][1]
print(json.dumps({
    "topics": {name: channel["schemaName"] for name, channel in topics.items()},
    "odom": {
        "stamps": [time for time, _ in heard["/odom"]],
        "frames": [odom.header.frame_id, odom.child_frame_id],
        "twist": [odom.twist.twist.linear.x, odom.twist.twist.linear.y, odom.twist.twist.angular.z],
        "variance": odom.pose.covariance[0],
    },
    "tf": [[t.header.frame_id, t.child_frame_id, t.transform.translation.z] for t in heard["/tf"][-1][1].transforms],
    "fixed": [[t.header.frame_id, t.child_frame_id, t.transform.translation.x] for t in heard["/tf_static"][0][1].transforms],
    "rates": [list(one.velocity[:2]) for _, one in heard["/joint_states"]][-1],
}))
