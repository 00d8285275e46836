"""Trunks shared between vehicles: what is remembered and told, and what neighbours' ones are good for."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_denied.ranging import RangingLocaliser
from companion.core.localisation.gnss_denied.shared_trunks import (
    FORGOTTEN_M,
    REMEMBERED_MAX,
    TELLS_MAX,
    SharedTrunks,
)
from companion.core.model.beacon import RelativeReport, ToldTrunk, TrunkReport
from companion.core.model.events import Position
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.perception.test_constellation import stand
from tests.unit.core.ranging_kit import STARTS, ranging_mission

ME, OTHER = 1, 2
AT = {k: enu_to_ned(place) for k, place in enumerate(STARTS, start=1)}
UNTURNED = (0.0, 0.0, 0.0)


def looked(
    trunks: list[ToldTrunk], at: Level = (0.0, 0.0), frame: tuple[float, float, float] = UNTURNED
) -> SharedTrunks:
    shared = SharedTrunks()
    shared.note_trunks(SolitaryTrunks(trunks, at, frame), at, 1.0)
    return shared


def test_the_nearest_twelve_and_the_next_are_told_in_turn_once_a_second() -> None:
    trunks = stand(Random(1), 30)
    report = looked(trunks, (2.0, 1.0)).make_report(ME, 7, 1.0)
    assert report is not None
    assert (report.sender, report.time_ms, report.odo_ne_m, len(report.trunks)) == (ME, 7, (2.0, 1.0), TELLS_MAX)
    about = sorted((n - 2.0, e - 1.0, d) for n, e, d in trunks)
    away_m = sorted(math.hypot(n, e) for n, e, _ in about)
    assert [math.hypot(n, e) for n, e, _ in report.trunks] == pytest.approx(away_m[:TELLS_MAX])

    shared = looked(trunks, (2.0, 1.0))
    reports = [shared.make_report(ME, 7, 1.0)]
    shared.note_trunks(SolitaryTrunks(trunks, (2.0, 1.0), UNTURNED), (2.0, 1.0), 2.0)
    reports.append(shared.make_report(ME, 9, 2.0))
    both = [one for report in reports if report is not None for one in report.trunks]
    assert [math.hypot(n, e) for n, e, _ in both] == pytest.approx(away_m[: 2 * TELLS_MAX])

    shared = looked(trunks)
    told = []
    for k in range(60):
        now_s = 1.0 + 0.1 * k
        if shared.is_due(now_s):
            shared.note_trunks(SolitaryTrunks(trunks, (0.0, 0.0), UNTURNED), (0.0, 0.0), now_s)
        told.append(shared.make_report(ME, k, now_s) is not None)
    assert sum(told) == 6


def test_too_few_are_not_told_and_nothing_without_a_look() -> None:
    assert looked(stand(Random(1), 5)).make_report(ME, 7, 1.0) is None
    assert looked(stand(Random(1), 30)).make_report(ME, 7, 3.0) is None
    assert SharedTrunks().make_report(ME, 7, 1.0) is None


def test_what_is_remembered_is_bounded_and_forgotten_with_the_way() -> None:
    shared = SharedTrunks()
    for k in range(REMEMBERED_MAX):
        seen = [(3.0 * k, 0.0, 0.3), (3.0 * k, 4.0, 0.3)]
        shared.note_trunks(SolitaryTrunks(seen, (3.0 * k, 2.0), UNTURNED), (3.0 * k, 2.0), float(k))
    assert len(shared._known) <= 2 * FORGOTTEN_M / 3.0 + 2
    shared.note_trunks(SolitaryTrunks(stand(Random(1), 300, 60.0), (3.0 * k, 2.0), UNTURNED), (0.0, 0.0), 999.0)
    assert len(shared._known) == REMEMBERED_MAX


def test_trunks_from_before_a_time_without_sight_are_forgotten_as_after_a_way() -> None:
    """The odometer drifted meanwhile, by more than by flying on among trunks."""
    shared = looked([(5.0, 0.0, 0.3)])
    shared.note_trunks(SolitaryTrunks([], (0.0, 0.0), UNTURNED), (0.0, 0.0), 5.0)
    assert len(shared._known) == 1
    shared.note_trunks(SolitaryTrunks([(0.0, 5.0, 0.3)], (0.0, 0.0), UNTURNED), (0.0, 0.0), 25.0)
    assert [one.east_m for one in shared._known] == [5.0]


def test_a_trunk_that_is_seen_again_is_where_it_is_seen_last() -> None:
    shared = looked([(5.0, 0.0, 0.3)])
    shared.note_trunks(SolitaryTrunks([(5.2, 0.1, 0.32)], (0.0, 0.0), UNTURNED), (0.0, 0.0), 2.0)
    assert [(one.north_m, one.east_m, one.diameter_m) for one in shared._known] == [(5.2, 0.1, 0.32)]


def test_what_is_remembered_turns_with_the_frame() -> None:
    shared = looked([(5.0, 0.0, 0.3)])
    shared.note_trunks(SolitaryTrunks([], (0.0, 0.0), (math.pi / 2.0, 1.0, 2.0)), (0.0, 0.0), 2.0)
    (one,) = shared._known
    assert (one.north_m, one.east_m) == pytest.approx((1.0, 7.0))


class Hover:
    """Vehicle 1 and the others, at rest: each where the mission puts it, but for what `off` says; with ranges."""

    def __init__(self, off: dict[int, Vec3], *, seed: int = 1) -> None:
        self.at = {k: (AT[k][0] + off.get(k, (0, 0, 0))[0], AT[k][1] + off.get(k, (0, 0, 0))[1], -4.0) for k in AT}
        self.trunks = stand(Random(seed), 40, 16.0)
        self.here = RangingLocaliser(ranging_mission(), ME)
        self.shared = SharedTrunks()
        self.now_s = 0.0
        self.measured = 0

    def report(self, told: list[ToldTrunk]) -> TrunkReport:
        return TrunkReport(OTHER, round(1e3 * self.now_s), (0.0, 0.0), tuple(told))

    def told(self, off: Level = (0.0, 0.0)) -> list[ToldTrunk]:
        """The truth about the other; `off`: it lies by so much about where it is."""
        n, e = self.at[OTHER][0] + off[0], self.at[OTHER][1] + off[1]
        about = [(a - n, b - e, d) for a, b, d in self.trunks]
        return sorted(about, key=lambda one: math.hypot(one[0], one[1]))[:TELLS_MAX]

    def hover(self, seconds: float, told: list[ToldTrunk] | None, *, measures: bool = True, sees: bool = True) -> None:
        """`told`: each second, by the other; `sees`: trunks itself."""
        me = self.at[ME]
        for _ in range(round(seconds / 0.05)):
            self.now_s += 0.05
            tick = round(self.now_s / 0.05)
            self.here.update_odometry(Position((AT[ME][0], AT[ME][1], -4.0), (0.0, 0.0, 0.0)), self.now_s)
            if tick % 2 == 0:
                for k in (2, 3, 4):
                    self.here.receive_report(
                        RelativeReport(k, tick, (0.0, 0.0)), (0.0, 0.0, 0.0), -4.0, self.now_s, age_s=0.05
                    )
                if measures:
                    ranges = tuple((k, math.dist(me, self.at[k]), 0.0) for k in (2, 3, 4))
                    self.here.receive_ranges(ranges, self.now_s)
            if tick % 10 == 0 and sees:
                seen = [(a - me[0], b - me[1], d) for a, b, d in self.trunks]
                self.shared.note_trunks(SolitaryTrunks(seen, (0.0, 0.0), UNTURNED), (0.0, 0.0), self.now_s)
            if tick % 20 == 5 and told is not None:
                self.measured += self.shared.receive_report(self.report(told), self.here, self.now_s) is not None
            self.here.advance(self.now_s)

    def off_m(self) -> float:
        """By how much it is wrong about the other."""
        found = self.here.filter.relative(OTHER)
        assert found is not None
        there = (self.at[OTHER][0] - self.at[ME][0], self.at[OTHER][1] - self.at[ME][1])
        return math.dist(found.ne_m, there)


OFF: dict[int, Vec3] = {OTHER: (0.7, 0.2, 0.0), 3: (-0.4, 0.3, 0.0)}


def test_a_neighbour_is_placed_by_trunks_to_a_decimetre() -> None:
    without, shared = Hover(OFF), Hover(OFF)
    without.hover(12.0, None)
    shared.hover(12.0, shared.told())
    assert shared.measured >= 9
    assert shared.off_m() < 0.1
    assert shared.off_m() < 0.5 * without.off_m()


def test_one_that_sees_no_trunks_itself_is_placed_among_none_that_others_tell() -> None:
    """Its own place among those that it remembers goes on by an odometer that nothing corrects."""
    flight = Hover({})
    flight.hover(6.0, flight.told())
    before = flight.measured
    assert before > 3
    flight.hover(30.0, flight.told(), sees=False)
    assert flight.measured <= before + 2
    before = flight.measured
    flight.hover(6.0, flight.told())
    assert flight.measured > before + 3


def test_one_message_alone_counts_for_nothing() -> None:
    flight = Hover(OFF)
    flight.hover(1.0, flight.told())
    assert flight.measured == 0


def test_two_that_disagree_count_for_nothing() -> None:
    flight = Hover(OFF)
    for k in range(6):
        flight.hover(1.0, flight.told((0.5 * (-1) ** k, 0.0)))
    assert flight.measured == 0


def test_the_own_turn_is_found_too() -> None:
    """The other's compass is off by 3 degrees: ranges at rest see nothing of that."""
    flight = Hover({})
    turn = math.radians(3.0)
    c, s = math.cos(turn), math.sin(turn)
    flight.hover(12.0, [(c * n + s * e, -s * n + c * e, d) for n, e, d in flight.told()])
    between = flight.here.filter.compass_of(OTHER) - flight.here.filter.compass[0]
    assert between == pytest.approx(turn, abs=math.radians(0.5))


def test_a_message_is_aligned_together_with_the_one_before() -> None:
    """Four trunks of each: neither alone is enough."""
    flight = Hover(OFF)
    near = flight.told()
    for k in range(8):
        flight.hover(1.0, near[k % 2 : 8 : 2])
    assert flight.measured >= 5


def test_trunks_put_no_neighbour_farther_than_the_own_radio_measures() -> None:
    """A liar that is 8 m away says that it is 2 m farther."""
    flight = Hover({})
    flight.hover(12.0, flight.told((0.0, 2.0)))
    assert flight.measured == 0
    assert flight.off_m() < 0.3
    located = flight.here.locate_peer(OTHER, -4.0, flight.now_s)
    assert located is not None
    assert math.hypot(*located[1][:2]) <= 8.0


def test_a_liar_moves_nobody_farther_than_the_own_radio_measures() -> None:
    """It says that it is as far off, but 2.5 m aside."""
    flight = Hover({})
    flight.hover(10.0, None)
    flight.hover(10.0, flight.told((2.5, -0.4)))
    for other in (OTHER, 3, 4):
        range_m = math.dist(flight.at[ME], flight.at[other])
        located = flight.here.locate_peer(other, -4.0, flight.now_s)
        assert located is not None
        assert math.hypot(*located[0][:2]) <= range_m + 0.2
        assert math.hypot(*located[1][:2]) <= range_m + 1e-6  # which is what is kept clear of


def test_one_that_the_own_radio_does_not_measure_is_placed_by_no_trunks() -> None:
    """Where it is among its trunks is its word alone."""
    flight = Hover({})
    flight.hover(10.0, None)
    flight.hover(3.0, flight.told(), measures=False)
    assert flight.measured == 0
    flight.hover(5.0, flight.told())
    assert flight.measured > 0


def test_a_neighbour_that_is_not_known_well_is_not_searched_for() -> None:
    flight = Hover({})
    flight.here.filter.add_peer(OTHER, (0.0, 8.0), 4.0)
    flight.hover(3.0, flight.told(), measures=False)
    assert flight.measured == 0


def test_an_odometer_that_began_anew_since_is_not_compared() -> None:
    flight = Hover({})
    flight.hover(2.0, None)
    report = TrunkReport(OTHER, 1, (60.0, 0.0), tuple(flight.told()))
    for _ in range(3):
        flight.now_s += 1.0
        assert flight.shared.receive_report(report, flight.here, flight.now_s) is None


def test_trunks_are_shared_where_raw_scans_and_ranges_are() -> None:
    raw = {"sensor": "scan-1deg", "range_m": 12.0}
    assert ranging_mission(sensing=raw).shares_trunks
    assert not ranging_mission(sensing={"range_m": 8.0}).shares_trunks
    assert not ranging_mission().shares_trunks
    assert not ranging_mission(sensing=raw, swarm={"gnss": "all"}).shares_trunks
    assert GnssDeniedLocaliser(ranging_mission(sensing=raw), ME).trunks is not None
    without = GnssDeniedLocaliser(ranging_mission(), ME)
    assert without.trunks is None
    assert not without.is_due_for_trunks(1.0)
