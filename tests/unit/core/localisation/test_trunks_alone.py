"""Vehicles without range radios: places, starts and a search anew, by trunks alone."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.localisation.gnss_denied.ranging import FOUND, RangingLocaliser
from companion.core.localisation.gnss_denied.shared_trunks import TELLS_MAX, SharedTrunks
from companion.core.model.beacon import RelativeReport, TrunkReport
from companion.core.model.events import Position
from companion.core.model.states import LandedState
from companion.core.perception.landmarks.solitary_trunks import SolitaryTrunks
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.perception.test_constellation import stand
from tests.unit.core.ranging_kit import STARTS, ranging_mission

LEADER, ME = 1, 2
AT = {k: enu_to_ned(place) for k, place in enumerate(STARTS, start=1)}
UNTURNED = (0.0, 0.0, 0.0)
STILL: Vec3 = (0.0, 0.0, 0.0)
MISSION = ranging_mission(
    ranging={"radio": False},
    sensing={"sensor": "scan-1deg", "range_m": 12.0},
    forest={"stand": {"density_per_ha": 400.0}},
)


class Follower:
    """Vehicle 2 hovers, and so do the others: each where the mission puts it, but for what `off` says; no ranges."""

    def __init__(self, off: dict[int, Level], *, away: bool = False) -> None:
        self.at = {k: (AT[k][0] + off.get(k, (0, 0))[0], AT[k][1] + off.get(k, (0, 0))[1]) for k in AT}
        self.trunks = stand(Random(3), 60, 20.0)
        self.here, self.shared = RangingLocaliser(MISSION, ME), SharedTrunks()
        self.now_s, self.measured, self.said = 0.0, 0, ""
        self.here.update_landed_state(LandedState.IN_AIR if away else LandedState.ON_GROUND, waits=True)
        self.here.update_landed_state(LandedState.IN_AIR, waits=False)

    def told(self, sender: int, off: Level = (0.0, 0.0)) -> TrunkReport:
        """`off`: so far from where it is the sender puts itself."""
        n, e = self.at[sender][0] + off[0], self.at[sender][1] + off[1]
        about = sorted([(a - n, b - e, d) for a, b, d in self.trunks], key=lambda one: math.hypot(one[0], one[1]))
        return TrunkReport(sender, round(1e3 * self.now_s), (0.0, 0.0), tuple(about[:TELLS_MAX]))

    def hover(self, seconds: float, tells: tuple[int, ...], *, off: Level = (0.0, 0.0), knows: bool = True) -> None:
        """`tells`: who tells its trunks; `knows`: these tell where they have the leader."""
        me = self.at[ME]
        for _ in range(round(seconds / 0.05)):
            self.now_s += 0.05
            tick = round(self.now_s / 0.05)
            self.here.update_odometry(Position((AT[ME][0], AT[ME][1], -4.0), STILL), self.now_s)
            if tick % 2 == 0:
                for k in (1, 3, 4):
                    leads = k == LEADER or k not in tells or not knows
                    to = (self.at[1][0] - self.at[k][0], self.at[1][1] - self.at[k][1])
                    word = RelativeReport(k, tick, (0.0, 0.0), None if leads else to, 0.3)
                    leader = LEADER if knows else 0
                    self.here.receive_report(word, STILL, -4.0, self.now_s, age_s=0.05, leader=leader)
            if tick % 10 == 0:
                seen = [(a - me[0], b - me[1], d) for a, b, d in self.trunks]
                self.shared.note_trunks(SolitaryTrunks(seen, (0.0, 0.0), UNTURNED), (0.0, 0.0), self.now_s)
            if tick % 20 == 5:
                for k in tells:
                    found = self.shared.receive_report(self.told(k, off), self.here, self.now_s)
                    self.measured += found is not None
            self.said += self.here.advance(self.now_s)

    def off_m(self, vehicle: int) -> float:
        """By how much it is wrong about that one."""
        found = self.here.filter.relative(vehicle)
        assert found is not None
        return math.dist(found.ne_m, (self.at[vehicle][0] - self.at[ME][0], self.at[vehicle][1] - self.at[ME][1]))


def test_neighbours_are_placed_to_a_decimetre_and_the_start_position_is_confirmed() -> None:
    flight = Follower({1: (0.7, 0.2), 3: (-0.4, 0.3)})
    assert flight.here.is_doubtful
    flight.hover(12.0, (1, 3))
    assert flight.measured >= 18
    assert max(flight.off_m(1), flight.off_m(3)) < 0.1
    assert not flight.here.is_doubtful
    assert flight.said == ""


def test_without_alignments_the_start_is_not_confirmed_and_neighbours_become_uncertain() -> None:
    flight = Follower({})
    flight.hover(10.0, ())
    assert flight.here.is_doubtful
    assert flight.here.locate_peer(1, -4.0, flight.now_s) is not None
    assert not flight.here.uncertain_peers
    flight.hover(80.0, ())
    located = flight.here.locate_peer(1, -4.0, flight.now_s)
    assert located is not None
    assert flight.here.uncertain_peers == {1}
    assert math.hypot(*located[1][:2]) == pytest.approx(0.5 * math.hypot(*located[0][:2]))


def test_one_that_does_not_know_where_the_leader_is_confirms_nothing() -> None:
    flight = Follower({})
    flight.hover(10.0, (3,), knows=False)
    assert flight.measured > 0
    assert flight.here.is_doubtful


@pytest.mark.parametrize("off", [(0.0, -16.0), (8.0, -8.0)], ids=["swapped", "turned"])
def test_a_wrong_start_position_is_corrected(off: Level) -> None:
    """The leader stands elsewhere than the mission says, seen from here."""
    flight = Follower({1: off, 3: off, 4: off})
    flight.hover(8.0, (1,))
    assert flight.said == "start positions wrong: vehicle 1 found elsewhere"
    assert not flight.here.is_doubtful
    assert flight.off_m(1) < 0.3


def test_a_companion_that_starts_in_flight_finds_itself() -> None:
    flight = Follower({1: (3.0, 6.0), 3: (-5.0, 4.0), 4: (2.0, 2.0)}, away=True)
    assert flight.here.is_lost
    flight.hover(3.0, ())
    assert flight.here.is_lost
    flight.hover(4.0, (3,))
    assert flight.said == FOUND
    flight.hover(5.0, (1, 3))
    assert max(flight.off_m(1), flight.off_m(3)) < 0.2


def test_a_neighbour_that_has_become_uncertain_is_found_far_off() -> None:
    flight = Follower({3: (0.0, -6.0)})
    flight.hover(5.0, (1,))
    flight.here.filter.add_peer(3, (AT[3][0] - AT[ME][0], AT[3][1] - AT[ME][1]), 4.0)
    flight.hover(6.0, (1, 3))
    assert flight.off_m(3) < 0.3


def test_a_liar_does_not_move_itself_at_once_nor_farther_than_it_says() -> None:
    """The filter's gate. In seconds it may, as by its odometer."""
    flight = Follower({})
    flight.hover(10.0, (1, 3))
    flight.hover(3.0, (3,), off=(0.0, 2.0))
    assert flight.measured > 16
    assert flight.off_m(3) < 0.1
    flight.hover(9.0, (1, 3), off=(0.0, 2.0))
    assert flight.off_m(3) < 2.4
