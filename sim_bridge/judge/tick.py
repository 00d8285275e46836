"""One tick of a flight: one frozen value that every driver emits, and all that judges a flight reads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from companion.core.model.beacon import RelativeReport
from companion.core.model.states import SwarmPhase
from companion.mavlink.beacon import WireBeacon
from mission.common.frames import Vec3

TOUCHED: Final = ("", "trunk", "crown", "ground", "vehicle", "box")  # what a vehicle may have run into
OBSTACLES: Final = {
    "trunk": "a trunk",
    "crown": "a crown",
    "ground": "the ground",
    "vehicle": "another vehicle",
    "box": "a box",
}  # the same in words


@dataclass(frozen=True, slots=True)
class Tick:
    """The end of one tick: where the vehicles are, and what their companions have said by then.

    The tuples hold one value for each vehicle, vehicle id k at index k - 1. NED metres about the mission's origin.
    """

    time_s: float  # simulated; on the wall clock, since the flight began
    pos_ned_m: tuple[Vec3, ...]
    vel_ned_mps: tuple[Vec3, ...]
    on_ground: tuple[bool, ...]
    armed: tuple[bool, ...]
    mode: tuple[str, ...]  # the autopilot's own name of it; "" where it is unknown
    range_m: tuple[float, ...]  # that each radio is set to
    touched: tuple[str, ...]  # what each has run into by now, of TOUCHED; it has fallen then, where the bridge flies it
    alive: tuple[int, ...]  # ids, rising: the companions that have not ended, of vehicles that have touched nothing
    answered: tuple[int, ...]  # ids, rising: those of them that answered in this tick
    said: Mapping[int, WireBeacon]  # by id: the last valid beacon of each companion
    said_s: Mapping[int, float]  # by id: when that was sent
    frames: Mapping[int, tuple[bytes, ...]]  # by id: the beacon frames sent in this tick, where the driver keeps them
    words: Mapping[int, RelativeReport]  # by id: the last that went with a beacon, where not all have GNSS
    # Of a simulated world, else empty: how far the north that each steers by is off the map's, eastwards; and the last
    # velocity (its own NED m/s) that its autopilot was asked to fly.
    north_off_rad: tuple[float, ...]
    asked_ned_mps: tuple[Vec3 | None, ...]

    def phase(self, among: Iterable[int]) -> SwarmPhase:
        """As the acting leader announces it, else the furthest of all; ASSEMBLE before the first beacon.

        `among`: ids of the vehicles that count.
        """
        phases = {k: self.said[k].swarm_phase for k in among if k in self.said}
        acting = [phase for k, phase in phases.items() if self.said[k].acting_leader == k]
        return SwarmPhase(max(acting or phases.values(), default=0))

    def stop(self, among: Iterable[int]) -> int:
        """Number of the mission's visit that the phase is about, as the acting leader says, else the last of all."""
        stops = {k: self.said[k].stop for k in among if k in self.said}
        acting = [stop for k, stop in stops.items() if self.said[k].acting_leader == k]
        return max(acting or stops.values(), default=0)

    def leader(self, among: Iterable[int]) -> int | None:
        """The first vehicle of `among` (ids) whose last beacon claims an established lead, or None."""
        return next((k for k in among if k in self.said and self.said[k].acting_leader == k), None)
