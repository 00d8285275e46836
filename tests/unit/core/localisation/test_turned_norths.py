"""A neighbour whose trunks' north is turned in flight, as scans correct its heading, is followed by its alignments."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.gnss_denied.error_state import BY_TRUNKS, Level
from companion.core.localisation.gnss_denied.relative_filter import RelativeFilter
from companion.core.perception.landmarks.constellation import Alignment, turned

DT_S = 0.05
SPEED_MPS = 3.0
PLACE: Level = (6.0, 4.0)  # of the neighbour, from this vehicle, throughout: both fly north at the same speed


class Pair:
    """This vehicle and its neighbour, which trunks align once a second."""

    def __init__(self, *, is_sure: bool = False) -> None:
        """`is_sure`: the neighbour has satellites."""
        self.joint, self.now_s = RelativeFilter(BY_TRUNKS), 0.0
        self.joint.initialise({2: PLACE}, 0.3, sure=(2,) if is_sure else ())
        self.own: Level = (0.0, 0.0)
        self.its: Level = (0.0, 0.0)

    def fly(self, seconds: float, turned_rad: float, aside_m: float = 0.0) -> None:
        """`turned_rad`: of its odometer's axes against the own; `aside_m`: by which its trunks have it aside."""
        joint = self.joint
        way = turned(-turned_rad, SPEED_MPS, 0.0)
        for tick in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.own = (self.own[0] + SPEED_MPS * DT_S, self.own[1])
            self.its = (self.its[0] + way[0] * DT_S, self.its[1] + way[1] * DT_S)
            for vehicle in (None, 2):
                joint.note_trunks(vehicle, self.now_s)
            joint.update_odometry(self.own, (SPEED_MPS, 0.0), self.now_s)
            joint.update_peer_odometry(2, self.its, way, 0.0, self.now_s)
            if tick % 20 == 0:
                here = (self.own[0] + PLACE[0], self.own[1] + PLACE[1] + aside_m)
                found = Alignment(self.its, here, turned_rad, position_sd_m=0.08, turn_sd_rad=0.005, matched=9)
                joint.add_alignment(2, found)
            joint.advance(self.now_s)

    @property
    def off_m(self) -> float:
        found = self.joint.relative(2)
        assert found is not None
        return math.dist(found.ne_m, PLACE)


@pytest.mark.parametrize("by_deg", [-4.2, 4.2, 7.0])
def test_alignments_that_fit_but_for_the_turn_turn_a_neighbour(by_deg: float) -> None:
    """A leader's north turned by 4.2 degrees as it set out; two followers took it 10 m aside (trunks_alone, 2000)."""
    pair = Pair()
    pair.fly(20.0, 0.0)
    assert pair.off_m < 0.1
    pair.fly(8.0, math.radians(by_deg))
    assert math.degrees(pair.joint.compass_of(2) - pair.joint.compass[0]) == pytest.approx(by_deg, abs=0.5)
    assert pair.off_m < 0.3


def test_the_north_of_one_with_satellites_is_right_and_that_of_all_others_is_turned() -> None:
    """Its scans correct its heading by them: else the formation stays turned, by 0.5 m at 8 m (trunks_alone, 2000)."""
    pair = Pair(is_sure=True)
    pair.fly(20.0, 0.0)
    pair.fly(8.0, math.radians(4.2))
    own_rad, found = pair.joint.compass[0], pair.joint.relative(2)
    assert found is not None
    assert math.degrees(pair.joint.compass_of(2)) == pytest.approx(0.0, abs=0.7)
    assert math.degrees(own_rad) == pytest.approx(-4.2, abs=0.7)
    assert math.dist(found.ne_m, turned(own_rad, *PLACE)) < 0.3


def test_a_turn_that_is_told_for_a_moment_turns_nobody() -> None:
    pair = Pair()
    pair.fly(20.0, 0.0)
    pair.fly(2.0, math.radians(4.2))  # two alignments
    pair.fly(5.0, 0.0)
    assert math.degrees(pair.joint.compass_of(2) - pair.joint.compass[0]) == pytest.approx(0.0, abs=0.5)


def test_turns_that_are_not_in_a_row_turn_nobody() -> None:
    """Each third fits, or fits neither in place: a north that was turned stays so."""
    for between_rad, aside_m in ((0.0, 0.0), (math.radians(4.2), 8.0)):
        pair = Pair()
        pair.fly(20.0, 0.0)
        for _ in range(2):
            pair.fly(2.0, math.radians(4.2))
            pair.fly(1.0, between_rad, aside_m)
        assert abs(math.degrees(pair.joint.compass_of(2) - pair.joint.compass[0])) < 0.5


def test_a_neighbour_that_is_told_aside_is_turned_by_nothing() -> None:
    """It fits neither in place: so no liar moves itself sooner than the filter's own uncertainty lets it."""
    pair = Pair()
    pair.fly(20.0, 0.0)
    pair.fly(5.0, math.radians(4.2), aside_m=3.0)
    assert abs(math.degrees(pair.joint.compass_of(2) - pair.joint.compass[0])) < 0.5
