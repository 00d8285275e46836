"""Where a vehicle is among others that tell where they are: found from ranges, and not before only one place fits."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

import pytest

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.localisation.gnss_denied.relocalisation import SD_MAX_M, Relocaliser

DT_S = 0.1
LEADER = 1
Places = dict[int, Level]
SQUARE: Places = {1: (0.0, 0.0), 2: (0.0, 8.0), 3: (8.0, 0.0)}


def still(_now_s: float) -> Level:
    return (0.0, 0.0)


class Hearing:
    """A vehicle at `here` that hangs still, hears others at `places` tell what they tell, and ranges to them."""

    def __init__(self, here: Level, places: Places, *, told_sd_m: float = 0.3, odo_off: Level = (0.0, 0.0)) -> None:
        """`odo_off`: by how much its odometer is wrong against theirs."""
        self.here, self.places, self.told_sd_m = here, places, told_sd_m
        self.rng = random.Random(1)
        self.finder = Relocaliser()
        self.finder.update_odometry((here[0] + odo_off[0], here[1] + odo_off[1]))
        self.now_s = 0.0
        self.late_m: dict[int, float] = {}
        self.leader = LEADER

    def listen(self, seconds: float, *, drifted_m: float, moves: Callable[[float], Level] = still) -> bool:
        """Whether it is found in that time. `moves`: how far the leader is from its place, all others staying."""
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            places = dict(self.places)
            moved = moves(self.now_s)
            places[LEADER] = (places[LEADER][0] + moved[0], places[LEADER][1] + moved[1])
            lead = places[LEADER]
            for k, place in places.items():
                to_leader = None if k == LEADER else (lead[0] - place[0], lead[1] - place[1])
                self.finder.store_report(k, self.leader, to_leader, self.told_sd_m, place, (0.0, 0.0), self.now_s)
            for k, place in places.items():
                metres = math.dist(self.here, place) + self.rng.gauss(0.0, 0.1) + self.late_m.get(k, 0.0)
                self.finder.add_range(k, metres, self.now_s)
            if self.finder.search(drifted_m, self.now_s):
                return True
        return False

    @property
    def worst_m(self) -> float:
        """Of the places found, at rest."""
        found, _ = self.finder.locate_vehicles(self.places, self.now_s)
        assert sorted(found) == sorted(self.places)
        here = self.here
        return max(math.dist(found[k], (p[0] - here[0], p[1] - here[1])) for k, p in self.places.items())


def test_three_others_are_enough_at_rest_however_far_odometers_have_drifted() -> None:
    hearing = Hearing((14.0, 9.0), SQUARE, odo_off=(6.0, -5.0))
    assert hearing.listen(4.0, drifted_m=5.0)
    assert hearing.worst_m < 0.5


@pytest.mark.parametrize("here", [(5.0, 4.0), (-9.0, 12.0), (3.0, -7.0), (18.0, 11.0)])
def test_it_is_found_wherever_it_is(here: Level) -> None:
    hearing = Hearing(here, SQUARE, odo_off=(-4.0, 3.0))
    assert hearing.listen(4.0, drifted_m=4.0)
    assert hearing.worst_m < 0.6


def test_of_two_mirrored_places_none_is_taken_while_both_fit() -> None:
    """Two others in a line: ranges fit on either side of it, and the odometers have drifted as far."""
    hearing = Hearing((4.0, 4.0), {1: (0.0, 0.0), 2: (0.0, 8.0)}, odo_off=(-3.5, 0.0))
    assert not hearing.listen(30.0, drifted_m=4.0)


def test_odometers_tell_which_of_two_mirrored_places_it_is_where_they_have_not_drifted_far() -> None:
    hearing = Hearing((9.0, 4.0), {1: (0.0, 0.0), 2: (0.0, 8.0)}, odo_off=(1.5, -1.0))
    assert hearing.listen(4.0, drifted_m=2.0)
    assert hearing.worst_m < 0.6


def test_a_leader_that_moves_tells_which_of_two_mirrored_places_it_is() -> None:
    """Odometers have drifted so far that they rather say the wrong one."""
    hearing = Hearing((6.0, 4.0), {1: (0.0, 0.0), 2: (0.0, 8.0)}, told_sd_m=0.1, odo_off=(-8.0, 0.0))
    assert not hearing.listen(8.0, drifted_m=6.0)
    assert hearing.listen(10.0, drifted_m=6.0, moves=lambda now_s: (0.5 * (now_s - 8.0), 0.0))
    at, _ = hearing.finder.locate_vehicles([2], hearing.now_s)
    assert math.dist(at[2], (-6.0, 4.0)) < 1.0


def test_a_single_other_at_rest_is_on_a_circle_and_not_found() -> None:
    assert not Hearing((8.0, 0.0), {1: (0.0, 0.0)}).listen(30.0, drifted_m=3.0)


def test_one_range_that_comes_late_does_not_lead_astray() -> None:
    hearing = Hearing((14.0, 9.0), SQUARE | {4: (8.0, 8.0)})
    hearing.late_m = {2: 1.0}
    assert hearing.listen(6.0, drifted_m=4.0)
    assert hearing.worst_m < 0.8


def test_an_odometer_that_began_anew_in_flight_is_not_believed() -> None:
    hearing = Hearing((14.0, 9.0), SQUARE, odo_off=(-60.0, 15.0))
    assert hearing.listen(4.0, drifted_m=3.0)
    assert hearing.worst_m < 0.5


def test_an_odometer_that_jumps_while_it_is_looked_for_does_not_spoil_what_follows() -> None:
    hearing = Hearing((14.0, 9.0), SQUARE, odo_off=(2.0, 1.0))
    assert not hearing.listen(1.0, drifted_m=4.0)
    hearing.finder.update_odometry((0.0, 0.0))
    assert hearing.listen(4.0, drifted_m=4.0)
    assert hearing.worst_m < 0.5


def test_others_that_are_unsure_themselves_do_not_place_it() -> None:
    assert not Hearing((14.0, 9.0), SQUARE, told_sd_m=3.0 * SD_MAX_M).listen(10.0, drifted_m=5.0)


def test_without_a_leader_nobody_tells_a_place() -> None:
    hearing = Hearing((14.0, 9.0), SQUARE)
    hearing.leader = 0
    assert not hearing.listen(10.0, drifted_m=1.0)
    hearing.leader = LEADER
    assert hearing.listen(4.0, drifted_m=1.0)
