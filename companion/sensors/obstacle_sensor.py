"""Obstacle sensors (a lidar that turns level, depth cameras, a ring of rangefinders): OBSTACLE_DISTANCE."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

from companion.core.model.events import Event
from companion.core.perception.obstacle_map import BEARINGS, at_bearing
from companion.mavlink import dialect
from companion.mavlink.sensor_source import Finding, SensorSource, SensorTally
from companion.sensors.scans import ATTITUDE_HZ, NORTH_ALIGNED, Scans, decoded
from companion.sensors.view import View
from mission.document.model import Mission, Sensing
from mission.schema.kinds import SensorClass

RATE_MIN_SHARE = 0.8  # of the mission's; one scan more is the window's edge
VIEW_MIN_SHARE = 0.9  # of the mission's: an arm or a leg may stand in the way


class ObstacleSensor(SensorSource):
    """A vehicle's obstacle sensors, in a mission with [sensing]."""

    NAME = "obstacles"
    TITLE = "obstacle sensor"
    MESSAGES = {dialect.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: "OBSTACLE_DISTANCE"}  # noqa: RUF012
    HELP = "OBSTACLE_DISTANCE of obstacle sensors, in a mission with [sensing]; else taken from the autopilot's link"
    ABOUT = (
        "In a mission with [sensing]: each obstacle sensor that is heard, on a sensor's link or else by way of the "
        f"autopilot, has {RATE_MIN_SHARE * 100:.0f} % of `sensing.rate_hz` or more and no gap above `sensing.stale_s`, "
        f"and sees as far as `sensing.range_m`; together they see {VIEW_MIN_SHARE * 100:.0f} % of "
        "`sensing.field_of_view_deg` or more, in sectors of 10 degrees or less: of wider ones only the middle counts "
        "as seen."
    )
    UNUSED = (
        'has no [sensing] with sensor = "sectors", so nothing would fly by this sensor. Set the key in the mission of '
        "all vehicles, name a raw lidar's link as lidar=, or leave the option out"
    )
    STALE = "no scan that is fresh"
    IS_FORWARDED = True
    AUTOPILOT_HZ = {dialect.MAVLINK_MSG_ID_ATTITUDE: ATTITUDE_HZ}  # noqa: RUF012

    def __init__(self, stale_s: float) -> None:
        super().__init__(stale_s)
        self._scans = Scans()

    @classmethod
    def is_flown(cls, mission: Mission) -> bool:
        """True if the mission has [sensing], and its sensor tells sectors."""
        return mission.sensing is not None and mission.sensing.sensor is SensorClass.SECTORS

    @classmethod
    def of(cls, mission: Mission) -> Self:
        """One vehicle's."""
        assert mission.sensing is not None
        return cls(mission.sensing.stale_s)

    def decode(self, m: Any, component: int, now_s: float) -> Event | None:
        """OBSTACLE_DISTANCE, which waits for the tick's ATTITUDE."""
        self._scans.scan(m, component, now_s)
        return None

    def read_autopilot(self, m: Any, now_s: float) -> None:
        """ATTITUDE."""
        self._scans.attitude(m, now_s)

    def collect(self, now_s: float) -> list[Event]:
        """Scans with how the vehicle stood."""
        found: list[Event] = []
        for scan in self._scans.join(now_s):
            self.mark_measured(scan.sensor, now_s - scan.age_s)
            found.append(scan)
        return found

    def counters(self) -> dict[str, int]:
        """Scans that were dropped."""
        return {"scans refused": self._scans.refused, "scans without attitude": self._scans.without_attitude}

    @classmethod
    def tally(cls, began_s: float) -> ScanTally:
        """Counts OBSTACLE_DISTANCE."""
        return ScanTally(began_s)


@dataclass(frozen=True, slots=True)
class Sensor:
    """One obstacle sensor, as heard in a window of time."""

    system: int
    component: int
    rate_hz: float
    gap_s: float  # the longest
    min_m: float = 0.0
    max_m: float = 0.0
    seen: tuple[int, ...] = ()  # of BEARINGS, those that a flight takes as seen; from ahead, or from north
    from_north: bool = False
    refused: int = 0  # messages whose content makes no sense, or shows nothing
    layers_deg: tuple[float, ...] = ()  # above level, of a lidar whose rays are told
    step_deg: float = 0.0  # from ray to ray, the widest, of such a lidar
    rays_share: float = 1.0  # of a level lidar's rays that are measured, in bearings of which it measures any

    @property
    def rays_a_turn(self) -> tuple[int, int]:
        """Rays of a turn that are measured, and all: 0 where steps are not told."""
        rays = round(360.0 / self.step_deg) if self.step_deg else 0
        return round(self.rays_share * rays), rays

    @property
    def text(self) -> str:
        """For people."""
        start = "north" if self.from_north else "ahead"
        words = [
            f"{self.system}/{self.component}: {self.rate_hz:.1f} Hz",
            f"longest gap {self.gap_s:.2f} s",
            f"{self.min_m:g} to {self.max_m:g} m" if self.max_m else "",
            f"{len(self.seen) * 360 // BEARINGS} deg from {start}" if self.max_m else "",
            f"rays {self.step_deg:g} deg apart" if self.step_deg else "",
            f"{self.rays_a_turn[0]} of {self.rays_a_turn[1]} rays a turn" if self.rays_share < 1.0 else "",
            f"{len(self.layers_deg)} layers, {self.layers_deg[0]:g} to {self.layers_deg[-1]:g} deg up"
            if len(self.layers_deg) > 1
            else "",
            f"{self.refused} make no sense" if self.refused else "",
        ]
        return ", ".join(word for word in words if word)


class ScanTally(SensorTally):
    """Tally of what obstacle sensors send in a while, and whether a mission with [sensing] can be flown by it."""

    MESSAGE = "OBSTACLE_DISTANCE"
    FIX_SILENT = (
        "is the driver running, and does it send there? Else give its link as --sensor obstacles=URL, or let the "
        "autopilot forward it"
    )
    FIX_NONSENSE = "distances in cm, an increment above 0, a frame that is supported?"

    def __init__(self, began_s: float) -> None:
        super().__init__(began_s)
        self._refused: dict[tuple[int, int], int] = {}
        self._last: dict[tuple[int, int], tuple[float, float, bool]] = {}  # least, greatest, from north
        self._seen: dict[tuple[int, int], set[int]] = {}
        self._views: dict[tuple[int, int], View] = {}

    def note_message(self, m: Any, who: tuple[int, int], now_s: float) -> bool:
        """One OBSTACLE_DISTANCE."""
        scan = decoded(m, who[1], now_s)
        if scan is None:
            self._refused[who] = self._refused.get(who, 0) + 1
            return False
        self._last[who] = scan.min_m, scan.max_m, m.frame in NORTH_ALIGNED
        if not scan.from_north:
            view = self._views.setdefault(who, View())
            view.note_rays(scan.ranges_m, first_deg=scan.start_deg, step_deg=scan.step_deg)
        seen = self._seen.setdefault(who, set())
        for k, range_m in enumerate(scan.ranges_m):
            if not math.isnan(range_m):
                seen.add(at_bearing(math.radians(scan.start_deg + k * scan.step_deg)))
        return True

    def sensors(self, ended_s: float) -> tuple[Sensor, ...]:
        """All that were heard."""
        return tuple(
            Sensor(
                *who,
                *self.timing(who, ended_s),
                *self._last.get(who, (0.0, 0.0, False))[:2],
                seen=_as_flown(self._seen.get(who, set())),
                from_north=self._last.get(who, (0.0, 0.0, False))[2],
                refused=self._refused.get(who, 0),
            )
            for who in sorted(self._arrived_s)
        )

    def check(self, mission: Mission, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """Against [sensing]."""
        assert mission.sensing is not None
        return self.check_sensing(mission.sensing, vehicle_id, ended_s, where)

    def check_sensing(self, sensing: Sensing, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """True if rate, gaps, range and field of view will do."""
        wanted = (
            f"{sensing.rate_hz:g} Hz, no gap above {sensing.stale_s:g} s, {sensing.range_m:g} m, "
            f"{sensing.field_of_view_deg:g} deg"
        )
        heard = self.sensors(ended_s)
        own = [sensor for sensor in heard if sensor.system == vehicle_id]
        found = "; ".join(sensor.text for sensor in heard) or f"no {self.MESSAGE} on {where}"
        if not own:
            fix = f"a driver must send with this vehicle's system id, {vehicle_id}" if heard else self.FIX_SILENT
            return Finding(found, wanted, fix)
        return Finding(found, wanted, _fixes(own, sensing, ended_s - self._began_s))

    def describe(self, ended_s: float) -> Finding:
        """Row of what was seen; the mission, which `companion preflight` knows, says whether that will do."""
        sensors = self.sensors(ended_s)
        makes_sense = any(sensor.max_m for sensor in sensors)
        return Finding(
            "; ".join(sensor.text for sensor in sensors),
            f"{self.MESSAGE} that makes sense",
            "" if makes_sense else self.FIX_NONSENSE,
        )

    def describe_view(self) -> str:
        """Nearest of eight directions, of each sensor that tells bearings from the nose."""
        views = sorted(self._views.items())
        return "; ".join(f"{system}/{component}: {view.describe()}" for (system, component), view in views)


def _fixes(own: Sequence[Sensor], sensing: Sensing, window_s: float) -> str:
    least_hz = RATE_MIN_SHARE * sensing.rate_hz - 1.0 / window_s
    seen_deg = len({at for sensor in own for at in sensor.seen}) * 360 / BEARINGS
    problems = {
        "more scans a second, or a lower sensing.rate_hz": any(sensor.rate_hz < least_hz for sensor in own),
        "what holds its scans up? A busy computer, a slow link": any(sensor.gap_s > sensing.stale_s for sensor in own),
        "its max_distance is below sensing.range_m": any(sensor.max_m < sensing.range_m - 0.01 for sensor in own),
        "what is in its way? Are its sectors wider than 10 deg? Or a smaller sensing.field_of_view_deg": seen_deg
        < VIEW_MIN_SHARE * sensing.field_of_view_deg,
    }
    return "; ".join(text for text, there in problems.items() if there)


def _as_flown(measured: set[int]) -> tuple[int, ...]:
    """With those that were measured on both sides, as in `ObstacleMap.blind`."""
    return tuple(k for k in range(BEARINGS) if k in measured or {(k - 1) % BEARINGS, (k + 1) % BEARINGS} <= measured)
