"""Scans of sectors: the nearest of each, free and unknown apart, turned and masked as the lidar is mounted."""

from __future__ import annotations

import pytest

from companion.core.model.events import ObstacleScan
from companion.lidar.driver import Return
from companion.lidar.models import MODELS
from companion.lidar.mounting import SECTORS, Mounting, sector_at
from companion.lidar.options import MODEL_NAMES, parse_band, parse_mask
from companion.lidar.sectors import SCAN_MAX_S, UNKNOWN_CM, Limits, SectorScan, obstacle_distance
from companion.mavlink import dialect
from companion.sensors.obstacle_sensor import ObstacleSensor

LIMITS = Limits(0.2, 12.0)
FREE_CM = 1201


def turn(ranges_m: dict[int, float], elsewhere_m: float = 0.0) -> list[Return]:
    """A revolution: one return in the middle of each sector."""
    return [(500 * k, ranges_m.get(k, elsewhere_m), 0.0, k == 0) for k in range(SECTORS)]


def scan_of(returns: list[Return], mounting: Mounting, limits: Limits = LIMITS) -> list[int]:
    """The scan of one revolution, which the next one's first return completes."""
    sectors = SectorScan(limits, mounting)
    assert sectors.update(returns, 1.0) == []
    (scan,) = sectors.update([(0, 0.0, 0.0, True)], 1.1)
    return scan


def test_each_sector_has_its_nearest_and_one_where_nothing_came_back_is_free() -> None:
    scan = scan_of([*turn({0: 3.0, 18: 2.0}), (0, 2.5, 0.0, False), (9100, 4.0, 0.0, False)], Mounting())
    assert scan == [250 if k == 0 else 200 if k == 18 else FREE_CM for k in range(SECTORS)]


def test_beyond_the_range_is_free_and_where_no_pulse_went_is_unknown() -> None:
    scan = scan_of([(0, 12.5, 0.0, True), (500, 12.0, 0.0, False)], Mounting())
    assert scan == [FREE_CM, 1200] + [UNKNOWN_CM] * 70


def test_a_return_from_too_near_is_no_obstacle_and_makes_its_sector_unknown_not_free() -> None:
    scan = scan_of(
        [(0, 0.0, 0.0, True), (10, 0.05, 0.0, False), (500, 0.05, 0.0, False), (510, 3.0, 0.0, False)], Mounting()
    )
    assert scan[:2] == [UNKNOWN_CM, 300]


@pytest.mark.parametrize(
    ("mounting", "sector"),
    [
        (Mounting(), 18),
        (Mounting(yaw_deg=90.0), 36),
        (Mounting(yaw_deg=-45.0), 9),
        (Mounting(upside_down=True), 54),
        (Mounting(yaw_deg=180.0, upside_down=True), 18),
    ],
)
def test_a_return_at_the_lidars_right_is_where_the_mounting_puts_it(mounting: Mounting, sector: int) -> None:
    scan = scan_of(turn({18: 2.0}), mounting)
    assert [k for k, cm in enumerate(scan) if cm != FREE_CM] == [sector]


def test_masked_sectors_are_unknown_whatever_is_seen_there() -> None:
    scan = scan_of(turn({}, 5.0), Mounting(mask=parse_mask("355..5,88..96")))
    assert [k for k, cm in enumerate(scan) if cm == UNKNOWN_CM] == [0, 1, 18, 19, 71]
    assert set(scan) == {UNKNOWN_CM, 500}


@pytest.mark.parametrize(("upside_down", "seen_cm"), [(False, 300), (True, 200)])
def test_points_outside_the_band_are_no_obstacles_but_show_that_the_lidar_looks_there(
    upside_down: bool, seen_cm: int
) -> None:
    limits = Limits(0.1, 40.0, 0.1, (-0.2, 1.0))
    returns = [(0, 2.0, -0.9, False), (0, 3.0, 0.9, False), (1000, 5.0, 4.0, False)]
    sectors = SectorScan(limits, Mounting(upside_down=upside_down))
    assert sectors.update(returns, 0.0) == []
    assert sectors.update(returns, 0.09) == []
    (scan,) = sectors.update([], 0.1)
    assert scan[0] == seen_cm
    assert 4001 in (scan[2], scan[-2])
    assert scan.count(UNKNOWN_CM) == SECTORS - 2


def test_a_scan_with_a_gap_in_it_is_dropped() -> None:
    sectors = SectorScan(LIMITS, Mounting())
    sectors.update(turn({}, 5.0), 0.0)
    assert sectors.update(turn({}, 6.0), SCAN_MAX_S + 0.01) == []
    assert sectors.update(turn({}, 7.0), SCAN_MAX_S + 0.11) == [[600] * SECTORS]


def test_the_companion_reads_the_message_as_the_scan_was() -> None:
    message = obstacle_distance(scan_of(turn({0: 3.0, 18: 2.0}), Mounting(mask=frozenset({5}))), LIMITS, 7.0)
    sensor = ObstacleSensor(0.3)
    sensor.read_autopilot(dialect.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 7.0)
    sensor.decode(message, 196, 7.0)
    (scan,) = sensor.collect(7.0)
    assert isinstance(scan, ObstacleScan)
    assert (scan.ranges_m[0], scan.ranges_m[18], scan.ranges_m[1]) == (3.0, 2.0, float("inf"))
    assert scan.ranges_m[5] != scan.ranges_m[5]
    assert (scan.min_m, scan.max_m, scan.start_rad) == (0.2, 12.0, 0.0)


def test_every_model_has_a_name_on_the_command_line_and_limits_that_a_message_carries() -> None:
    assert tuple(MODELS) == MODEL_NAMES
    assert all(0.0 < model.limits.min_m < model.limits.max_m <= 655.0 for model in MODELS.values())


def test_sector_0_looks_ahead() -> None:
    assert [sector_at(deg) for deg in (-2.6, -2.4, 0.0, 2.4, 2.6, 357.6, 720.0)] == [71, 0, 0, 0, 1, 0, 0]


@pytest.mark.parametrize(
    "text",
    [
        *("", "10", "10..", "a..b", "10..20,", "1000..2", "999..5", "10...20"),
        *(
            "0..355",
            "0..358",
            "0..359",
            "0..360",
            "-180..180",
            "2..1",
        ),  # all round, and not the one sector they begin in
    ],
)
def test_a_mask_that_is_none_is_refused_with_its_value(text: str) -> None:
    with pytest.raises(ValueError, match=r"must be FROM\.\.TO|leaves no sector"):
        parse_mask(text)


def test_bands() -> None:
    assert parse_band("-0.5..1") == (-0.5, 1.0)
    with pytest.raises(ValueError, match="lower end"):
        parse_band("1..-1")
