"""Whether what sensors tell in a preflight will do for a mission."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

import pytest

from companion.core.model.events import ObstacleScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_map import ObstacleMap
from companion.mavlink import dialect
from companion.mavlink.packing import pack_ranges
from companion.preflight.report import Check, Verdict, check_of
from companion.sensors.lidar_tally import LAYERS_MAX, LidarTally
from companion.sensors.obstacle_sensor import ScanTally
from companion.sensors.range_radio import RangeTally
from companion.sensors.scans import decoded
from mission.document.model import Sensing
from mission.schema.kinds import RAW_LIDARS, SensorClass
from tests.unit.core.core_kit import mission
from tests.unit.core.ranging_kit import ranging_mission
from tests.unit.sensors import lidar_kit

ME, OTHER, WINDOW_S = 3, 4, 4.0
FULL = (300,) * 72


def message(distances_cm: tuple[int, ...] = FULL, **changes: Any) -> Any:
    fields: dict[str, Any] = {"increment": 5, "min_distance": 20, "max_distance": 800, "frame": 12}
    return dialect.MAVLink_obstacle_distance_message(
        0, 0, [*distances_cm, *[0xFFFF] * (72 - len(distances_cm))], **fields | changes
    )


def sensing(**changes: Any) -> Sensing:
    found = mission(sensing=changes).sensing
    assert found is not None
    return found


def judged(*told: tuple[Any, int, int, float], wanted: Sensing | None = None) -> Check:
    """Of messages with their system, component and rate, over the window."""
    tally = ScanTally(100.0)
    for m, system, component, rate_hz in told:
        for k in range(round(WINDOW_S * rate_hz)):
            tally.add(m, system, component, 100.0 + k / rate_hz)
    finding = tally.check_sensing(wanted or sensing(), ME, 100.0 + WINDOW_S, "udpin://x:1")
    return check_of("obstacles", finding)


def test_sensor_that_will_do_passes() -> None:
    check = judged((message(), ME, 196, 10.0))
    assert check.verdict is Verdict.PASS
    assert check.found == "3/196: 10.0 Hz, longest gap 0.10 s, 0.2 to 8 m, 360 deg from ahead"


def test_sensor_is_told_to_see_what_a_flight_takes_as_seen() -> None:
    for increment, count in ((2, 72), (5, 72), (10, 36), (45, 8)):
        told = message(FULL[:count], increment=increment, angle_offset=2.0)
        tally, seen = ScanTally(0.0), ObstacleMap()
        tally.add(told, ME, 196, 0.1)
        found = decoded(told, 196, 0.1)
        assert found is not None
        start_rad, step_rad = math.radians(found.start_deg), math.radians(found.step_deg)
        scan = ObstacleScan(196, found.ranges_m, start_rad, step_rad, found.min_m, found.max_m)
        seen.integrate_scan(scan, Position((0.0, 0.0, -8.0), ZERO), 0.1)
        blind = seen.find_blind(0.1, fresh_s=0.3)
        (sensor,) = tally.sensors(0.2)
        assert sensor.seen == tuple(k for k in range(72) if not blind[k])


def test_two_sensors_see_together_what_one_does_not() -> None:
    ahead, behind = message(FULL[:36], angle_offset=-90.0), message(FULL[:36], angle_offset=90.0)
    assert judged((ahead, ME, 196, 10.0)).verdict is Verdict.FAIL
    assert judged((ahead, ME, 196, 10.0), wanted=sensing(field_of_view_deg=180.0)).verdict is Verdict.PASS
    assert judged((ahead, ME, 196, 10.0), (behind, ME, 197, 10.0)).verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("told", "fix"),
    [
        ([], "is the driver running"),
        ([(message(), OTHER, 196, 10.0)], "this vehicle's system id, 3"),
        ([(message(), ME, 196, 5.0)], "more scans a second"),
        ([(message(max_distance=600), ME, 196, 10.0)], "max_distance is below sensing.range_m"),
        ([(message(FULL[:60]), ME, 196, 10.0)], "field_of_view_deg"),
        ([(message(FULL[:8], increment=45), ME, 196, 10.0)], "sectors wider than 10 deg"),
        ([(message(), ME, 196, 10.0), (message(), ME, 197, 2.0)], "what holds its scans up"),
        ([(message(increment=0), ME, 196, 10.0)], "more scans a second"),
    ],
)
def test_what_will_not_do_fails_with_what_to_mend(told: list[Any], fix: str) -> None:
    check = judged(*told)
    assert check.verdict is Verdict.FAIL
    assert check.name == "obstacles"
    assert fix in check.fix


def test_pause_longer_than_a_scan_may_be_old_fails() -> None:
    tally = ScanTally(100.0)
    for k in range(40):
        if not 20 <= k < 24:
            tally.add(message(), ME, 196, 100.0 + k / 10)
    check = tally.check_sensing(sensing(), ME, 104.0, "udpin://x:1")
    assert "what holds its scans up" in check.fix
    assert "longest gap 0.50 s" in check.found


# --- lidar -----------------------------------------------------------------------------------------------------------

LAYERS_DEG = RAW_LIDARS[SensorClass.MULTI_LAYER].elevations_deg


def turns(
    *elevations_deg: float,
    rate_hz: float = 10.0,
    pieces: int = 4,
    step_deg: float = 1.0,
    ranges_mm: tuple[int, ...] = (3000,) * 90,
    **wanted: Any,
) -> Check:
    """Of a lidar with these layers that sends so many quarters of each turn, over the window."""
    tally = LidarTally(100.0)
    for k in range(round(WINDOW_S * rate_hz)):
        for piece in range(pieces):
            for deg in elevations_deg:
                told = lidar_kit.message(
                    first_bearing_deg=90.0 * step_deg * piece,
                    elevation_deg=deg,
                    turn=k,
                    bearing_step_deg=step_deg,
                    ranges_mm=ranges_mm,
                )
                tally.add(told, ME, 196, 100.0 + k / rate_hz)
    return check_of("lidar", tally.check_sensing(sensing(**wanted), ME, 100.0 + WINDOW_S, "udpin://x:1"))


def test_lidar_that_will_do_passes_and_its_turns_are_counted() -> None:
    check = turns(0.0, sensor="scan-1deg", range_m=12.0)
    assert (check.verdict, check.fix) == (Verdict.PASS, "")
    assert check.found == "3/196: 10.0 Hz, longest gap 0.10 s, 0.2 to 12 m, 360 deg from ahead, rays 1 deg apart"
    check = turns(0.0, pieces=8, step_deg=0.5, sensor="scan-0.5deg", range_m=12.0)
    assert check.verdict is Verdict.PASS
    assert check.wanted.endswith(", rays 0.5 deg apart")
    check = turns(0.0, pieces=8, step_deg=0.5, sensor="scan-1deg", range_m=12.0)  # sees more than is asked for
    assert check.verdict is Verdict.PASS
    check = turns(*LAYERS_DEG, sensor="multi-layer", range_m=12.0)
    assert check.verdict is Verdict.PASS
    assert "15 layers, -7 to 52 deg up" in check.found
    hanging = turns(*(-deg for deg in LAYERS_DEG), sensor="multi-layer", range_m=12.0, upside_down=True)
    assert hanging.verdict is Verdict.PASS


HALF, SOME = (3000, 0) * 45, (3000, 0, 3000, 3000, 3000, 3000, 3000, 0, 3000) * 10
BLOCKED = (3000,) * 43 + (0,) * 20 + (3000,) * 27  # a leg


def test_lidar_of_which_most_rays_are_never_measured_fails_with_the_figures() -> None:
    check = turns(0.0, pieces=8, step_deg=0.5, ranges_mm=HALF, sensor="scan-0.5deg", range_m=12.0)
    assert (check.verdict, check.fix) == (Verdict.FAIL, LidarTally.FIX_FEW_RAYS)
    assert re.search(r"rays 0\.5 deg apart, 36\d of 720 rays a turn$", check.found)
    check = turns(0.0, ranges_mm=HALF, sensor="scan-1deg", range_m=12.0)
    assert (check.verdict, check.fix) == (Verdict.FAIL, LidarTally.FIX_FEW_RAYS)


def test_lidar_with_some_rays_that_are_not_measured_passes() -> None:
    check = turns(0.0, ranges_mm=SOME, sensor="scan-1deg", range_m=12.0)
    assert (check.verdict, check.fix) == (Verdict.PASS, "")
    check = turns(0.0, pieces=8, step_deg=0.5, ranges_mm=HALF, sensor="scan-1deg", range_m=12.0)  # all of its class's
    assert (check.verdict, check.fix) == (Verdict.PASS, "")
    check = turns(*LAYERS_DEG, ranges_mm=HALF, sensor="multi-layer", range_m=12.0)  # its points never repeat
    assert (check.verdict, check.fix) == (Verdict.PASS, "")


@pytest.mark.parametrize(
    ("missing", "field_of_view_deg", "fix"),
    [
        (range(174, 180), 360.0, "no ray from 174 to 180 deg is ever measured: a mast, a mask?"),
        ((358, 359, 0, 1), 360.0, "no ray from 358 to 2 deg is ever measured: a mast, a mask?"),
        (range(178, 183), 360.0, "no ray from 178 to 183 deg is ever measured: a mast, a mask?"),
        (range(178, 180), 360.0, ""),
        (range(135, 226), 270.0, ""),
        (range(100, 260), 200.0, ""),
        (range(120, 226), 270.0, "no ray from 120 to 135 deg is ever measured: a mast, a mask?"),
    ],
)
def test_bearings_of_which_nothing_is_ever_measured_are_a_warning(
    missing: Sequence[int], field_of_view_deg: float, fix: str
) -> None:
    """What is there is unknown in flight; none of it grounds."""
    tally = LidarTally(100.0)
    for k in range(30 * 4):
        told = [0 if 90 * (k % 4) + j in missing else 3000 for j in range(90)]
        if any(told):
            message = lidar_kit.message(first_bearing_deg=90.0 * (k % 4), turn=k // 4, ranges_mm=told)
            tally.add(message, ME, 196, 100.0 + 0.025 * k)
    wanted = sensing(sensor="scan-1deg", range_m=12.0, field_of_view_deg=field_of_view_deg)
    check = check_of("lidar", tally.check_sensing(wanted, ME, 103.0, "udpin://x:1"))
    assert (check.verdict, check.fix) == (Verdict.WARN if fix else Verdict.PASS, fix)


def test_lidar_of_which_nearly_a_third_of_the_rays_are_missing_is_a_warning() -> None:
    some = (3000, 3000, 3000, 0, 3000, 3000, 0, 3000, 3000, 0) * 9
    check = turns(0.0, ranges_mm=some, sensor="scan-1deg", range_m=12.0)
    assert check.verdict is Verdict.WARN
    assert check.fix == "nearly a third of its rays are not measured: dirt, sun, a cover?"


def test_layers_that_are_told_apart_are_bounded() -> None:
    tally = LidarTally(100.0)
    for k in range(3 * LAYERS_MAX):
        tally.add(lidar_kit.message(elevation_deg=0.1 * k), ME, 196, 100.0)
    (sensor,) = tally.sensors(101.0)
    assert len(sensor.layers_deg) == LAYERS_MAX


@pytest.mark.parametrize(
    ("check", "fix"),
    [
        (lambda: turns(0.0, sensor="scan-0.5deg", range_m=12.5), "max_distance is below sensing.range_m"),
        (
            lambda: turns(0.0, sensor="scan-0.5deg", range_m=12.0),
            "its rays are farther apart than those of sensing.sensor",
        ),
        (lambda: turns(0.0, rate_hz=5.0, sensor="scan-1deg"), "more scans a second"),
        (lambda: turns(0.0, pieces=3, sensor="scan-1deg"), "field_of_view_deg"),
        (lambda: turns(0.0, sensor="multi-layer"), "fewer layers than sensing.sensor has"),
        (lambda: turns(*LAYERS_DEG, sensor="multi-layer", upside_down=True), "as sensing.upside_down has it"),
        (lambda: turns(sensor="scan-1deg"), "--sensor lidar=URL"),
    ],
)
def test_lidar_that_will_not_do_fails_with_what_to_mend(check: Any, fix: str) -> None:
    told = check()
    assert told.verdict is Verdict.FAIL
    assert fix in told.fix


@pytest.mark.parametrize(
    ("check", "fix"),
    [
        (lambda: turns(0.0, sensor="multi-layer", range_m=12.0), "fewer layers than sensing.sensor has"),
        (
            lambda: turns(*LAYERS_DEG, sensor="scan-1deg", range_m=12.0),
            "its layers are not level, as that of sensing.sensor is",
        ),
        (
            lambda: turns(*LAYERS_DEG, sensor="multi-layer", range_m=12.0, upside_down=True),
            "is it mounted as sensing.upside_down has it?",
        ),
    ],
)
def test_of_layers_that_will_not_do_only_what_fits_is_said(check: Any, fix: str) -> None:
    assert check().fix == fix


# --- range radio ------------------------------------------------------------------------------------------------------


def ranged(*told: tuple[tuple[int, ...], int, float]) -> Check:
    """Of vehicles measured, with system and rate, over the window."""
    tally = RangeTally(100.0)
    for vehicles, system, rate_hz in told:
        m = dialect.MAVLink_swarm_ranges_message(0, list(pack_ranges([(k, 8.0, 0.0) for k in vehicles])))
        for k in range(round(WINDOW_S * rate_hz)):
            tally.add(m, system, 158, 100.0 + k / rate_hz)
    return check_of("ranges", tally.check(ranging_mission(), ME, 100.0 + WINDOW_S, "udpin://x:1"))


OTHERS = tuple(k for k in range(1, ranging_mission().swarm.size + 1) if k != ME)


def test_range_radio_that_measures_all_the_others_passes() -> None:
    check = ranged((OTHERS, ME, 10.0))
    assert (check.verdict, check.fix) == (Verdict.PASS, "")
    assert "3/158: 10.0 Hz, longest gap 0.10 s, ranges to 1, 2, 4" in check.found


@pytest.mark.parametrize(
    ("told", "verdict", "fix"),
    [
        ([], Verdict.FAIL, "--sensor ranges=URL"),
        ([(OTHERS, OTHER, 10.0)], Verdict.FAIL, "this vehicle's system id, 3"),
        ([((), ME, 10.0)], Verdict.FAIL, "it measures nobody"),
        ([((*OTHERS, 77), ME, 10.0)], Verdict.FAIL, "77 are no other vehicles of this mission"),
        ([(OTHERS, ME, 0.25)], Verdict.FAIL, "what holds its ranges up"),
        ([(OTHERS[:1], ME, 10.0)], Verdict.WARN, "not measured: 2"),
    ],
)
def test_range_radio_that_will_not_do_is_told_with_what_is_missing(told: list[Any], verdict: Verdict, fix: str) -> None:
    check = ranged(*told)
    assert (check.name, check.verdict) == ("ranges", verdict)
    assert fix in check.fix
