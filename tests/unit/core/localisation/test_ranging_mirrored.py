"""Places of the mission that may be a mirror image: seen by a small motion, before anybody leaves its place."""

from __future__ import annotations

import math

import pytest

from companion.core.localisation.gnss_denied.excitation import SPEED_MPS
from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.model.beacon import RelativeReport
from companion.core.model.events import HeardBeacon, Position, Ranges
from companion.core.model.states import LandedState
from companion.core.model.vectors import add, sub
from companion.core.swarm.picture import Picture
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.core_kit import beacon, lease, picture
from tests.unit.core.ranging_kit import STARTS, ranging_mission

ME, LEADER, DT_S, PERIOD_S = 3, 1, 0.05, 10.0
DOWN_M = -4.0
TOLD = {k: enu_to_ned(place) for k, place in enumerate(STARTS, start=1)}
CONFUSED = {k: (place[1], place[0], place[2]) for k, place in TOLD.items()}  # east and north: 2 and 3 change places


class Hovering:
    """A vehicle's localiser in the air; vehicles are at `true`, the mission says TOLD. It circles, they do not."""

    def __init__(self, true: dict[int, Vec3], *, me: int = ME, circles: bool = True, others_tell: bool = False) -> None:
        self.me, self.circles, self.others_tell = me, circles, others_tell
        self.true = {k: (place[0], place[1], DOWN_M) for k, place in true.items()}
        self.localiser = GnssDeniedLocaliser(ranging_mission(), me)
        self.now_s, self.ticks = 0.0, 0
        self.own: Vec3 = TOLD[me]
        self.localiser.receive_position(Position(self.own, (0.0, 0.0, 0.0), 0.0), 0.0)
        self.localiser.update_landed_state(LandedState.ON_GROUND, waits=True)

    def way(self) -> tuple[Vec3, Vec3]:
        if not self.circles:
            return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        turn, radius_m = math.tau * self.now_s / PERIOD_S, SPEED_MPS * PERIOD_S / math.tau
        way = (radius_m * math.sin(turn), radius_m * (1.0 - math.cos(turn)), 0.0)
        return way, (SPEED_MPS * math.cos(turn), SPEED_MPS * math.sin(turn), 0.0)

    def run(self, seconds: float) -> list[str]:
        """What it says in that time."""
        said: list[str] = []
        self.localiser.update_landed_state(LandedState.IN_AIR, waits=False)
        for _ in range(round(seconds / DT_S)):
            self.ticks += 1
            self.now_s = self.ticks * DT_S
            way, vel = self.way()
            here, told = add(self.true[self.me], way), add(TOLD[self.me], way)
            self.own = (told[0], told[1], DOWN_M)
            if self.ticks % 2 == 0:
                self.hear()
                ranges = tuple((k, math.dist(here, place), 0.0) for k, place in self.true.items() if k != self.me)
                self.localiser.receive_ranging(Ranges(ranges), self.now_s)
            self.localiser.receive_position(Position(self.own, vel, self.now_s), self.now_s)
            self.localiser.update_peers(self.own, self.now_s, range_m=30.0, launched=True)
            said += [say.text for say in self.localiser.said]
            self.localiser.said.clear()
        return said

    def hear(self) -> None:
        time_ms = round(self.now_s * 1e3)
        for k, place in self.true.items():
            if k == self.me:
                continue
            to_leader = sub(self.true[LEADER], place)
            tells = self.others_tell and k != LEADER
            self.localiser.receive_ranging(
                RelativeReport(k, time_ms, (0.0, 0.0), to_leader[:2] if tells else None, 0.3), self.now_s
            )
            said = beacon(k, time_ms=time_ms, airborne=True, lease=lease(LEADER, seq=self.ticks, established=True))
            self.localiser.receive_beacon(HeardBeacon(said, (0.0, 0.0, 0.0)), self.own, self.now_s)

    def off_m(self, vehicle: int) -> float:
        """By how much it is wrong about where that is."""
        ranging, here = self.localiser.ranging, add(self.true[self.me], self.way()[0])
        found = ranging.locate_peer(vehicle, self.own[2], self.now_s)
        assert found is not None
        return math.dist(found[0], sub(self.true[vehicle], here))

    def unsure_of(self, *, gathers: bool = True) -> list[str]:
        found = self.picture().find_uncertain_peer(self.me, LEADER, gathers=gathers)
        return [str(found)] if found else []

    def picture(self) -> Picture:
        return picture(
            neighbours=self.localiser.neighbours,
            uncertain_peer=self.localiser.uncertain_peer,
            is_start_uncertain=self.localiser.is_start_uncertain,
            unconfirmed_peers=self.localiser.unconfirmed_peers,
        )

    def tells_leader(self) -> bool:
        ranging = self.localiser.ranging
        return ranging.make_report(LEADER, 0, self.now_s).to_leader_ne_m is not None


def test_one_that_hovers_at_rest_holds_and_tells_nobody_where_it_has_the_leader() -> None:
    hovering = Hovering(TOLD, circles=False)
    assert hovering.run(30.0) == []
    assert hovering.localiser.is_start_uncertain
    assert not hovering.tells_leader()
    assert hovering.unsure_of() == [str(LEADER)]
    assert hovering.unsure_of(gathers=False) == [str(LEADER)]  # nor does it follow a swarm that leaves


def test_one_that_circles_sees_that_its_start_is_where_the_mission_says() -> None:
    hovering = Hovering(TOLD)
    assert hovering.run(25.0) == []
    assert not hovering.localiser.is_start_uncertain
    assert hovering.tells_leader()
    assert hovering.off_m(LEADER) < 0.5


def test_one_that_circles_sees_that_its_start_is_the_mirror_image_and_finds_the_leader_anew() -> None:
    hovering = Hovering(CONFUSED)
    assert hovering.run(1.0) == []
    assert hovering.off_m(LEADER) > 10.0
    assert hovering.run(25.0) == [f"start positions wrong: vehicle {LEADER} found elsewhere"]
    assert not hovering.localiser.is_start_uncertain
    assert hovering.tells_leader()
    assert hovering.off_m(LEADER) < 1.0


def test_it_takes_the_others_to_be_where_they_tell_once_they_know() -> None:
    hovering = Hovering(CONFUSED)
    hovering.run(25.0)
    hovering.others_tell = True
    hovering.run(1.0)
    assert max(hovering.off_m(k) for k in TOLD if k != ME) < 1.0
    assert hovering.unsure_of() == []


def test_a_leader_takes_the_others_to_be_where_they_tell_and_moves_on_then() -> None:
    hovering = Hovering(CONFUSED, me=LEADER, circles=False)
    hovering.run(2.0)
    assert hovering.unsure_of() == ["2"]
    assert max(hovering.off_m(k) for k in (2, 3)) > 10.0
    hovering.others_tell = True
    hovering.run(1.0)
    assert hovering.unsure_of() == []
    assert max(hovering.off_m(k) for k in (2, 3, 4)) < 1.0


def test_nobody_leaves_its_place_while_another_does_not_know_its_own() -> None:
    hovering = Hovering(TOLD)
    hovering.run(25.0)
    assert hovering.unsure_of() == ["2"]
    assert hovering.unsure_of(gathers=False) == []  # the time for that is over


@pytest.mark.parametrize("vehicle", [2, 4])
def test_a_word_is_compared_once_and_not_followed_ever_after(vehicle: int) -> None:
    """Each has a filter of its own; what the other's has shares its errors with what is known here."""
    hovering = Hovering(TOLD, others_tell=True)
    hovering.run(25.0)
    ranging = hovering.localiser.ranging
    ranging.receive_report(
        RelativeReport(vehicle, 1, (0.0, 0.0), (50.0, 50.0), 0.1),
        (0.0, 0.0, 0.0),
        DOWN_M,
        hovering.now_s,
        leader=LEADER,
    )
    assert hovering.off_m(vehicle) < 1.0
