"""One whole companion, attacked on all of its links: `Episode` feeds it, and checks what comes out."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Iterator, Sequence
from random import Random
from typing import Final

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import SIGNATURE_BYTES, source, whole
from companion.mavlink.peers.frame_mac import is_signed, seal, timestamp_of
from companion.records.node import open_records
from companion.sensors.table import sensors_of
from companion.survey.of_mission import survey_of
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from tests.fuzz.flights import TAPPED, Heard, mission_of
from tests.fuzz.mutations import change_datagram
from tests.fuzz.tape import Kind, Step, tick

SETPOINT: Final = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED.to_bytes(3, "little")
VELOCITY_AT: Final = 10 + 16  # in its frame: header, time, position
SPEED_MAX_MPS: Final = 30.0  # no vehicle of these missions is let fly a third of it
OUT_MAX_BYTES: Final = 8192  # of a tick, by a link


class Episode:
    """A companion from its start. `do` each step of a tape; AssertionError for what it must never send."""

    def __init__(self, mission_name: str) -> None:
        mission = mission_of(mission_name)
        records = open_records(mission, TAPPED, None, lambda: 7) if mission.survey is not None else None
        survey = survey_of(mission, TAPPED)
        keys = FleetKeys(mission) if mission_name == "signed" else None
        self.endpoint = Endpoint(
            mission,
            TAPPED,
            sensors=sensors_of(mission),
            survey=survey,
            records=records,
            guard=None if keys is None else keys.guard(TAPPED),
            orders=None if keys is None else keys.orders(TAPPED),
        )
        self.endpoint.agent.waive("all")
        self.now_s = 100.0
        self.slowest_s = 0.0  # CPU time of the slowest step
        self._read = {
            Kind.AUTOPILOT: self.endpoint.from_autopilot,
            Kind.PEERS: self.endpoint.from_peers,
            Kind.SENSOR: self.endpoint.from_sensor,
        }

    def do(self, step: Step) -> None:
        """One step."""
        if step.kind is Kind.TICK:
            self._tick(step.seconds)
            return
        began_s = time.thread_time()
        self._read[step.kind](step.data, self.now_s)
        self.slowest_s = max(self.slowest_s, time.thread_time() - began_s)

    def _tick(self, passed_s: float) -> None:
        self.now_s += passed_s
        out = self.endpoint.tick(self.now_s)
        assert self.endpoint.survey is None or not self.endpoint.survey.error, self.endpoint.survey.error
        assert len(out.autopilot) <= OUT_MAX_BYTES, f"{len(out.autopilot)} bytes to the autopilot in one tick"
        assert len(out.peers) <= OUT_MAX_BYTES, f"{len(out.peers)} bytes to the peers in one tick"
        at = out.autopilot.find(SETPOINT)
        if at >= 7 and out.autopilot[at - 7] == 0xFD:
            size = out.autopilot[at - 6]
            payload = out.autopilot[at + 3 : at + 3 + size].ljust(53, b"\0")
            velocity = struct.unpack_from("<3f", payload, 16)
            assert math.hypot(*velocity) <= SPEED_MAX_MPS, f"setpoint of {velocity} m/s"

    @property
    def signature(self) -> tuple[object, ...]:
        """Where the companion is: what a tape must reach to be worth keeping."""
        status, endpoint = self.endpoint.agent.status(self.now_s), self.endpoint
        return (status.state, bool(status.leader), bool(status.grounded), endpoint.codec.dropped > 0)


class Insider:
    """Seals forged frames as their senders would, with the keys of all vehicles: what is behind the MAC is reached."""

    def __init__(self) -> None:
        mission = mission_of("signed")
        keys = FleetKeys(mission)
        self._keys = {k: keys.guard(k)._own_key for k in range(1, mission.swarm.size + 1)}
        self._timestamps: dict[int, int] = {}  # the newest genuine one of each

    def note(self, data: bytes) -> None:
        """Genuine frames."""
        for start, end, _ in whole(data):
            if is_signed(data[start:end]):
                self._timestamps[data[start + 5]] = timestamp_of(data[start:end])

    def seal_all(self, rng: Random, data: bytes) -> bytes:
        """Each signed frame of a vehicle, signed again."""
        found = bytearray(data)
        for start, end, _ in whole(data):
            frame = data[start:end]
            key = self._keys.get(source(frame)[0])
            if is_signed(frame) and key is not None:
                timestamp = self._timestamps.get(frame[5], 0) + rng.randrange(-2, 50)
                found[start:end] = seal(frame[:-SIGNATURE_BYTES], key, 0, max(0, timestamp))
        return bytes(found)


def draw_tape(rng: Random, heard: Sequence[Heard], insider: Insider | None = None) -> Iterator[Step]:
    """A genuine flight with forged datagrams in between, of which each is near one that came then, or at another time.

    What comes by some links may be forged alone, so that the flight goes on; of others the genuine ones may be lost.
    """
    links = [Kind.AUTOPILOT, Kind.PEERS, Kind.SENSOR]
    attacked = rng.choice([links, links[1:], links[1:2], links[:1], links[2:]])
    lost = rng.choice((0.0, 0.0, 0.02, 0.5))
    per_tick = rng.choice((1, 8, 40))
    for now in heard:
        for kind, data in links_of(now):
            if insider is not None and kind is Kind.PEERS:
                insider.note(data)
            if data and rng.random() >= lost:
                yield Step(kind, data)
        for _ in range(per_tick):
            kind = rng.choice(attacked)
            then = now if rng.random() < 0.5 else rng.choice(heard)
            genuine, other = dict(links_of(then)), dict(links_of(rng.choice(heard)))
            forged = change_datagram(rng, part_of(rng, genuine[kind]), part_of(rng, other[kind]))
            if insider is not None and kind is Kind.PEERS and rng.random() < 0.5:
                forged = insider.seal_all(rng, forged)
            yield Step(kind, forged)
        yield tick() if rng.random() < 0.999 else tick(rng.choice((0.0, 0.3, 2.0, 40.0)))


def links_of(heard: Heard) -> tuple[tuple[Kind, bytes], ...]:
    return (Kind.PEERS, heard.peers), (Kind.SENSOR, heard.sensor), (Kind.AUTOPILOT, heard.autopilot)


def part_of(rng: Random, data: bytes) -> bytes:
    """Not more than a few frames: what a tick brings of a lidar takes long to read, and teaches nothing more."""
    if len(data) <= 600:
        return data
    at = data.find(b"\xfd", rng.randrange(len(data) - 500))
    return data[max(0, at) : max(0, at) + 500]
