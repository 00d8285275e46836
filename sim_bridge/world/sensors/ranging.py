"""Range radios: two-way ranging between every two vehicles in turn, and the driver that tells of it.

One measurement occupies the air of the whole swarm for one slot, so the more pairs there are, the less often each is
measured: `rates`. Both ends learn of it (the last message of an exchange carries the result).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np

from companion.mavlink import dialect
from companion.mavlink.framing import wire
from companion.mavlink.packing import MOST, pack_ranges
from mission.common.frames import Vec3
from mission.document.model import Mission, RangeTrunks, Ranging, RangingErrors
from mission.stand.stand import Stand
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.simulated import SimulatedSensor

ANTENNA_UP_M: Final = 0.2  # above a vehicle's feet
LATE_M = (0.2, 1.2)  # too long by so much, even: what comes round a trunk, or is reflected
SALT: Final = 0x0BA7  # apart from the seeds of placement, wind, radio and the others


def pair_rate_hz(n: int, ranging: Ranging, errors: RangingErrors) -> float:
    """Rate at which each two of `n` vehicles measure their distance, Hz."""
    return min(ranging.rate_hz, errors.slots_hz / max(1, n * (n - 1) // 2))


class RangeRadios(SimulatedSensor):
    """Range radios of all vehicles. Draws from `seed` alone, in the order of time: never by where the vehicles are."""

    def __init__(
        self, ids: Sequence[int], ranging: Ranging, errors: RangingErrors, stand: Stand | None, *, seed: int
    ) -> None:
        """`stand`: what may stand between two; None: nothing does."""
        super().__init__("ranges")
        self._pairs = [(a, b) for a in ids for b in ids if a < b]
        self._reach_m = ranging.reach_m
        self._errors = errors
        self._blocked: Callable[[Vec3, Vec3], bool] | None = None
        if stand is not None and stand.has_obstacles and errors.trunks is not RangeTrunks.CLEAR:
            self._blocked = lambda a, b: _stands_between(stand, _antenna_enu_m(a), _antenna_enu_m(b))
        self._rng = np.random.default_rng([seed, SALT])
        rate_hz = pair_rate_hz(len(ids), ranging, errors)
        self._step_s = 1.0 / (rate_hz * max(1, len(self._pairs)))  # from one measurement to the next
        self._done = 0
        self._hidden_m: dict[tuple[int, int], float] = {}  # late by so much while a trunk stands between
        self._drivers = {k: wire.Sender(k, dialect.MAV_COMP_ID_PERIPHERAL) for k in ids}
        self._wrong: Mapping[int, tuple[float, ...]] = MappingProxyType({})  # by id: bias and noise of a fault
        self._measured_s = -1.0
        self._frames: dict[int, bytes] = {}  # what drivers send at that time

    def set_errors(self, errors: Mapping[int, tuple[float, ...]]) -> None:
        """Bias and noise of all ranges of a vehicle, whoever measures them."""
        self._wrong = errors

    def frames(
        self, vehicle_id: int, _state: AirframeState, positions_ned_m: Mapping[int, Vec3], now_s: float
    ) -> bytes:
        """SWARM_RANGES, or nothing."""
        if now_s != self._measured_s:
            self._measured_s = now_s
            self._frames = self.measure(positions_ned_m, now_s)
        return self._frames.get(vehicle_id, b"")

    def measure(self, positions_ned_m: Mapping[int, Vec3], now_s: float) -> dict[int, bytes]:
        """Frames of SWARM_RANGES that each vehicle's driver sends now, where it has some."""
        found: dict[int, list[tuple[int, float, float]]] = {}
        due = math.floor(now_s / self._step_s + 1e-6) if self._pairs else 0
        if due - self._done > 4 * len(self._pairs):  # after a pause
            self._done = due
        while self._done < due:
            a, b = self._pairs[self._done % len(self._pairs)]
            self._done += 1
            draws = self._rng.random(3).tolist()
            noise_m = self._error_m(a, b, float(self._rng.standard_normal()))
            if a not in positions_ned_m or b not in positions_ned_m:
                continue
            true_m = math.dist(positions_ned_m[a], positions_ned_m[b])
            late_m = LATE_M[0] + (LATE_M[1] - LATE_M[0]) * draws[2]
            by_trunk_m = self._by_trunk_m(a, b, positions_ned_m, late_m)
            if by_trunk_m is None or true_m > self._reach_m or draws[0] < self._errors.loss:
                continue
            measured_m = true_m + noise_m + max(by_trunk_m, late_m if draws[1] < self._errors.late else 0.0)
            found.setdefault(a, []).append((b, max(0.05, measured_m), 0.0))
            found.setdefault(b, []).append((a, max(0.05, measured_m), 0.0))
        return {k: self._encode_ranges(k, ranges, now_s) for k, ranges in found.items()}

    def _error_m(self, a: int, b: int, normal: float) -> float:
        """Without what trunks and reflections do. `normal`: drawn, of unit size."""
        wrong = self._wrong.get(a) or self._wrong.get(b)
        if wrong is None:
            return self._errors.noise_m * normal
        bias_m, noise_m = wrong
        return bias_m + math.hypot(self._errors.noise_m, noise_m) * normal

    def _by_trunk_m(self, a: int, b: int, positions_ned_m: Mapping[int, Vec3], late_m: float) -> float | None:
        """By how much a range is too long for what stands between: the same for as long as it does; None: no range."""
        if self._blocked is None or not self._blocked(positions_ned_m[a], positions_ned_m[b]):
            self._hidden_m.pop((a, b), None)
            return 0.0
        if self._errors.trunks is RangeTrunks.CUT:
            return None
        return self._hidden_m.setdefault((a, b), late_m)

    def _encode_ranges(self, vehicle_id: int, ranges: list[tuple[int, float, float]], now_s: float) -> bytes:
        send = self._drivers[vehicle_id].frame
        time_boot_ms = struct.pack("<I", round(self.stamp_s(now_s) * 1e3) & 0xFFFFFFFF)
        return b"".join(
            send(dialect.MAVLINK_MSG_ID_SWARM_RANGES, time_boot_ms + pack_ranges(ranges[at : at + MOST]))
            for at in range(0, len(ranges), MOST)
        )


def range_radios_of(mission: Mission, stand: Stand, ids: Sequence[int]) -> RangeRadios | None:
    """Of a mission whose vehicles carry some."""
    if mission.ranging is None or not mission.ranging.radio:
        return None
    return RangeRadios(ids, mission.ranging, mission.sim.ranging, stand, seed=mission.sim.seed)


def _stands_between(stand: Stand, a_enu_m: Vec3, b_enu_m: Vec3) -> bool:
    return bool(stand.crossed(a_enu_m, b_enu_m) or stand.boxes_crossed(a_enu_m, b_enu_m))


def _antenna_enu_m(ned_m: Vec3) -> Vec3:
    return (ned_m[1], ned_m[0], ANTENNA_UP_M - ned_m[2])
