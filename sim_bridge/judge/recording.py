"""Ground truth of one flight, sampled once a tick: what every figure about a flight is computed from."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mission.frames import Vec3
from sim_bridge.world.radio import Radio

if TYPE_CHECKING:
    from sim_bridge.drive.lockstep import Lockstep


@dataclass(frozen=True, slots=True)
class Recording:
    """Arrays over T ticks and n vehicles (vehicle id k in column k-1). NED metres about the mission's origin."""

    time_s: NDArray[np.float64]  # (T,) simulated
    pos_ned_m: NDArray[np.float64]  # (T, n, 3)
    vel_ned_mps: NDArray[np.float64]  # (T, n, 3)
    on_ground: NDArray[np.bool_]  # (T, n)
    armed: NDArray[np.bool_]  # (T, n)
    agent_alive: NDArray[np.bool_]  # (T, n) its companion answered in this tick
    range_m: NDArray[np.float64]  # (T, n) radio range in use
    phase: NDArray[np.int8]  # (T, n) SwarmPhase that its last beacon announced; -1 before the first
    acting: NDArray[np.bool_]  # (T, n) its last beacon claims an established lead, and its companion has answered since
    leader: NDArray[np.int16]  # (T, n) whom its last beacon follows; 0: none


@dataclass(frozen=True, slots=True)
class VehicleSample:
    """One vehicle at one time. NED about the mission's origin."""

    pos_ned_m: Vec3
    vel_ned_mps: Vec3
    on_ground: bool
    armed: bool
    agent_alive: bool


class Recorder:
    """Samples a flight; `trace` is a running SHA-256 of what happened in lockstep."""

    def __init__(self) -> None:
        self.trace = hashlib.sha256()
        self._rows: list[tuple[Any, ...]] = []
        self._silent_s: dict[int, float] = {}  # when each companion did not answer last

    def add(self, now_s: float, vehicles: Mapping[int, VehicleSample], radio: Radio) -> None:
        """One row: every vehicle 1..n, and what its last beacon said."""
        samples = vehicles.values()
        heard = [radio.heard.get(k) for k in vehicles]
        self._silent_s.update((k, now_s) for k, sample in vehicles.items() if not sample.agent_alive)
        self._rows.append(
            (
                now_s,
                [s.pos_ned_m for s in samples],
                [s.vel_ned_mps for s in samples],
                [s.on_ground for s in samples],
                [s.armed for s in samples],
                [s.agent_alive for s in samples],
                [radio.range_m(k) for k in vehicles],
                [-1 if h is None else h.phase for h in heard],
                [self._acts(k, radio) for k in vehicles],
                [0 if h is None else h.leader for h in heard],
            )
        )

    def _acts(self, vehicle_id: int, radio: Radio) -> bool:
        """Its last beacon claims an established lead. What one said before its companion stood still is no claim."""
        heard = radio.heard.get(vehicle_id)
        if heard is None or heard.acting_leader != vehicle_id:
            return False
        return radio.heard_s[vehicle_id] >= self._silent_s.get(vehicle_id, 0.0)

    def sample(self, lockstep: Lockstep) -> None:
        """One row from a lockstep after its tick: the truth about every vehicle."""
        world = lockstep.world
        states = [v.airframe.state for v in world.vehicles.values()]
        autopilots = [v.autopilot.snapshot for v in world.vehicles.values()]
        samples = {
            k: VehicleSample(s.pos_ned_m, s.vel_ned_mps, s.on_ground, a.armed, k in lockstep.from_companion)
            for k, s, a in zip(world.vehicles, states, autopilots, strict=True)
        }
        self.add(world.now_s, samples, world.radio)
        numbers = [world.now_s, *(value for s in states for value in (*s.pos_ned_m, *s.vel_ned_mps))]
        self.trace.update(struct.pack(f"<{len(numbers)}d", *numbers))
        self.trace.update("".join([f"{a.mode}{a.armed:d}" for a in autopilots]).encode())
        for vehicle_id, frames in sorted(lockstep.beacons.items()):
            for frame in frames:
                # Without the header's sequence number: it also counts what was sent before the flight began.
                self.trace.update(bytes([vehicle_id]) + frame[10:-2])

    def recording(self) -> Recording:
        """All samples so far."""
        columns = list(zip(*self._rows, strict=True)) or [()] * len(COLUMNS)
        return Recording(
            **{name: np.array(column, dtype) for (name, dtype), column in zip(COLUMNS.items(), columns, strict=True)}
        )


COLUMNS: dict[str, Any] = {
    "time_s": np.float64,
    "pos_ned_m": np.float64,
    "vel_ned_mps": np.float64,
    "on_ground": np.bool_,
    "armed": np.bool_,
    "agent_alive": np.bool_,
    "range_m": np.float64,
    "phase": np.int8,
    "acting": np.bool_,
    "leader": np.int16,
}
