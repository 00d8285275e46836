"""Where a vehicle with a receiver is: an odometer that never jumps, an offset that follows the fixes, and how sure."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.gnss_denied.error_state import BY_TRUNKS, Errors
from companion.core.localisation.gnss_denied.global_localisation import (
    BETTER_S,
    FRESH_S,
    LEADER_S,
    WORSE_S,
    DeadReckoningUncertainty,
    GlobalLocalisation,
    Reception,
)
from companion.core.model.events import Position, Satellites

GOOD = Satellites(used=True, sd_m=0.9)
POOR = Satellites(used=True, sd_m=6.0)
NONE = Satellites(used=False, sd_m=99.0)
DT_S = 0.05
EAST_MPS = 2.0


def read(place: GlobalLocalisation, told: Position, now_s: float, *, airborne: bool = True) -> Position:
    """What the flight goes by where nothing seen corrects the odometer."""
    position = place.split_position(told, now_s, airborne=airborne)
    place.note_flown(position, now_s)
    return position


class Flown:
    """A place of a vehicle that flies east at EAST_MPS; `off_m`: how far what its autopilot tells is off, north."""

    def __init__(self, *, receives: bool = True) -> None:
        self.place = GlobalLocalisation(receives=receives)
        self.now_s = 0.0
        self.off_m = 0.0
        self.worst_m = 0.0  # that the odometer did beyond its velocity in a tick
        self.read = Position((0.0, 0.0, -8.0), (0.0, EAST_MPS, 0.0))

    def fly(
        self, seconds: float, said: Satellites | None = GOOD, *, leads: bool = False, drift_mps: float = 0.0
    ) -> None:
        """`drift_mps`: north, of what is told of the velocity, and with it of the position."""
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            self.off_m += drift_mps * DT_S
            if said is not None:
                self.place.receive_satellites(said, self.now_s)
            told = Position((self.off_m, EAST_MPS * self.now_s, -8.0), (drift_mps, EAST_MPS, 0.0), self.now_s)
            before = self.read
            self.read = read(self.place, told, self.now_s)
            gone = [a - b for a, b in zip(self.read.pos_ned_m, before.pos_ned_m, strict=True)]
            if self.now_s > 1.5 * DT_S:
                self.worst_m = max(self.worst_m, math.hypot(gone[0] - drift_mps * DT_S, gone[1] - EAST_MPS * DT_S))
            self.place.update_reception(self.now_s, leads=leads)


def test_with_good_fixes_the_odometer_is_what_the_autopilot_tells_to_the_bit() -> None:
    place = GlobalLocalisation(receives=True)
    for k in range(100):
        told = Position((0.1 * k, 0.123 * k, -8.0), (2.0, 2.46, 0.0), 0.05 * k)
        place.receive_satellites(GOOD, 0.05 * k)
        assert read(place, told, 0.05 * k).pos_ned_m == told.pos_ned_m
        assert place.fix_ned_m(0.05 * k) == told.pos_ned_m


def test_a_vehicle_without_a_receiver_is_where_its_odometer_says_and_has_no_fix() -> None:
    place = GlobalLocalisation(receives=False)
    told = Position((1.0, 2.0, -8.0), (0.0, 0.0, 0.0), 0.0)
    assert read(place, told, 0.0) is told
    assert place.fix_ned_m(0.0) is None
    place.update_reception(100.0, leads=False)
    assert place.reception is Reception.NONE


def test_a_position_that_jumps_to_a_fix_does_not_move_the_odometer_but_the_place() -> None:
    flown = Flown()
    flown.fly(5.0)
    flown.fly(60.0, NONE, drift_mps=0.1)
    assert flown.place.fix_ned_m(flown.now_s) is None
    drifted_m = flown.read.pos_ned_m[0]
    assert drifted_m == pytest.approx(6.0, abs=0.01)
    flown.off_m = -4.0  # at once
    flown.fly(1.0)
    assert flown.read.pos_ned_m[0] == pytest.approx(drifted_m, abs=0.01)
    flown.fly(20.0)
    fix = flown.place.fix_ned_m(flown.now_s)
    assert fix is not None
    assert fix[0] == pytest.approx(-4.0, abs=1.5)
    assert flown.worst_m < 0.003


def test_a_fix_that_wanders_moves_the_place_and_not_what_trunks_correct() -> None:
    """What is told follows the fix at once, the place in the mission's frame within half a minute."""
    place, now_s = GlobalLocalisation(receives=True), 0.0
    for k in range(200):
        now_s = DT_S * k
        place.receive_satellites(GOOD, now_s)
        told = Position((min(1.2, 0.6 * max(0.0, now_s - 5.0)), EAST_MPS * now_s, -8.0), (0.0, EAST_MPS, 0.0), now_s)
        place.split_position(told, now_s, airborne=True)
        place.note_flown(Position((0.0, EAST_MPS * now_s, -8.0), (0.0, EAST_MPS, 0.0), now_s), now_s)
    told_off, fix = place.told_off_ne_m(now_s), place.fix_ned_m(now_s)
    assert told_off is not None
    assert fix is not None
    assert told_off[0] == pytest.approx(1.2)
    assert 0.1 < fix[0] < 0.6


def test_good_fixes_alone_tell_where_the_odometer_is_in_the_missions_frame() -> None:
    flown = Flown()
    flown.fly(5.0)
    assert flown.place.told_off_ne_m(flown.now_s) == (0.0, 0.0)
    flown.fly(5.0, POOR)
    assert flown.place.told_off_ne_m(flown.now_s) is None
    flown.fly(1.0, NONE)
    assert flown.place.told_off_ne_m(flown.now_s) is None


def test_after_a_long_gap_a_fix_counts_at_once_and_after_a_short_one_little() -> None:
    moved = []
    for gap_s in (2.0, 300.0):
        flown = Flown()
        flown.fly(60.0)
        flown.fly(gap_s, NONE)
        flown.off_m = 10.0
        flown.fly(1.0)
        fix = flown.place.fix_ned_m(flown.now_s)
        assert fix is not None
        moved.append(fix[0])
    assert moved[0] < 1.5
    assert moved[1] > 5.0


def test_a_position_that_poor_fixes_pull_is_no_motion() -> None:
    flown = Flown()
    flown.fly(5.0)
    for _ in range(200):
        flown.off_m += 0.02  # 0.4 m/s, and the velocity says nothing of it
        flown.fly(DT_S, POOR)
    assert flown.read.pos_ned_m[0] == pytest.approx(0.0, abs=1e-6)


def test_one_that_good_fixes_pull_fast_is_none_either() -> None:
    flown = Flown()
    flown.fly(5.0)
    for _ in range(40):
        flown.off_m += 0.1
        flown.fly(DT_S)
    assert flown.read.pos_ned_m[0] == pytest.approx(0.0, abs=1e-6)


def test_reception_is_worse_after_five_seconds_of_a_leader_after_seven() -> None:
    for leads, after_s in ((False, WORSE_S), (True, WORSE_S + LEADER_S)):
        flown = Flown()
        flown.fly(3.0)
        flown.fly(after_s - 0.2, NONE, leads=leads)
        assert flown.place.reception is Reception.GOOD
        flown.fly(0.4, NONE, leads=leads)
        assert flown.place.reception is Reception.NONE


def test_reception_is_better_after_a_while_which_each_loss_doubles() -> None:
    flown = Flown()
    flown.fly(3.0)
    wait_s = BETTER_S
    for _ in range(3):
        flown.fly(WORSE_S + 0.2, NONE)
        wait_s *= 2.0
        flown.fly(wait_s - 0.5)
        assert flown.place.reception is Reception.NONE
        flown.fly(1.0)
        assert flown.place.reception is Reception.GOOD


def test_one_that_flickers_stays_away() -> None:
    flown = Flown()
    flown.fly(3.0)
    flown.fly(6.0, NONE)
    for _ in range(20):
        flown.fly(12.0)
        flown.fly(1.0, NONE)
        assert flown.place.reception is Reception.NONE


def test_poor_fixes_are_poor_reception() -> None:
    flown = Flown()
    flown.fly(3.0)
    flown.fly(WORSE_S + 0.2, POOR)
    assert flown.place.reception is Reception.POOR
    assert flown.place.fix_ned_m(flown.now_s) is not None


def test_an_autopilot_that_stops_telling_of_satellites_has_none() -> None:
    flown = Flown()
    flown.fly(3.0)
    flown.fly(FRESH_S + WORSE_S + 0.5, None)
    assert flown.place.reception is Reception.NONE


def test_one_that_never_told_is_taken_at_the_missions_word() -> None:
    flown = Flown()
    flown.fly(60.0, None)
    assert flown.place.reception is Reception.GOOD
    assert flown.place.fix_ned_m(flown.now_s) == flown.read.pos_ned_m


def test_on_the_ground_the_missions_word_counts() -> None:
    place = GlobalLocalisation(receives=True)
    for k in range(2000):
        place.receive_satellites(NONE, 0.05 * k)
        read(place, Position((5.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.05 * k), 0.05 * k, airborne=False)
        place.update_reception(0.05 * k, leads=False)
    assert place.reception is Reception.GOOD
    assert place.fix_ned_m(100.0) == (5.0, 0.0, 0.0)


def test_doubt_grows_with_time_and_with_the_way_and_shrinks_again_on_the_way_back() -> None:
    doubt = DeadReckoningUncertainty(1.0)
    here = (0.0, 0.0, 0.0)
    doubt.set_known(1.0, here)
    assert doubt.sd_m(here) == pytest.approx(1.0)
    doubt.add_bias_walk(100.0, Errors())
    stood_m = doubt.sd_m(here)
    assert stood_m == pytest.approx(math.sqrt(1.0 + 2.0 * 2.0 * 0.05**2 * 20.0 * 100.0))  # 0.05 m/s, forgotten in 20 s
    away_m = doubt.sd_m((300.0, 0.0, 0.0))
    assert away_m == pytest.approx(math.hypot(stood_m, math.radians(2.0) * 300.0))
    assert doubt.sd_m(here) == pytest.approx(stood_m)


@pytest.mark.parametrize("seen_s", [30.0, 10.0, 0.0])
def test_while_trunks_correct_the_odometer_doubt_grows_less(seen_s: float) -> None:
    """A leader that has lost its satellites: seen_s of the 30 s of its way among trunks."""
    flown, seen = Flown(receives=False), 0.0
    flown.place.update_destination_sd(0.5, flown.now_s, lag_m=None)
    while flown.now_s < 30.0 - 1e-6:
        if seen < seen_s:
            flown.place.note_trunks(flown.now_s)
        flown.fly(0.5)
        seen += 0.5
    walked_m2 = flown.place.sd_m**2 - 0.5**2 - (math.radians(2.0) * EAST_MPS * 30.0) ** 2
    bias_m2_per_s = [2.0 * 2.0 * errors.bias_mps**2 * errors.bias_s for errors in (BY_TRUNKS, Errors())]
    # A second more: for so long what was seen counts
    reckoned_s = min(30.0, seen_s + 1.0) if seen_s else 0.0
    expected_m2 = reckoned_s * bias_m2_per_s[0] + (30.0 - reckoned_s) * bias_m2_per_s[1]
    assert walked_m2 == pytest.approx(expected_m2, abs=0.3)


def test_how_far_the_way_to_d2_may_be_off_comes_from_the_leader_and_grows_by_odometry() -> None:
    flown = Flown(receives=False)
    flown.fly(1.0)
    flown.place.update_destination_sd(2.5, flown.now_s, lag_m=None)
    assert flown.place.sd_m == pytest.approx(2.5)
    flown.fly(30.0)
    flown.place.update_destination_sd(None, flown.now_s, lag_m=0.0)  # it leads now
    assert flown.place.sd_m > 4.0


def test_a_leaders_is_what_its_fixes_leave_and_how_far_it_is_from_going_by_them() -> None:
    flown = Flown()
    flown.fly(60.0)
    flown.place.update_destination_sd(None, flown.now_s, lag_m=0.0)
    sure_m = flown.place.sd_m
    assert sure_m < 2.0
    flown.place.update_destination_sd(None, flown.now_s, lag_m=8.0)
    assert flown.place.sd_m == pytest.approx(math.hypot(sure_m, 8.0))
