"""A served world on free ports, and programs that speak to it."""

from __future__ import annotations

import socket
from typing import Any

from companion.mavlink import dialect as mav
from sim_bridge.drive.serve.server import Server

MISSION = """
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [60.0, 0.0, 8.0]
vel_leader_mps = 2.0
[swarm]
size = 3
"""
HERE, THERE = ("127.0.0.1", 40001), ("127.0.0.1", 40002)
READY_S = 5.0  # simulated: the autopilots' heartbeats have begun, and arming is allowed
GCS, COMPANION = 190, mav.MAV_COMP_ID_ONBOARD_COMPUTER


def frame(message: Any, system: int, component: int = COMPANION) -> bytes:
    packed: bytes = message.pack(mav.MAVLink(None, srcSystem=system, srcComponent=component))
    return packed


def heartbeat(system: int, component: int = COMPANION) -> bytes:
    return frame(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), system, component)


def beacon(system: int, time_ms: int = 0) -> bytes:
    message = mav.MAVLink_swarm_beacon_message
    said = {"time_boot_ms": time_ms, "governor": 1.0, "range_dm": 300, "version": 1, "members": bytes(96)}
    return frame(message(**dict.fromkeys(message.fieldnames, 0) | said), system)


def ignore(_text: str) -> None:
    pass


class Peer:
    """A client's socket; on loopback a datagram has arrived when `sendto` returns."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.setblocking(False)
        self._to = ("127.0.0.1", port)

    def send(self, data: bytes) -> None:
        self.socket.sendto(data, self._to)

    def datagrams(self) -> list[bytes]:
        arrived = []
        while True:
            try:
                arrived.append(self.socket.recv(65536))
            except BlockingIOError:
                return arrived

    def messages(self) -> list[Any]:
        codec = mav.MAVLink(None)
        return [m for data in self.datagrams() for m in codec.parse_buffer(bytearray(data)) or []]

    def systems(self) -> set[int]:
        return {m.get_srcSystem() for m in self.messages()}


def turn(served: Server, steps: int = 1, now_s: float = 0.0) -> None:
    for _ in range(steps):
        served.poll(0.0, lambda: now_s)
        served.step(now_s)
