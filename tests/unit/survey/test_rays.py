"""Rays at tracked trunks: pooled where they end on one within the band of heights, placed by the corrected pose."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest

from companion.core.model.events import LidarScan
from companion.core.perception.landmarks.scan_pose import ScanPose
from companion.core.perception.landmarks.trunk_tracks import Trunk
from companion.survey.rays import PIECES_MAX, STEMS_MAX, UNSEEN_S, Band, RayCollector
from companion.survey.stem_rays import COLUMNS, LEFT, RAYS_MAX, RIGHT, StemRays

AXIS, RADIUS_M, UP_M = (4.0, 1.0), 0.15, 4.0
LEVEL = Band(-0.5, 0.5, by_eye=True)


def trunk_at(north_m: float, east_m: float, now_s: float) -> Trunk:
    """A good one."""
    trunk = Trunk(north_m, east_m, (1e-4, 0.0, 1e-4), RADIUS_M, now_s - 2.0)
    trunk.seen_s, trunk.sightings = now_s, 9
    return trunk


def pose_at(now_s: float, trunks: list[Trunk] | None = None, **changes: Any) -> ScanPose:
    options: dict[str, Any] = {
        "shift_ne_m": (0.0, 0.0),
        "turn_rad": 0.0,
        "to_mission_ne_m": (0.0, 0.0),
        "frame_sd_m": 1.0,
        "frame": (0.0, 0.0, 0.0),
        "airborne": True,
        "trunks": [trunk_at(*AXIS, now_s)] if trunks is None else trunks,
    }
    return ScanPose((0.0, 0.0, -UP_M), (0.0, 0.0, 0.0), **(options | changes))


def turn_of(number: int, *, range_of: Any = None, elevation_rad: float = 0.0) -> LidarScan:
    """A whole turn in one piece, 1 degree from ray to ray, of the one trunk."""
    return LidarScan(
        1, number, tuple(map(range_of or seen_m, range(360))), elevation_rad, 0.0, math.radians(1.0), 0.1, 12.0,
        0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
    )  # fmt: skip


def seen_m(k: int) -> float:
    """Range of a ray."""
    way = (math.cos(math.radians(k)), math.sin(math.radians(k)))
    along = AXIS[0] * way[0] + AXIS[1] * way[1]
    aside = AXIS[1] * way[0] - AXIS[0] * way[1]
    return along - math.sqrt(RADIUS_M**2 - aside**2) if along > 0.0 and abs(aside) < RADIUS_M else math.inf


def collected(turns: int = 3, band: Band = LEVEL, **changes: Any) -> RayCollector:
    collector = RayCollector(band, 7.0)
    for number in range(turns + 1):  # the last one places the one before
        collector.integrate(turn_of(number), pose_at(0.1 * number, **changes), 0.1 * number)
    return collector


def rows_of(stem: StemRays) -> list[tuple[float, ...]]:
    return [tuple(stem.rays[k : k + COLUMNS]) for k in range(0, len(stem.rays), COLUMNS)]


def test_rays_that_end_on_a_trunk_are_pooled_over_turns() -> None:
    (stem,) = collected(3).stems
    hits = sum(seen_m(k) < math.inf for k in range(360))
    assert stem.count == 3 * hits
    for row in rows_of(stem):
        assert math.hypot(row[0] - AXIS[0], row[1] - AXIS[1]) == pytest.approx(RADIUS_M, abs=1e-3)
        assert row[2] == pytest.approx(UP_M)


def test_the_outermost_rays_know_that_the_next_one_missed() -> None:
    (stem,) = collected(1).stems
    edges = [int(row[5]) for row in sorted(rows_of(stem), key=lambda row: math.atan2(row[1], row[0]))]
    assert edges == [LEFT, *[0] * (len(edges) - 2), RIGHT]


def test_a_ray_that_was_not_measured_is_no_edge() -> None:
    collector = RayCollector(LEVEL, 7.0)
    blind = lambda k: seen_m(k) if seen_m(k) < math.inf else math.nan  # noqa: E731
    for number in range(2):
        collector.integrate(turn_of(number, range_of=blind), pose_at(0.1 * number), 0.1 * number)
    (stem,) = collector.stems
    assert {row[5] for row in rows_of(stem)} == {0.0}


def test_what_the_turn_corrects_moves_its_own_rays() -> None:
    collector = RayCollector(LEVEL, 7.0)
    collector.integrate(turn_of(0), pose_at(0.0), 0.0)
    later = pose_at(0.1, [trunk_at(AXIS[0] + 0.2, AXIS[1], 0.1)], shift_ne_m=(0.2, 0.0))
    collector.integrate(turn_of(1), later, 0.1)
    (stem,) = collector.stems
    nearest = min(seen_m(k) * math.cos(math.radians(k)) for k in range(360) if seen_m(k) < math.inf)
    assert min(row[0] for row in rows_of(stem)) == pytest.approx(nearest + 0.2, abs=0.01)


def test_rays_below_the_band_are_left_out() -> None:
    collector = RayCollector(LEVEL, 7.0)
    for number in range(2):
        steep = turn_of(number, range_of=lambda k: seen_m(k) / math.cos(0.4), elevation_rad=-0.4)
        collector.integrate(steep, pose_at(0.1 * number), 0.1 * number)
    (stem,) = collector.stems
    assert stem.count == 0


def test_nothing_is_pooled_on_the_ground() -> None:
    assert not collected(3, airborne=False).stems


def test_a_pose_that_is_no_number_places_nothing() -> None:
    assert not collected(3, turn_rad=math.nan).stems


def test_a_stem_is_passed_when_it_has_not_been_tracked_for_a_while() -> None:
    collector = collected(3)
    assert collector.take_passed(0.4, pose_at(0.4)) == []
    (stem,) = collector.take_passed(0.4 + UNSEEN_S, pose_at(4.0, []))
    assert stem.count > 0
    assert not collector.stems


def test_all_are_passed_on_landing() -> None:
    collector = collected(3)
    assert len(collector.take_passed(0.4, pose_at(0.4, airborne=False))) == 1


def test_trunks_that_are_not_good_yet_are_none() -> None:
    young = trunk_at(*AXIS, 0.1)
    young.sightings = 1
    assert not collected(3, trunks=[young]).stems


def test_a_stems_rays_are_bounded_and_thinned_evenly() -> None:
    stem = StemRays(0.0, 0.0, 0.1, 0.0)
    for k in range(20 * RAYS_MAX):
        stem.add((float(k), *[0.0] * (COLUMNS - 1)), 0.0)
    assert stem.count < RAYS_MAX
    kept = [row[0] for row in rows_of(stem)]
    steps = [b - a for a, b in itertools.pairwise(kept)]
    assert max(steps) <= 2 * min(steps)
    assert kept[-1] > 19 * RAYS_MAX


def test_stems_and_pieces_are_bounded() -> None:
    collector = RayCollector(LEVEL, 7.0)
    many = [trunk_at(0.45 * (k % 20) - 4.0, 0.45 * (k // 20) - 4.0, 0.0) for k in range(300)]
    collector.integrate(turn_of(0), pose_at(0.0, many), 0.0)
    for _ in range(PIECES_MAX + 5):
        collector.integrate(turn_of(0), pose_at(0.0, many), 0.0)
    assert collector.lost == 6
    collector.integrate(turn_of(1), pose_at(0.0, many), 0.0)
    assert len(collector.stems) == STEMS_MAX
