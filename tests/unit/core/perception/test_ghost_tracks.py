"""Silent vehicles whose place is seen to be empty are obstacles no more."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.events import ObstacleScan, Position
from companion.core.model.vectors import ZERO
from companion.core.perception.obstacle_map import ObstacleMap
from companion.core.perception.vehicles.ghost_tracks import EMPTY_S, SAME_WORD_S, GhostTracks
from mission.common.frames import Vec3

HERE: Vec3 = (3.0, 4.0, -8.0)
SECTORS, RANGE_M, PERIOD_S = 72, 8.0, 0.1
THERE: Vec3 = (5.0, 0.0, 0.2)  # where vehicle 2 is taken to hang
NORTH = range(-3, 4)  # sectors


def ranges(**seen_m: float) -> tuple[float, ...]:
    """Nothing anywhere, but north what is given as `north`, or as `hidden`: one that has not been measured there."""
    found = [math.inf] * SECTORS
    for sector in NORTH:
        found[sector] = seen_m.get("north", math.inf)
    return tuple(found)


def left(
    seconds: float,
    scan: tuple[float, ...] = ranges(),
    *,
    rel_ned_m: Vec3 = THERE,
    told: bool = False,
    every_height: bool = False,
    heard_again_s: float | None = None,
    looks_away_s: tuple[float, float] = (math.inf, math.inf),
    pitch_deg: float = 0.0,
    reported: tuple[Vec3, ...] = (),
) -> set[int]:
    """Which are still obstacles after so long under such scans. `looks_away_s`: from when to when it does not look."""
    ghosts, seen, now_s = GhostTracks(), ObstacleMap(), 100.0
    found: dict[int, PeerReport] = {}
    heard_s = now_s - 2.0
    for tick in range(round(seconds / PERIOD_S)):
        now_s += PERIOD_S
        taken = ObstacleScan(196, scan, 0.0, math.tau / SECTORS, 0.2, RANGE_M, pitch_rad=math.radians(pitch_deg))
        seen.integrate_scan(taken, Position(HERE, ZERO), now_s)
        if heard_again_s is not None and tick * PERIOD_S >= heard_again_s:
            heard_s = 100.0 + heard_again_s
        silent = {2: PeerReport(2, rel_ned_m, now_s - heard_s, silent=True, received=told, every_height=every_height)}
        if looks_away_s[0] <= tick * PERIOD_S < looks_away_s[1]:
            continue
        found = ghosts.clear(silent, seen, HERE, now_s, fresh_s=0.3, reported=reported)
    return set(found)


def test_place_that_is_seen_empty_for_a_while_is_no_obstacle_any_more() -> None:
    assert left(EMPTY_S - 0.1) == {2}
    assert left(EMPTY_S + 0.3) == set()


def test_beside_a_reported_neighbour_no_place_is_seen_empty() -> None:
    """Hits there are left out of the map as that neighbour's: by its word alone one that hovers would be gone."""
    beside = (THERE[0] + 1.0, THERE[1] + 1.0, THERE[2])
    assert left(EMPTY_S + 0.3, reported=(beside,)) == {2}
    far = (THERE[0] + 9.0, THERE[1], THERE[2])
    assert left(EMPTY_S + 0.3, reported=(far,)) == set()


def test_one_that_hangs_there_is_seen_and_stays_an_obstacle_for_good() -> None:
    assert left(60.0, ranges(north=4.7)) == {2}


def test_what_stands_before_the_place_hides_it() -> None:
    assert left(60.0, ranges(north=2.0)) == {2}


@pytest.mark.parametrize(("pitch_deg", "still"), [(0.0, set()), (-2.0, set()), (-6.0, {2}), (6.0, {2}), (-15.0, {2})])
def test_vehicle_that_leans_looks_over_or_under_the_place(pitch_deg: float, still: set[int]) -> None:
    assert left(60.0, pitch_deg=pitch_deg) == still


def test_bearing_that_was_not_measured_shows_nothing() -> None:
    assert left(60.0, ranges(north=math.nan)) == {2}


@pytest.mark.parametrize("rel_ned_m", [(5.0, 0.0, 1.5), (5.0, 0.0, -1.5), (7.9, 0.0, 0.0), (20.0, 0.0, 0.0)])
def test_above_below_and_beyond_the_sensors_range_nothing_is_seen(rel_ned_m: Vec3) -> None:
    assert left(60.0, rel_ned_m=rel_ned_m) == {2}


def test_one_on_its_way_up_or_down_and_one_that_others_tell_of_stay_obstacles() -> None:
    assert left(60.0, every_height=True) == {2}
    assert left(60.0, told=True) == {2}


def test_one_that_is_heard_again_and_falls_silent_anew_is_an_obstacle_anew() -> None:
    assert left(10.1, heard_again_s=10.0) == {2}


def test_silence_is_looked_at_anew_though_others_were_silent_meanwhile() -> None:
    ghosts, seen, kept = GhostTracks(), ObstacleMap(), {}
    for tick in range(110):
        now_s = 100.0 + tick * PERIOD_S
        seen.integrate_scan(
            ObstacleScan(196, ranges(), 0.0, math.tau / SECTORS, 0.2, RANGE_M), Position(HERE, ZERO), now_s
        )
        silent = {3: PeerReport(3, (20.0, 0.0, 0.0), now_s, silent=True)}
        if tick < 3 or tick >= 108:  # heard in between
            silent[2] = PeerReport(2, THERE, 0.1, silent=True)
        kept = ghosts.clear(silent, seen, HERE, now_s, fresh_s=0.3)
    assert set(kept) == {2, 3}


def test_word_of_others_that_is_a_little_newer_does_not_bring_it_back() -> None:
    ghosts, seen, kept = GhostTracks(), ObstacleMap(), {}
    for tick in range(20):
        now_s = 100.0 + tick * PERIOD_S
        seen.integrate_scan(
            ObstacleScan(196, ranges(), 0.0, math.tau / SECTORS, 0.2, RANGE_M), Position(HERE, ZERO), now_s
        )
        told = tick >= 10
        heard_s = 98.0 + SAME_WORD_S - 0.1 if told else 98.0
        silent = {2: PeerReport(2, THERE, now_s - heard_s, silent=True, received=told)}
        kept = ghosts.clear(silent, seen, HERE, now_s, fresh_s=0.3)
    assert kept == {}
    assert set(
        ghosts.clear({2: PeerReport(2, THERE, 1.0, silent=True, received=True)}, seen, HERE, 102.0, fresh_s=0.3)
    ) == {2}


def test_look_that_is_broken_off_begins_anew() -> None:
    assert left(10.1, looks_away_s=(0.3, 10.0)) == {2}
    assert left(10.3 + EMPTY_S, looks_away_s=(0.3, 10.0)) == set()


def test_place_behind_a_closed_wall_bars_no_way_and_one_behind_a_trunk_does() -> None:
    def kept(*trunks: int) -> set[int]:
        """With something 3 m away in those sectors."""
        found = [3.0 if sector in trunks or sector - SECTORS in trunks else math.inf for sector in range(SECTORS)]
        return left(EMPTY_S - 0.1, tuple(found))

    assert kept(*range(-9, 10)) == set()
    assert kept(*range(-9, 10, 2)) == set()  # shadows between their trunks
    assert kept(-1, 0, 1) == {2}
    assert kept(*range(-9, 2)) == {2}  # the end of the wall
    assert kept(*range(-9, -1), *range(2, 10)) == {2}  # a gap


def test_place_that_is_seen_empty_leaves_the_others_of_which_members_tell() -> None:
    ghosts, seen, now_s, elsewhere = GhostTracks(), ObstacleMap(), 100.0, ((0.0, 5.0, 0.0), (-6.0, 0.0, 0.0))
    for _ in range(round((EMPTY_S + 0.3) / PERIOD_S)):
        now_s += PERIOD_S
        seen.integrate_scan(
            ObstacleScan(196, ranges(), 0.0, math.tau / SECTORS, 0.2, RANGE_M), Position(HERE, ZERO), now_s
        )
        silent = {2: PeerReport(2, THERE, now_s - 98.0, silent=True, elsewhere=elsewhere)}
        (found,) = ghosts.clear(silent, seen, HERE, now_s, fresh_s=0.3).values()
    assert (found.rel_ned_m, found.elsewhere, found.received) == (elsewhere[0], elsewhere[1:], True)
