"""A real `companion run` process between a hand-made autopilot and a hand-made neighbour, in the vehicle's time."""

from __future__ import annotations

import os
import random
import re
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from companion.core.agent import TICK_HZ, TICK_S
from companion.core.model.states import Request
from companion.mavlink import dialect
from companion.mavlink.endpoint import COMPONENT, Endpoint
from companion.mavlink.framing.frames import Framing, frames
from companion.mavlink.makes import px4
from companion.mavlink.makes.make import REQUESTS
from mission.document.load import parse_mission
from tests.programs.companion_kit import MISSION

LIMIT_S = 30.0  # of wall time, for one answer of a process on a busy machine
OWN, OTHER = 1, 2


class Autopilot:
    """Says what a companion needs to hear, obeys it, and moves by its setpoints without any inertia."""

    def __init__(self, vehicle_id: int) -> None:
        self.armed = False
        self.mode = px4.HOLD
        self.pos_ned_m = [0.0, 12.0 * vehicle_id, 0.0]
        self.vel_ned_mps = (0.0, 0.0, 0.0)
        self._id = vehicle_id
        self._mav = dialect.MAVLink(None, srcSystem=vehicle_id, srcComponent=1)
        self._ticks = 0
        self._acks: list[Any] = []

    def datagram(self) -> bytes:
        """One tick's telemetry; a TIMESYNC request ends it."""
        messages = [*self._acks]
        self._acks.clear()
        if self._ticks % TICK_HZ == 0:
            flags = dialect.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            messages += [
                dialect.MAVLink_heartbeat_message(2, 12, flags, self.mode, 4, 3),
                dialect.MAVLink_home_position_message(
                    470000000, 80000000, 400000, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0
                ),
                dialect.MAVLink_extended_sys_state_message(0, 2 if self.armed else 1),
            ]
        if self._ticks == TICK_HZ * 2:
            start = dialect.MAV_CMD_MISSION_START
            messages.append(dialect.MAVLink_command_long_message(self._id, COMPONENT, start, 0, *[0.0] * 7))
        ms = round(self._ticks * TICK_S * 1e3)
        messages += [
            dialect.MAVLink_sys_status_message(*[0xFFFFFFFF] * 3, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_local_position_ned_message(ms, *self.pos_ned_m, *self.vel_ned_mps),
            dialect.MAVLink_timesync_message(0, self.time_ns),
        ]
        self._ticks += 1
        return b"".join(_packed(self._mav, m) for m in messages)

    @property
    def time_ns(self) -> int:
        return round(self._ticks * TICK_S * 1e9)

    def obey(self, data: bytes) -> None:
        for m in Framing().parse(data):
            if m.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_LONG:
                match REQUESTS.get(m.command):
                    case Request.ARM:
                        self.armed = True
                    case Request.OFFBOARD:
                        self.mode = px4.OFFBOARD
                    case Request.TAKEOFF:
                        self.mode = px4.TAKEOFF
                self._acks.append(dialect.MAVLink_command_ack_message(m.command, 0, 0, 0, self._id, COMPONENT))
            elif m.get_msgId() == dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED and self.mode == px4.OFFBOARD:
                self.vel_ned_mps = (m.vx, m.vy, m.vz)
        if self.mode == px4.TAKEOFF:
            self.vel_ned_mps = (0.0, 0.0, -2.0)
            if self.pos_ned_m[2] <= -8.0:
                self.mode, self.vel_ned_mps = px4.HOLD, (0.0, 0.0, 0.0)
        self.pos_ned_m = [p + v * TICK_S for p, v in zip(self.pos_ned_m, self.vel_ned_mps, strict=True)]


def _packed(mav: Any, message: Any) -> bytes:
    packed: bytes = message.pack(mav)
    mav.seq = (mav.seq + 1) % 256
    return packed


@dataclass(frozen=True)
class Tick:
    """What one tick of a companion hears, and what it answers."""

    from_peers: bytes
    from_autopilot: bytes
    to_peers: bytes
    to_autopilot: bytes


def _flight(ticks: int) -> list[Tick]:
    """Two endpoints in this process fly; the ticks of the first of them."""
    mission = parse_mission(MISSION)
    vehicles = {k: (Endpoint(mission, k), Autopilot(k)) for k in (OWN, OTHER)}
    vehicles[OWN][0].agent.waive("all", unsigned=True)
    beacons = {OWN: b"", OTHER: b""}
    flown = []
    for _ in range(ticks):
        sent = {}
        for k, (endpoint, autopilot) in vehicles.items():
            from_peers = beacons[OTHER if k == OWN else OWN]
            now_s = autopilot.time_ns / 1e9
            data = autopilot.datagram()
            endpoint.from_peers(from_peers, now_s)
            endpoint.from_autopilot(data, now_s)
            out = endpoint.tick(now_s)
            autopilot.obey(out.autopilot)
            sent[k] = out.peers
            if k == OWN:
                flown.append(Tick(from_peers, data, out.peers, out.autopilot))
        beacons = sent
    return flown


class Process:
    """`companion run --clock vehicle` and the sockets it talks to."""

    def __init__(self, folder: Path, clock: str = "vehicle") -> None:
        mission = folder / "mission.toml"
        mission.write_text(MISSION)
        self.log = folder / "flight.log"
        self.autopilot, self.peers = _bound(), _bound()
        self.errors = (folder / "stderr").open("w+")
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "companion.cli", "run", "--mission", str(mission), "--id", str(OWN)),
                *("--autopilot", _url(self.autopilot), "--peers", _url(self.peers)),
                *("--clock", clock, "--log", str(self.log), "--waive", "all", "--unsigned"),
            ],
            stdin=subprocess.DEVNULL,
            stderr=self.errors,
        )
        try:
            self.hello, self._autopilot_address = self.autopilot.recvfrom(65536)
            if clock == "vehicle":
                self.peers_hello, self._peers_address = self.peers.recvfrom(65536)
        except TimeoutError:
            self.close()
            raise

    def say(self, from_peers: bytes, from_autopilot: bytes) -> None:
        if from_peers:
            self.peers.sendto(from_peers, self._peers_address)
        if from_autopilot:
            self.autopilot.sendto(from_autopilot, self._autopilot_address)

    def answer(self) -> tuple[bytes, bytes]:
        """(to the peers, to the autopilot) of one tick. Hellos that were under way are no answer."""
        while (data := self.autopilot.recv(65536)) == self.hello:
            pass
        to_peers = b""
        while select.select([self.peers], [], [], 0)[0]:  # it is sent before the autopilot's, so it is here
            heard = self.peers.recv(65536)
            to_peers += heard if heard != self.peers_hello else b""
        return to_peers, data

    def silent(self) -> bool:
        return not select.select([self.autopilot, self.peers], [], [], 0)[0]

    def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(number)
        return self.process.wait(LIMIT_S)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        for thing in (self.autopilot, self.peers, self.errors):
            thing.close()


def _bound() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(LIMIT_S)
    return sock


def _url(sock: socket.socket) -> str:
    return f"udpout://127.0.0.1:{sock.getsockname()[1]}"


@pytest.fixture
def process(tmp_path: Path) -> Iterator[Process]:
    process = Process(tmp_path)
    yield process
    process.close()


def _ids(data: bytes) -> list[int]:
    return [m.get_msgId() for m in Framing().parse(data)]


def _fly(process: Process, ticks: list[Tick]) -> None:
    for number, tick in enumerate(ticks):
        process.say(tick.from_peers, tick.from_autopilot)
        assert process.answer() == (tick.to_peers, tick.to_autopilot), f"tick {number}"


def test_it_says_hello_on_both_links_before_it_knows_the_time(process: Process) -> None:
    for hello in (process.hello, process.peers_hello):
        [m] = Framing().parse(hello)
        assert m.get_msgId() == dialect.MAVLINK_MSG_ID_HEARTBEAT
        assert (m.get_srcSystem(), m.get_srcComponent(), m.type) == (OWN, 191, 18)


def test_it_says_where_it_is_and_answers_every_request(process: Process) -> None:
    to_autopilot, to_peers = [], []
    for tick in _flight(4):
        process.say(tick.from_peers, tick.from_autopilot)
        beacon, answer = process.answer()
        to_peers += Framing().parse(beacon)
        messages = Framing().parse(answer)
        to_autopilot += messages
        asked_ns = Framing().parse(tick.from_autopilot)[-1].ts1
        assert messages[-1].get_msgId() == dialect.MAVLINK_MSG_ID_TIMESYNC
        assert messages[-1].ts1 == asked_ns
        assert messages[-1].tc1 != 0
    assert {m.get_srcSystem() for m in to_autopilot + to_peers} == {OWN}
    assert {m.get_srcComponent() for m in to_autopilot + to_peers} == {191}
    heartbeats = [m for m in to_autopilot if m.get_msgId() == dialect.MAVLINK_MSG_ID_HEARTBEAT]
    assert [m.type for m in heartbeats] == [18]
    asked = {_asked(m) for m in to_autopilot} - {0}
    assert asked <= {dialect.MAVLINK_MSG_ID_GPS_RAW_INT}, "positions flow: but for the fix, nothing is to be asked for"
    assert [m.get_msgId() for m in to_peers] == [dialect.MAVLINK_MSG_ID_SWARM_BEACON] * 2


def test_it_asks_for_what_its_autopilot_does_not_send(process: Process) -> None:
    only_request = dialect.MAVLink_timesync_message(0, 0).pack(dialect.MAVLink(None, OWN, 1))
    process.say(b"", only_request)
    to_peers, to_autopilot = process.answer()
    assert to_peers == b""  # its position is not known
    messages = Framing().parse(to_autopilot)
    assert {
        dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_HOME_POSITION,
    } <= {_asked(m) for m in messages}
    assert messages[-1].get_msgId() == dialect.MAVLINK_MSG_ID_TIMESYNC


def test_by_its_own_clock_it_needs_no_requests(tmp_path: Path) -> None:
    process = Process(tmp_path, clock="monotonic")
    try:
        assert dialect.MAVLINK_MSG_ID_HEARTBEAT in _ids(process.hello)
        process.say(b"", Autopilot(OWN).datagram())
        beacon, _ = process.peers.recvfrom(65536)
        assert _ids(beacon) == [dialect.MAVLINK_MSG_ID_SWARM_BEACON]
        assert process.end() == 0
    finally:
        process.close()
    assert "stopped by SIGTERM, nothing is commanded any more" in process.log.read_text()


def _asked(m: Any) -> int:
    """The message whose stream is asked for."""
    is_ask = m.get_msgId() == dialect.MAVLINK_MSG_ID_COMMAND_LONG
    return int(m.param1) if is_ask and m.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL else 0


def test_a_flight_equals_that_of_an_endpoint_in_this_process_byte_for_byte(process: Process) -> None:
    ticks = _flight(30 * TICK_HZ)
    setpoints = [t for t in ticks if dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED in _ids(t.to_autopilot)]
    assert len(setpoints) > 5 * TICK_HZ, "the reference does not fly"
    _fly(process, ticks)
    assert process.end() == 0
    log = process.log.read_text()
    assert re.search(r"\] companion [^']+, vehicle 1 of 2, mission 'test', autopilot udpout://", log)
    assert "state waiting -> ready" in log
    assert re.search(rf"stopped by SIGTERM.* ticks {len(ticks)}, missed 0", log)
    assert len(log.splitlines()) < 40


def test_garbage_on_both_links_changes_nothing_but_the_counters(process: Process) -> None:
    chance = random.Random(7)
    for number, tick in enumerate(_flight(12 * TICK_HZ)):
        process.say(chance.randbytes(300), chance.randbytes(300))
        process.say(_damaged(tick.from_peers), _damaged(tick.from_autopilot))
        process.say(b"\xfd", b"\xfd")
        process.say(tick.from_peers, tick.from_autopilot)
        assert process.answer() == (tick.to_peers, tick.to_autopilot), f"tick {number}"
    assert process.end(signal.SIGINT) == 0
    last = process.log.read_text().splitlines()[-1]
    counted = r"bad frames of the autopilot (\d+), datagrams of the peers without a beacon (\d+)"
    counts = re.search(f"stopped by SIGINT.* {counted}", last)
    assert counts is not None
    assert int(counts[1]) >= 12 * TICK_HZ
    assert int(counts[2]) >= 5 * TICK_HZ


def _damaged(frames_: bytes) -> bytes:
    """Every frame with a wrong checksum."""
    data = bytearray(frames_)
    for _, end, _ in frames(frames_):
        data[end - 1] ^= 0xFF
    return bytes(data)


def test_a_process_that_hangs_sends_nothing(process: Process) -> None:
    first, second, *_ = _flight(2)
    _fly(process, [first])
    pid = process.process.pid
    os.kill(pid, signal.SIGSTOP)
    _wait_until(lambda: _state(pid) == "T")
    process.say(second.from_peers, second.from_autopilot)
    assert process.silent()
    os.kill(pid, signal.SIGCONT)
    assert process.answer() == (second.to_peers, second.to_autopilot)


def test_a_wrong_id_is_named_in_the_log(process: Process) -> None:
    stranger = Autopilot(OTHER)
    tick = _flight(1)[0]
    process.say(b"", stranger.datagram())
    _fly(process, [tick])
    process.end()
    assert "the autopilot of vehicle 2 is on this link of vehicle 1: wrong --id?" in process.log.read_text()


def _wait_until(condition: Callable[[], bool]) -> None:
    """Busy, for something that the kernel does within microseconds."""
    for _ in range(10_000_000):
        if condition():
            return
    raise AssertionError("never")


def _state(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


def test_memory_stays_within_the_budget(process: Process) -> None:
    _fly(process, _flight(2 * TICK_HZ))
    status = Path(f"/proc/{process.process.pid}/status").read_text()
    resident = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert resident is not None
    assert int(resident[1]) / 1024 < 70.0
