"""Tally of SWARM_LIDAR_SCAN for preflight and doctor: turns, ranges, bearings, steps and layers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

from companion.core.perception.obstacle_map import at_bearing
from companion.mavlink.lidar_scan import RAYS_MIN_SHARE, decode_lidar_scan
from companion.mavlink.sensor_source import Finding
from companion.sensors.obstacle_sensor import ScanTally, Sensor
from companion.sensors.view import View
from mission.document.model import Sensing
from mission.schema.kinds import RAW_LIDARS

LAYERS_MAX: Final = 128  # of one lidar, that are told apart
LAYERS_MIN_SHARE: Final = 0.8  # of the mission's
STEP_MAX_SHARE: Final = 1.1  # of the mission's: a lidar may turn a little faster than it is to
RAYS_FEW_SHARE: Final = 0.75  # fewer of its rays are told as a warning: nearly a third are missing
GAP_MIN_DEG: Final = (
    3  # of bearings of which no ray is ever measured: two of a degree that are missing cut a stem in two
)
TURNED_DEG: Final = 20.0  # by so much the layers' ends differ where a lidar hangs the other way up


class LidarTally(ScanTally):
    """Tally of what lidars send in a while: a turn, of however many pieces, is a scan."""

    MESSAGE = "SWARM_LIDAR_SCAN"
    FIX_SILENT = "is the driver running, and does it send there? Its link is given as --sensor lidar=URL"
    FIX_FEW_RAYS = "too few of its rays are measured: is its --raw finer than its samples a turn?"
    FIX_NONSENSE = "ranges in mm, a bearing_step that is not 0, far_cm above near_cm?"

    def __init__(self, began_s: float) -> None:
        super().__init__(began_s)
        self._turns: dict[tuple[int, int], int] = {}
        self._layers_deg: dict[tuple[int, int], set[float]] = {}
        self._steps_deg: dict[tuple[int, int], float] = {}
        self._degrees: dict[tuple[int, int], set[int]] = {}  # bearings of which a ray was measured
        self._rays: dict[tuple[int, int], tuple[int, int]] = {}  # measured, and all, in bearings with one measured

    def note_message(self, m: Any, who: tuple[int, int], _now_s: float) -> bool:
        """One SWARM_LIDAR_SCAN; True for the first of a turn."""
        piece = decode_lidar_scan(m)
        if piece is None:
            self._refused[who] = self._refused.get(who, 0) + 1
            return False
        self._last[who] = piece.min_m, piece.max_m, False
        layers_deg = self._layers_deg.setdefault(who, set())
        if len(layers_deg) < LAYERS_MAX:
            layers_deg.add(round(piece.elevation_deg, 1))
        self._steps_deg[who] = max(self._steps_deg.get(who, 0.0), round(abs(piece.bearing_step_deg), 3))
        self._views.setdefault(who, View()).note_rays(
            piece.ranges_m,
            first_deg=piece.first_bearing_deg,
            step_deg=piece.bearing_step_deg,
            elevation_deg=piece.elevation_deg,
        )
        bearings = [
            at_bearing(math.radians(piece.first_bearing_deg + k * piece.bearing_step_deg))
            for k in range(len(piece.ranges_m))
        ]
        self._degrees.setdefault(who, set()).update(
            math.floor(piece.first_bearing_deg + k * piece.bearing_step_deg + 1e-3) % 360
            for k, range_m in enumerate(piece.ranges_m)
            if not math.isnan(range_m)
        )
        measured = [at for at, range_m in zip(bearings, piece.ranges_m, strict=True) if not math.isnan(range_m)]
        seen = set(measured)
        self._seen.setdefault(who, set()).update(seen)
        # Where the airframe is in the way whole bearings are not measured, and are none of the rays that are left out
        before = self._rays.get(who, (0, 0))
        self._rays[who] = before[0] + len(measured), before[1] + sum(at in seen for at in bearings)
        is_new = self._turns.get(who) != piece.turn
        self._turns[who] = piece.turn
        return is_new

    def sensors(self, ended_s: float) -> tuple[Sensor, ...]:
        """All that were heard, with their layers and the step from ray to ray."""
        return tuple(
            replace(
                sensor,
                layers_deg=tuple(sorted(self._layers_deg.get((sensor.system, sensor.component), ()))),
                step_deg=self._steps_deg.get((sensor.system, sensor.component), 0.0),
                rays_share=self._rays_share((sensor.system, sensor.component)),
            )
            for sensor in super().sensors(ended_s)
        )

    def _rays_share(self, who: tuple[int, int]) -> float:
        """Of several layers 1: their points never repeat, and a ray without a return is not known to be measured."""
        measured, rays = self._rays.get(who, (0, 0))
        return measured / rays if rays and len(self._layers_deg[who]) == 1 else 1.0

    def describe(self, ended_s: float) -> Finding:
        """As of sectors; besides, whether of a level lidar most rays are measured."""
        finding = super().describe(ended_s)
        if any(sensor.rays_share < RAYS_MIN_SHARE for sensor in self.sensors(ended_s)):
            return replace(finding, fix="; ".join(filter(None, (finding.fix, self.FIX_FEW_RAYS))))
        return finding

    def check_sensing(self, sensing: Sensing, vehicle_id: int, ended_s: float, where: str) -> Finding:
        """As for sectors; besides, step, rays and layers that the mission's lidar has, these the right way up.

        A warning: bearings of a level lidar of which nothing is ever measured, or nearly too few rays.
        """
        finding = super().check_sensing(sensing, vehicle_id, ended_s, where)
        own = [sensor for sensor in self.sensors(ended_s) if sensor.system == vehicle_id]
        layers_deg = [deg for sensor in own for deg in sensor.layers_deg]
        lidar = RAW_LIDARS.get(sensing.sensor)
        if lidar is None or not layers_deg:
            return finding
        side = -1.0 if sensing.upside_down else 1.0
        wanted_deg = sorted(side * deg for deg in lidar.elevations_deg)
        wanted = f"{finding.wanted}, rays {lidar.step_deg:g} deg apart"
        if len(wanted_deg) > 1:
            wanted += f", {len(wanted_deg)} layers, {wanted_deg[0]:g} to {wanted_deg[-1]:g} deg up"
        rays_min = RAYS_MIN_SHARE * 360.0 / lidar.step_deg
        has_too_few = len(layers_deg) < LAYERS_MIN_SHARE * len(wanted_deg)
        is_turned = abs(max(layers_deg) - wanted_deg[-1]) > TURNED_DEG and not has_too_few
        problems = {
            "its rays are farther apart than those of sensing.sensor": max(sensor.step_deg for sensor in own)
            > STEP_MAX_SHARE * lidar.step_deg,
            self.FIX_FEW_RAYS: any(sensor.rays_share < 1.0 and sensor.rays_a_turn[0] < rays_min for sensor in own),
            "fewer layers than sensing.sensor has": has_too_few,
            "is it mounted as sensing.upside_down has it?": is_turned and len(wanted_deg) > 1,
            "its layers are not level, as that of sensing.sensor is": is_turned and len(wanted_deg) == 1,
        }
        fixes = [finding.fix, *(text for text, there in problems.items() if there)]
        fix = "; ".join(fix for fix in fixes if fix)
        doubts = (
            "" if fix or len(wanted_deg) > 1 else self._doubts(own, sensing.field_of_view_deg, 360.0 / lidar.step_deg)
        )
        return replace(finding, wanted=wanted, fix=fix or doubts, is_warning=bool(doubts))

    def _doubts(self, own: Sequence[Sensor], field_of_view_deg: float, rays: float) -> str:
        """Texts of a warning: bearings and rays that a level lidar's turns lack; empty: none."""
        degrees = set[int]().union(*(self._degrees[sensor.system, sensor.component] for sensor in own))
        half_deg = math.floor(field_of_view_deg / 2.0)
        gaps = [gap for gap in _gaps(degrees, half_deg) if gap[1] - gap[0] >= GAP_MIN_DEG]
        texts = [
            f"no ray from {first % 360} to {end % 360} deg is ever measured: a mast, a mask?" for first, end in gaps
        ]
        if any(sensor.rays_share < 1.0 and sensor.rays_a_turn[0] < RAYS_FEW_SHARE * rays for sensor in own):
            texts.append("nearly a third of its rays are not measured: dirt, sun, a cover?")
        return "; ".join(texts)


def _gaps(degrees: set[int], half_deg: int) -> list[tuple[int, int]]:
    """First degree, and the one behind the last, of bearings of which none is there, within so much of ahead."""
    found: list[tuple[int, int]] = []
    # A whole turn begins behind a bearing that is there: no gap is cut in two
    begin = next((deg for deg in range(-180, 180) if deg % 360 in degrees), -180) if half_deg >= 180 else -half_deg
    first = begin
    for deg in range(begin, begin + 2 * half_deg + 1):
        if deg % 360 in degrees or deg == begin + 2 * half_deg:
            if deg > first:
                found.append((first, deg))
            first = deg + 1
    return found
