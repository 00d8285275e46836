"""What obstacle sensors tell in a while, and whether a mission with [sensing] can be flown by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from pydantic import BaseModel, ConfigDict

from companion.core.perception.obstacle_map import BEARINGS, at_bearing
from companion.mavlink.scans import NORTH_ALIGNED, decoded
from companion.preflight.report import Check, Verdict
from mission.document.model import Sensing

RATE_MIN_SHARE = 0.8  # of the mission's; one scan more is the window's edge
VIEW_MIN_SHARE = 0.9  # of the mission's: an arm or a leg may stand in the way
OBSTACLES_ABOUT = (
    "In a mission with [sensing]: each obstacle sensor that is heard, on --obstacles or else by way of the autopilot, "
    f"has {RATE_MIN_SHARE * 100:.0f} % of `sensing.rate_hz` or more and no gap above `sensing.stale_s`, and sees as "
    f"far as `sensing.range_m`; together they see {VIEW_MIN_SHARE * 100:.0f} % of `sensing.field_of_view_deg` or more, "
    "in sectors of 10 degrees or less: of wider ones only the middle counts as seen."
)


class Sensor(BaseModel):
    """One obstacle sensor, as heard in a window of time."""

    model_config = ConfigDict(frozen=True)

    system: int
    component: int
    rate_hz: float
    gap_s: float  # the longest
    min_m: float = 0.0
    max_m: float = 0.0
    seen: tuple[int, ...] = ()  # of BEARINGS, those that a flight takes as seen; from ahead, or from north
    from_north: bool = False
    refused: int = 0  # messages whose content makes no sense, or shows nothing

    @property
    def text(self) -> str:
        """For people."""
        start = "north" if self.from_north else "ahead"
        words = [
            f"{self.system}/{self.component}: {self.rate_hz:.1f} Hz",
            f"longest gap {self.gap_s:.2f} s",
            f"{self.min_m:g} to {self.max_m:g} m" if self.max_m else "",
            f"{len(self.seen) * 360 // BEARINGS} deg from {start}" if self.max_m else "",
            f"{self.refused} make no sense" if self.refused else "",
        ]
        return ", ".join(word for word in words if word)


class Tally:
    """Feed it each OBSTACLE_DISTANCE of a window that began at `began_s`; times are of one monotonic clock."""

    def __init__(self, began_s: float) -> None:
        self._began_s = began_s
        self._arrived_s: dict[tuple[int, int], list[float]] = {}
        self._refused: dict[tuple[int, int], int] = {}
        self._last: dict[tuple[int, int], dict[str, Any]] = {}
        self._seen: dict[tuple[int, int], set[int]] = {}

    def take(self, m: Any, system: int, component: int, now_s: float) -> None:
        """One message, with its fields as attributes."""
        who = (system, component)
        times_s = self._arrived_s.setdefault(who, [])
        scan = decoded(m, component, now_s)
        if scan is None:
            self._refused[who] = self._refused.get(who, 0) + 1
            return
        times_s.append(now_s)
        self._last[who] = {"min_m": scan.min_m, "max_m": scan.max_m, "from_north": m.frame in NORTH_ALIGNED}
        seen = self._seen.setdefault(who, set())
        for k, range_m in enumerate(scan.ranges_m):
            if not math.isnan(range_m):
                seen.add(at_bearing(math.radians(scan.start_deg + k * scan.step_deg)))

    def sensors(self, ended_s: float) -> tuple[Sensor, ...]:
        """All that were heard."""
        window_s = max(ended_s - self._began_s, 1e-3)
        found = []
        for who, times_s in sorted(self._arrived_s.items()):
            at_s = [self._began_s, *times_s, ended_s]
            gap_s = max(after - before for before, after in pairwise(at_s))
            found.append(
                Sensor(
                    system=who[0],
                    component=who[1],
                    rate_hz=len(times_s) / window_s,
                    gap_s=gap_s,
                    seen=_as_flown(self._seen.get(who, set())),
                    refused=self._refused.get(who, 0),
                    **self._last.get(who, {}),
                )
            )
        return tuple(found)


def _as_flown(measured: set[int]) -> tuple[int, ...]:
    """With those that were measured on both sides, as in `ObstacleMap.blind`."""
    return tuple(k for k in range(BEARINGS) if k in measured or {(k - 1) % BEARINGS, (k + 1) % BEARINGS} <= measured)


def check_obstacles(heard: Sequence[Sensor], sensing: Sensing, vehicle_id: int, window_s: float, where: str) -> Check:
    """The row of a preflight. `where`: the link on which they were listened for."""
    wanted = (
        f"{sensing.rate_hz:g} Hz, no gap above {sensing.stale_s:g} s, {sensing.range_m:g} m, "
        f"{sensing.field_of_view_deg:g} deg"
    )
    own = [sensor for sensor in heard if sensor.system == vehicle_id]
    found = "; ".join(sensor.text for sensor in heard) or f"no OBSTACLE_DISTANCE on {where}"
    least_hz = RATE_MIN_SHARE * sensing.rate_hz - 1.0 / window_s
    seen = len({at for sensor in own for at in sensor.seen}) * 360 / BEARINGS
    problems = {
        f"a driver must send with this vehicle's system id, {vehicle_id}": bool(heard) and not own,
        "is the driver running, and does it send there? Else give its link as --obstacles, or let the autopilot "
        "forward it": not heard,
        "more scans a second, or a lower sensing.rate_hz": any(sensor.rate_hz < least_hz for sensor in own),
        "what holds its scans up? A busy computer, a slow link": any(sensor.gap_s > sensing.stale_s for sensor in own),
        "its max_distance is below sensing.range_m": any(sensor.max_m < sensing.range_m - 0.01 for sensor in own),
        "what is in its way? Are its sectors wider than 10 deg? Or a smaller sensing.field_of_view_deg": bool(own)
        and seen < VIEW_MIN_SHARE * sensing.field_of_view_deg,
    }
    fix = "; ".join(text for text, there in problems.items() if there)
    verdict = Verdict.FAIL if fix else Verdict.PASS
    return Check(name="obstacles", verdict=verdict, found=found, wanted=wanted, fix=fix)
