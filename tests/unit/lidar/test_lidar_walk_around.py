"""The check of a mounting: a person who walks round is found, and wrong mountings are told apart and mended."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from companion.lidar.mounting import SECTORS, Mounting, sector_at
from companion.lidar.walk_around import BASELINE_SCANS, STEADY_SCANS, WalkAround, mean_deg
from companion.sensors.view import describe_view

MAX_CM = 1200
TREE = {sector_at(300.0): 150}  # which stands nearer than the person


def scan(person_deg: float | None = None, range_cm: int = 210) -> list[int]:
    """Nothing about the vehicle but a tree, and perhaps a person."""
    cm = [TREE.get(k, MAX_CM + 1) for k in range(SECTORS)]
    if person_deg is not None:
        for at_deg in (person_deg - 5.0, person_deg, person_deg + 5.0):
            cm[sector_at(at_deg)] = range_cm
    return cm


def walk(mounted: Mounting, given: Mounting) -> tuple[WalkAround, list[str]]:
    """All four places, of a lidar that is `mounted` so where the options say `given`."""

    def seen_deg(true_deg: float) -> float:
        azimuth_deg = (true_deg - mounted.yaw_deg) * (-1 if mounted.upside_down else 1)
        return given.yaw_deg + azimuth_deg * (-1 if given.upside_down else 1)

    def scans() -> Iterator[list[int]]:
        yield from [scan()] * BASELINE_SCANS
        for true_deg in (0.0, 90.0, 180.0, 270.0):
            yield from (scan(seen_deg(true_deg - back_deg)) for back_deg in range(60, 0, -10))  # walks there
            yield from [scan(seen_deg(true_deg))] * STEADY_SCANS

    check = WalkAround(MAX_CM, yaw_deg=given.yaw_deg, upside_down=given.upside_down)
    return check, check.begin() + [line for one in scans() for line in check.update(one)]


def test_a_right_mounting_passes_and_each_place_is_told() -> None:
    check, lines = walk(Mounting(), Mounting())
    assert check.passed is True
    assert lines[0].startswith("Stand clear")
    assert lines[1] == "Walk round, and stand still in front of the vehicle, about 2 m from it."
    assert lines[2] == "seen at 2.1 m, bearing 0 deg: in front of the vehicle is right"
    assert [line for line in lines if line.startswith("seen")][1:] == [
        "seen at 2.1 m, bearing 90 deg: to the right of the vehicle is right",
        "seen at 2.1 m, bearing 180 deg: behind the vehicle is right",
        "seen at 2.1 m, bearing 270 deg: to the left of the vehicle is right",
    ]
    assert lines[-1].startswith("PASS")


@pytest.mark.parametrize("mounted", [Mounting(90.0), Mounting(180.0), Mounting(0.0, True), Mounting(45.0, True)])
@pytest.mark.parametrize("given", [Mounting(), Mounting(30.0), Mounting(0.0, True)])
def test_a_wrong_one_fails_and_what_it_advises_passes(mounted: Mounting, given: Mounting) -> None:
    check, lines = walk(mounted, given)
    if check.passed:
        assert mounted == given
        return
    assert any("WRONG" in line for line in lines)
    assert lines[-1].startswith("FAIL")
    yaw = re.search(r"--yaw-deg (\d+)", lines[-1])
    assert yaw is not None
    advised = Mounting(float(yaw[1]), "--upside-down" in lines[-1] and "without" not in lines[-1])
    assert advised.upside_down == mounted.upside_down
    again, _ = walk(mounted, advised)
    assert again.passed is True


def test_bearings_that_fit_no_mounting_fail_without_advice() -> None:
    check = WalkAround(MAX_CM, yaw_deg=0.0, upside_down=False)
    places = (0.0, 90.0, 20.0, 200.0)
    lines = [line for one in [scan()] * BASELINE_SCANS for line in check.update(one)]
    lines += [line for deg in places for one in [scan(deg)] * STEADY_SCANS for line in check.update(one)]
    assert check.passed is False
    assert "fit no mounting" in lines[-1]
    assert "--yaw-deg" not in lines[-1]


def test_nobody_and_what_stood_there_before_are_no_person() -> None:
    check = WalkAround(MAX_CM, yaw_deg=0.0, upside_down=False)
    for _ in range(BASELINE_SCANS + 3 * STEADY_SCANS):
        lines = check.update(scan())
    assert check.passed is None
    assert lines == []


def test_one_who_stays_is_not_taken_as_standing_at_the_next_place() -> None:
    check = WalkAround(MAX_CM, yaw_deg=0.0, upside_down=False)
    scans = [scan()] * BASELINE_SCANS + [scan(0.0)] * STEADY_SCANS + [scan(20.0)] * (3 * STEADY_SCANS)
    seen = [line for one in scans for line in check.update(one) if line.startswith("seen")]
    assert len(seen) == 1


def test_one_who_walks_on_is_not_taken_as_standing() -> None:
    check = WalkAround(MAX_CM, yaw_deg=0.0, upside_down=False)
    for _ in range(BASELINE_SCANS):
        check.update(scan())
    assert not [line for k in range(4 * STEADY_SCANS) for line in check.update(scan(k * 10.0 % 360))]


def test_the_view_has_eight_directions_with_nothing_and_unknown_apart() -> None:
    cm = [MAX_CM + 1] * SECTORS
    cm[71], cm[18] = 90, 400
    cm[32:41] = [0xFFFF] * 9
    assert describe_view(cm, MAX_CM) == (
        "front 0.9  front right -  right 4.0  rear right -  rear ?  rear left -  left -  front left -"
    )


def test_directions_are_averaged_across_ahead() -> None:
    assert mean_deg([350.0, 20.0]) == pytest.approx(5.0)
