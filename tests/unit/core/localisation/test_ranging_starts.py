"""Whether a vehicle that flies by ranges is at the mission's start, and what it does when it, or another, is not."""

from __future__ import annotations

import math

import pytest

from companion.core.agent import TICK_S, Agent
from companion.core.localisation.gnss_denied.localiser import LOST, GnssDeniedLocaliser
from companion.core.localisation.gnss_denied.ranging import AWAY_M, NO_RANGES, RangingLocaliser
from companion.core.localisation.integrity.own_ranges import MEASURED_S
from companion.core.model.beacon import RelativeReport
from companion.core.model.events import AutopilotHealth, AutopilotMode, HeardBeacon, Landed, Position, Ranges
from companion.core.model.states import FlightMode, FlightState, LandedState, SwarmPhase
from companion.core.model.vectors import ZERO, add
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from companion.mavlink.makes.px4 import PX4
from mission.common.frames import Vec3, enu_to_ned
from tests.unit.core.core_kit import beacon, lease
from tests.unit.core.ranging_kit import STARTS, ranging_mission

ALONE_LAND_S = failsafe_engine.row(Cause.ALONE_LONG).delay_s

ME, LEADER, UP_M = 3, 1, 4.0
AT = {k: enu_to_ned(place) for k, place in enumerate(STARTS, start=1)}
FLOWN: Vec3 = (20.0, 1.0, -UP_M)  # by all alike


class Among:
    """Vehicle 3's agent, handed what it would hear of three others; all hang still, `way` from their starts."""

    def __init__(
        self, *, way: Vec3 = FLOWN, own_way: Vec3 | None = None, tells: bool = True, **tables: dict[str, float]
    ) -> None:
        """`tells`: the others know where they are. `tables`: of the mission."""
        self.agent = Agent(ranging_mission(**tables), ME)
        self.way, self.own_way = way, way if own_way is None else own_way
        self.off: Vec3 = (0.0, 0.0, 0.0)  # from where its odometer has it
        self.tells = tells
        self.ranges_reach = True
        self.silent: set[int] = set()  # of the others
        self.now_s = 0.0
        self.ticks = 0

    @property
    def flies(self) -> bool:
        return self.own_way[2] < 0.0

    def place(self, k: int) -> Vec3:
        return add(AT[k], self.own_way if k == ME else self.way)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.ticks += 1
            self._tick()

    def _tick(self) -> None:
        agent, now_s = self.agent, self.now_s
        if self.ticks % 2 == 0:
            for k in AT:
                if k != ME and k not in self.silent:
                    self.hear(k)
            if self.ranges_reach:
                true = add(self.place(ME), self.off)
                agent.receive(Ranges(tuple((k, math.dist(true, self.place(k)), 0.0) for k in AT if k != ME)), now_s)
        agent.receive(
            AutopilotMode(FlightMode.HOLD, self.flies, "AUTO.LOITER", failsafe=self.flies, traits=PX4.traits), now_s
        )
        agent.receive(AutopilotHealth(True, 90), now_s)
        agent.receive(Landed(LandedState.IN_AIR if self.flies else LandedState.ON_GROUND), now_s)
        agent.receive(Position(self.place(ME), ZERO, now_s), now_s)
        agent.tick(now_s)

    def hear(self, k: int, *, waited_s: float = 0.0) -> None:
        """A beacon with its report, which has waited to be read."""
        time_ms = round((self.now_s - waited_s) * 1e3)
        to_leader = (AT[LEADER][0] - AT[k][0], AT[LEADER][1] - AT[k][1])
        word = RelativeReport(k, time_ms, (self.way[0], self.way[1]), to_leader if self.tells else None, 0.3)
        flies = self.way[2] < 0.0
        said = beacon(
            k,
            time_ms=time_ms,
            route_cost=0.0 if k == LEADER else 1.0,
            lease=lease(LEADER, seq=self.ticks, established=True, priority=1),
            state=FlightState.TRANSIT if flies else FlightState.WAITING,
            phase=SwarmPhase.TRANSIT if flies else SwarmPhase.ASSEMBLE,
            airborne=flies,
            flown=0b1111 if flies else 0,
        )
        self.agent.receive(word, self.now_s)
        self.agent.receive(HeardBeacon(said, (0.0, 0.0, self.way[2] - self.own_way[2])), self.now_s)

    @property
    def ranging(self) -> RangingLocaliser:
        """Of the agent under test."""
        localiser = self.agent.localiser
        assert isinstance(localiser, GnssDeniedLocaliser)
        return localiser.ranging

    @property
    def worst_m(self) -> float:
        """Of where it has the others."""
        ranging, here = self.ranging, add(self.place(ME), self.off)
        errors = []
        for k in AT:
            if k != ME:
                found, there = ranging.locate_peer(k, here[2], self.now_s), self.place(k)
                assert found is not None
                errors.append(math.dist(found[0], (there[0] - here[0], there[1] - here[1], there[2] - here[2])))
        return max(errors)

    def tells_leader(self) -> bool:
        """Whether its beacons say where it has the leader."""
        ranging = self.ranging
        return ranging.make_report(LEADER, 0, self.now_s).to_leader_ne_m is not None


def test_one_that_starts_on_the_ground_at_its_start_is_where_the_mission_says() -> None:
    among = Among(way=ZERO)
    among.run(0.1)
    assert among.agent.localiser.is_initialised
    assert not among.tells_leader()  # it may be a mirror image
    assert among.worst_m < 0.1
    assert among.agent.flight.state is FlightState.READY


def test_one_that_starts_in_the_air_is_not_steered_before_it_has_found_the_others() -> None:
    """Its odometer has drifted by 3 m against theirs."""
    among = Among()
    among.off = (2.0, -2.2, 0.0)
    among.run(1.0)
    assert not among.agent.localiser.is_initialised
    assert not among.tells_leader()
    assert among.agent.flight.state is FlightState.WAITING
    assert among.agent.flight.waits_for == LOST
    assert not among.agent.flight.steers
    among.run(3.0)
    assert among.agent.localiser.is_initialised
    assert among.tells_leader()
    assert among.worst_m < 0.5
    assert among.agent.flight.steers


def test_while_it_is_lost_a_neighbour_is_as_near_as_its_range_says() -> None:
    among = Among()
    among.off = (2.0, -2.2, 0.0)
    among.run(1.0)
    assert not among.agent.localiser.is_initialised
    for neighbour in among.agent.localiser.neighbours:
        true_m = math.dist(add(among.place(ME), among.off), among.place(neighbour.id))
        assert neighbour.distance_m <= true_m + 0.1


@pytest.mark.parametrize("lacks", ["words", "ranges"])
def test_one_that_finds_nobody_lands_where_it_is(lacks: str) -> None:
    among = Among(tells=lacks != "words")
    among.ranges_reach = lacks != "ranges"
    among.run(ALONE_LAND_S - 1.0)
    assert not among.agent.localiser.is_initialised
    assert among.agent.flight.state is FlightState.WAITING
    among.run(2.0)
    assert among.agent.flight.state is FlightState.LANDING


def test_one_that_starts_on_the_ground_elsewhere_does_not_take_the_mission_s_place_for_its_own() -> None:
    among = Among(way=ZERO, own_way=(AWAY_M + 1.0, 0.0, 0.0))
    among.run(0.2)
    assert not among.agent.localiser.is_initialised
    assert among.agent.flight.state is FlightState.WAITING
    assert among.agent.flight.waits_for == "4 m from its start position"


def test_one_on_the_ground_that_hears_others_that_have_flown_finds_them_before_it_takes_off() -> None:
    among = Among(way=(6.0, 1.0, -UP_M), own_way=ZERO)
    among.run(1.0)
    assert not among.agent.localiser.is_initialised
    assert among.agent.flight.state is FlightState.WAITING
    among.run(3.0)
    assert among.agent.localiser.is_initialised
    assert among.worst_m < 0.5


def test_one_in_flight_that_hears_another_for_the_first_time_takes_it_for_where_its_odometer_says() -> None:
    """And not for where the mission has it start; unsure by what odometers drift."""
    among = Among(way=ZERO)
    among.agent.localiser.update_landed_state(LandedState.ON_GROUND, waits=False)
    ranging = among.ranging
    among.agent.receive(Position(AT[ME], ZERO, 60.0), 60.0)
    ranging.receive_report(RelativeReport(2, 1, (30.0, -4.0)), ZERO, 0.0, 60.0)
    found = ranging.locate_peer(2, 0.0, 60.0)
    assert found is not None
    assert found[0] == pytest.approx((AT[2][0] - AT[ME][0] + 30.0, AT[2][1] - AT[ME][1] - 4.0, 0.0))
    assert math.hypot(*found[1][:2]) < 0.9 * math.hypot(*found[0][:2])
    assert not ranging.is_lost


def test_one_that_was_not_heard_when_the_others_were_found_is_placed_by_its_own_word() -> None:
    among = Among()
    among.run(4.0)
    ranging = among.ranging
    ranging.filter.remove_peer(2)
    among.run(0.2)
    assert 2 in ranging.filter.ids
    assert among.worst_m < 0.5


def test_what_waited_through_a_stall_of_the_companion_is_not_taken_for_fresh() -> None:
    """Seed 10026: a socket keeps the oldest. What came next seemed to be an odometer that had begun anew, 40 m on."""
    among = Among()
    among.run(4.0)
    among.ranges_reach = False
    among.now_s += 16.0
    for k in (1, 2, 4):
        for k_th in range(5):
            among.hear(k, waited_s=15.9 - 0.1 * k_th)
    among.way = add(FLOWN, (40.0, 0.0, 0.0))
    among.run(2.0)
    assert among.worst_m < 1.0


def test_one_that_has_lost_the_leader_does_not_tell_where_it_is_nor_place_others_by_it() -> None:
    """Seed 10026: woken from a stall it told where the leader had been, and the others placed it 37 m off by that."""
    among = Among()
    among.run(4.0)
    assert among.tells_leader()
    among.silent.add(LEADER)
    among.run(3.0)
    assert not among.tells_leader()

    among.tells = False
    among.run(0.2)
    among.tells = True
    among.ranging.filter._of[LEADER].n_m += 40.0  # it has flown on
    among.ranges_reach = False
    known = among.ranging.filter.relative(2)
    among.run(0.2)
    found = among.ranging.filter.relative(2)
    assert known is not None
    assert found is not None
    assert math.dist(found.ne_m, known.ne_m) < 0.5


# --- whether they stand where the mission says ---


def standing(places: dict[int, Vec3], *, noise_m: float = 0.0) -> Among:
    """On the ground, off their starts by `places`; of others this vehicle learns by their words."""
    among = Among(way=ZERO)
    ranging = among.ranging
    at = {k: add(AT[k], places.get(k, ZERO)) for k in AT}
    among.ranges_reach = False
    for tick in range(30):
        among.run(TICK_S)
        off_m = noise_m if tick % 2 else -noise_m
        ranges = {(a, b): math.dist(at[a], at[b]) + off_m for a in at for b in at if a < b}
        among.agent.receive(Ranges(tuple((k, ranges[min(k, ME), max(k, ME)], 0.0) for k in at if k != ME)), among.now_s)
        told = tuple((b, ranges[a, b], 0.0) for a, b in ranges if a == LEADER and b != ME)
        ranging.receive_report(
            RelativeReport(LEADER, tick, (0.0, 0.0), ranges=told), ZERO, 0.0, among.now_s, leader=LEADER, flies=False
        )
    among.run(TICK_S)
    return among


def test_vehicles_that_do_not_stand_where_the_mission_says_stay_on_the_ground_and_are_named() -> None:
    among = standing({4: (0.0, -3.5, 0.0)})
    assert among.agent.flight.state is FlightState.WAITING
    assert among.agent.flight.waits_for == "3-4 start 4.5 m apart, not 8.0 m"


def test_what_others_have_measured_counts_as_well() -> None:
    ranging = standing({2: (0.0, -3.5, 0.0)}).ranging
    assert ranging.start_mismatch == "1-2 start 4.5 m apart, not 8.0 m"


@pytest.mark.parametrize("off", [ZERO, (1.4, 0.0, 0.0), (-1.0, 1.0, 0.0)])
def test_places_as_exact_as_the_mission_asks_for_are_flown_from(off: Vec3) -> None:
    among = standing({2: off, 4: (-0.5, 0.5, 0.0)}, noise_m=0.3)
    assert among.agent.localiser.missing(among.now_s) == ""
    assert among.agent.flight.state is FlightState.READY


# --- whether its radio measures ---


def test_one_whose_radio_measures_nobody_stays_on_the_ground_and_says_why() -> None:
    among = Among(way=ZERO)
    among.ranges_reach = False
    among.run(3.0)
    assert among.agent.flight.state is FlightState.WAITING
    assert among.agent.flight.waits_for == NO_RANGES == "no ranges from range radio"
    among.ranges_reach = True
    among.run(2 * TICK_S)
    assert among.agent.flight.state is FlightState.READY


def test_one_whose_radio_has_measured_long_ago_is_not_ready_any_more() -> None:
    among = Among(way=ZERO)
    among.run(1.0)
    among.ranges_reach = False
    among.run(MEASURED_S - 0.2)
    assert among.agent.flight.state is FlightState.READY
    among.run(0.5)
    assert among.agent.flight.waits_for == NO_RANGES


def test_a_range_to_one_neighbour_is_enough_and_one_to_a_stranger_is_none() -> None:
    for vehicle, waits_for in ((LEADER, ""), (9, NO_RANGES)):
        among = Among(way=ZERO)
        among.ranges_reach = False
        among.agent.receive(Ranges(((vehicle, 8.0, 0.0),)), 0.0)
        among.run(1.0)
        assert among.agent.localiser.missing(among.now_s) == waits_for


def test_one_whose_neighbours_start_out_of_its_radios_reach_does_not_wait_for_ranges() -> None:
    """Places are 8 m apart, and may be off by 2 m: a reach of 9 m may not do."""
    among = Among(way=ZERO, separation={"soft_m": 6.0}, ranging={"reach_m": 9.0})
    among.ranges_reach = False
    among.run(1.0)
    assert among.agent.flight.state is FlightState.READY


def test_one_in_the_air_does_not_wait_for_ranges_on_the_ground() -> None:
    among = Among()
    among.ranges_reach = False
    among.run(1.0)
    assert among.agent.localiser.missing(among.now_s) == LOST
