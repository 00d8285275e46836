"""One vehicle's survey: where it measures, in which frame it tells, and what it does when it lands."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from companion.cloud.returns import OF_STEM, decode_returns
from companion.core.model.events import LidarScan
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.survey.alignment import JointFit
from companion.survey.observation import STEM_KIND, StemObservation, decode
from companion.survey.of_mission import survey_of
from companion.survey.surveyor import STEPS_LANDED, Surveyor
from mission.document.model import Mission
from tests.unit.survey.survey_kit import passing, rays_at, stem_of
from tests.unit.survey.test_rays import AXIS, RADIUS_M, pose_at, seen_m, trunk_at

ROUTE = {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [60.0, 0.0, 4.0], "vel_leader_mps": 2.0}


def flown(**tables: Any) -> Mission:
    return Mission.model_validate({"schema": 1, "route": ROUTE, "sensing": {"sensor": "scan-1deg"}, **tables})


def turn_from(number: int, east_m: float) -> LidarScan:
    """A turn as seen from beside the origin."""
    ranges = []
    for k in range(360):
        way = (math.cos(math.radians(k)), math.sin(math.radians(k)))
        n, e = AXIS[0], AXIS[1] - east_m
        along, aside = n * way[0] + e * way[1], e * way[0] - n * way[1]
        ranges.append(along - math.sqrt(RADIUS_M**2 - aside**2) if along > 0.0 and abs(aside) < RADIUS_M else math.inf)
    return LidarScan(
        1, number, tuple(ranges), 0.0, 0.0, math.radians(1.0), 0.1, 12.0, 0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    )


def measured(
    *,
    up_m: float = 4.0,
    offset_ne_m: tuple[float, float] = (0.0, 0.0),
    standing_ne_m: tuple[float, float] | None = None,
    stands: range = range(60),
    drift_m: float = 0.0,
    surveyor: Surveyor | None = None,
) -> list[StemObservation | None]:
    """Stems told after a flight past the one trunk, and a landing. A vehicle `stands` in these turns, and its place
    drifts from one to the next."""
    surveyor = surveyor or Surveyor(flown(survey={}), 7)
    bodies: list[tuple[int, bytes]] = []
    for number in range(60):
        now_s, east_m = 0.1 * number, 0.1 * number - 2.0
        pose = ScanPose(
            (0.0, east_m, -up_m),
            (0.0, 0.0, 0.0),
            shift_ne_m=(0.0, 0.0),
            turn_rad=0.0,
            to_mission_ne_m=offset_ne_m,
            frame_sd_m=1.0,
            airborne=True,
            frame=(0.0, 0.0, 0.0),
            trunks=[trunk_at(*AXIS, now_s)],
            standing_ne_m=[
                (n + drift_m * number, e)
                for n, e in ([] if standing_ne_m is None or number not in stands else [standing_ne_m])
            ],
        )
        surveyor.integrate(turn_from(number, east_m), pose, now_s)
        bodies += surveyor.take_records(pose, now_s)
    bodies += surveyor.take_records(pose_at(6.1, airborne=False, to_mission_ne_m=offset_ne_m), 6.1)
    return [decode(body, 7) for kind, body in bodies if kind == STEM_KIND]


def test_a_mission_without_survey_has_none() -> None:
    assert survey_of(flown(), 1) is None
    with pytest.raises(ValueError, match=r"no \[survey\]"):
        Surveyor(flown(), 1)


def test_a_stem_in_sight_is_told_on_landing() -> None:
    (stem,) = measured()
    assert stem is not None
    assert stem.vehicle_id == 7
    assert stem.diameter_m == pytest.approx(2.0 * RADIUS_M, abs=0.04)  # the kit has rays without a width
    assert (stem.north_m, stem.east_m) == pytest.approx(AXIS, abs=0.03)
    assert 0.0 < stem.first_s < 1.0
    assert 5.0 < stem.last_s < 6.0


def test_places_are_told_in_the_missions_frame() -> None:
    (stem,) = measured(offset_ne_m=(30.0, -5.0))
    assert stem is not None
    assert (stem.north_m, stem.east_m) == pytest.approx((AXIS[0] + 30.0, AXIS[1] - 5.0), abs=0.03)


def test_nothing_is_measured_below_the_fence() -> None:
    assert measured(up_m=1.9) == []


@pytest.mark.parametrize("stands", [range(60), range(5), range(55, 60)], ids=["all along", "first", "last"])
def test_where_a_vehicle_stands_in_the_air_no_stem_is_recorded(stands: range) -> None:
    assert measured(standing_ne_m=(AXIS[0] + 0.9, AXIS[1] - 0.9), stands=stands) == []


def test_a_place_that_drifts_off_was_there_while_the_stem_was_in_sight() -> None:
    assert measured(standing_ne_m=(AXIS[0] + 0.9, AXIS[1] - 0.9), drift_m=0.05) == []


def test_a_stem_two_metres_from_a_vehicle_that_stands_is_recorded() -> None:
    assert len(measured(standing_ne_m=(AXIS[0] + 2.0, AXIS[1]))) == 1


def test_the_kit_sees_one_trunk() -> None:
    assert 3 < sum(seen_m(k) < math.inf for k in range(360)) < 7


def test_stems_of_too_few_rays_are_dropped_when_nothing_else_is_in_sight() -> None:
    surveyor = Surveyor(flown(survey={}), 7)
    for number in range(2):  # two turns: fewer rays than a fit needs
        surveyor.integrate(turn_from(number, 0.0), pose_at(0.1 * number), 0.1 * number)
    assert surveyor.collector.stems
    for now_s in (0.3, 4.0, 11.0):  # in the air: not tracked for 3 s, then 6 s of waiting for others
        for kind, _ in surveyor.take_records(pose_at(now_s, []), now_s):
            assert kind != STEM_KIND
    assert not surveyor.collector.stems


def test_the_returns_of_a_stem_are_where_its_record_has_it() -> None:
    surveyor = Surveyor(flown(survey={}), 7, keeps_returns=True)
    (stem,) = measured(offset_ne_m=(100.0, -50.0), surveyor=surveyor)
    assert stem is not None
    (one,) = map(decode_returns, surveyor.take_returns())
    assert one is not None
    assert decode(one.body, one.vehicle_id) == stem
    points = one.points[one.points["flags"] == OF_STEM]
    assert len(points) > 50
    off_n, off_e = one.north_m + points["north_m"] - stem.north_m, one.east_m + points["east_m"] - stem.east_m
    assert np.abs(np.hypot(off_n, off_e) - RADIUS_M).max() < 0.03
    assert np.all(np.abs(points["up_m"] - 4.0) < 0.6)
    assert np.all((points["at_s"] >= 0.0) & (points["at_s"] <= 6.1))
    assert set(points["ring"].tolist()) == {0}
    assert one.ground_up_m is None  # a level lidar does not see it
    assert surveyor.take_returns() == []


def test_many_stems_at_a_landing_are_told_within_seconds_a_few_steps_of_the_fit_a_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All in one tick took up to 1.5 s, and systemd ends a companion that is silent for so long."""
    steps: list[float] = []  # times

    def counted(fit: JointFit) -> Iterator[None]:
        for step in plain(fit):
            steps.append(now_s)
            yield step

    plain = JointFit.steps
    monkeypatch.setattr(JointFit, "steps", counted)
    surveyor, many = Surveyor(flown(survey={}), 7, keeps_returns=True), 30
    rays = rays_at(lambda _: 0.15, passing(scans=20), np.random.default_rng(1))
    surveyor._passed.extend(stem_of(array("f", rays), (0.05, -0.05, 0.15)) for _ in range(many))
    told: dict[float, int] = {}
    for tick in range(100):
        now_s = 0.05 * tick
        told[now_s] = sum(kind == STEM_KIND for kind, _ in surveyor.take_records(pose_at(now_s, airborne=False), now_s))
        assert len(surveyor.take_returns()) <= STEPS_LANDED
    assert sum(told.values()) == many
    assert max(Counter(steps).values()) == STEPS_LANDED
    assert max(steps) < many * 10 / STEPS_LANDED * 0.05


def test_what_is_measured_is_the_same_with_returns_and_without() -> None:
    keeps, plain = Surveyor(flown(survey={}), 7, keeps_returns=True), Surveyor(flown(survey={}), 7)
    assert measured(surveyor=keeps) == measured(surveyor=plain)
    assert plain.take_returns() == []
