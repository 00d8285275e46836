"""Gaps between setpoints of one companion while others want the processor, as the kernel stamps their arrival."""

from __future__ import annotations

import select
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.mavlink import dialect
from mission.common.frames import Vec3
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.drive.children import end
from sim_bridge.drive.links.ports import bound_socket
from sim_bridge.drive.lockstep.processes import start_companion
from sim_bridge.drive.operator import operator_order
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World

STEP_S = 0.01
LAG_MAX_S = 0.25  # of the world behind the wall clock; what is more is given up
DATAGRAM_BYTES = 4096
TIMESTAMPNS = 35  # SO_TIMESTAMPNS of Linux: each datagram comes with the time at which the kernel took it
STAMP = struct.Struct("@ll")  # seconds, nanoseconds
SETPOINT_ID = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED.to_bytes(3, "little")
READY_LIMIT_S = 120.0
HOG = "while True: pass"


def mission(minutes: float) -> Mission:
    """One vehicle, which is steered for as long as it takes."""
    return Mission.model_validate(
        {
            "schema": 1,
            "name": "setpoint gaps",
            "route": {"d1_enu_m": (0, 0, 5), "d2_enu_m": (30, 0, 5), "vel_leader_mps": 2.0},
            "coverage": {"duration_s": 60.0 * minutes + 600.0},
            "swarm": {"size": 1},
        }
    ).with_origin(DEFAULT_ORIGIN)


def gaps_ms(minutes: float, *, hogs: int, folder: Path) -> NDArray[np.float64]:
    """(N,) milliseconds between setpoints that follow each other, over `minutes` from the first one on.

    The autopilot, a simulated one, runs in this process, which competes for the processor as well: only the kernel's
    stamps are free of that. RuntimeError when no setpoints come.
    """
    with ExitStack() as stack:
        bound = stack.enter_context(bound_socket("autopilot", 0))
        bound.setsockopt(socket.SOL_SOCKET, TIMESTAMPNS, 1)
        radio = stack.enter_context(bound_socket("radio", 0))  # nobody is there
        stamps_ns = _fly(bound, radio, mission(minutes), minutes, hogs, folder, stack)
    return np.diff(np.array(stamps_ns, dtype=np.int64)) / 1e6


def _fly(
    bound: socket.socket,
    radio: socket.socket,
    flown: Mission,
    minutes: float,
    hogs: int,
    folder: Path,
    stack: ExitStack,
) -> list[int]:
    file = folder / "mission.toml"
    file.write_text(dump_mission(flown))
    world = World(flown, point_mass, links={Link.ONBOARD: StreamProfile.MINIMAL, Link.GROUND: StreamProfile.MINIMAL})
    autopilot = world.vehicles[1].autopilot
    companion = start_companion(
        1,
        file,
        folder / "companion.log",
        autopilot_port=bound.getsockname()[1],
        radio_port=radio.getsockname()[1],
        clock="monotonic",
    )
    stack.callback(end, [companion])
    stamps_ns: list[int] = []
    address = None
    began_s = due_s = time.monotonic()
    order_s = 0.0
    until_s = began_s + READY_LIMIT_S
    while (now_s := time.monotonic()) < until_s:
        select.select([bound], (), (), max(0.0, due_s - now_s))
        for data, stamp_ns, sender in received(bound):
            address = sender
            if SETPOINT_ID in data:
                if not stamps_ns:
                    until_s = time.monotonic() + 60.0 * minutes
                    stack.enter_context(busy(hogs))
                stamps_ns.append(stamp_ns)
            autopilot.receive(Link.ONBOARD, data, world.now_s)
        if time.monotonic() < due_s:
            continue
        due_s = max(due_s + STEP_S, time.monotonic() - LAG_MAX_S)
        if not stamps_ns and world.now_s - order_s > 1.0:
            order_s = world.now_s
            autopilot.receive(Link.GROUND, operator_order(1, dialect.MAV_CMD_MISSION_START), world.now_s)
        world.step(STEP_S)
        for datagram in autopilot.transmit(Link.ONBOARD, world.now_s):
            if address is not None:
                bound.sendto(datagram, address)
    if not stamps_ns:
        raise RuntimeError(f"no setpoint within {READY_LIMIT_S:g} s: see {folder}/companion.log")
    return stamps_ns


def received(bound: socket.socket) -> Iterator[tuple[bytes, int, tuple[str, int]]]:
    """Datagram, the kernel's stamp in nanoseconds, sender."""
    while True:
        try:
            data, ancillary, _, sender = bound.recvmsg(DATAGRAM_BYTES, socket.CMSG_SPACE(STAMP.size))
        except BlockingIOError:
            return
        for level, kind, value in ancillary:
            if (level, kind) == (socket.SOL_SOCKET, TIMESTAMPNS):
                seconds, nanoseconds = STAMP.unpack(value[: STAMP.size])
                yield data, seconds * 1_000_000_000 + nanoseconds, sender


@contextmanager
def busy(hogs: int) -> Iterator[None]:
    """So many processes that do nothing but want the processor."""
    children = [subprocess.Popen([sys.executable, "-c", HOG]) for _ in range(hogs)]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def point_mass(_frame: object, pos_ned_m: Vec3, _seed: int) -> PointMass:
    """Cheap: what is measured is the companion."""
    return PointMass(pos_ned_m, 0.0)
