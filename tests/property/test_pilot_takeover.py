"""A pilot's mode change is final: from every state, into every mode, whatever the swarm and the operator want."""

from __future__ import annotations

import random
from collections.abc import Callable
from copy import deepcopy

import pytest

from companion.core.model.actions import Ask
from companion.core.model.events import Answer, AutopilotHealth, AutopilotMode, Landed, Position
from companion.core.model.states import (
    STEERED,
    AutopilotTraits,
    FlightMode,
    FlightState,
    LandedState,
    Request,
    Result,
    SwarmPhase,
)
from companion.core.vehicle.failsafe import Cause, Finding
from companion.core.vehicle.flight import Flight
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4

ALTITUDE_M = 8.0
TICK_S = 0.05
M = FlightMode


class Vehicle:
    """A Flight on an autopilot that does what it is asked, until a pilot takes it."""

    def __init__(self, traits: AutopilotTraits) -> None:
        self.flight = Flight(ALTITUDE_M)
        self.traits = traits
        self.mode, self.name, self.failsafe, self.armed = M.OTHER, "AS SWITCHED ON", False, False
        self.altitude_m, self.now_s = 0.0, 100.0
        self.obeys = True
        self.asked: list[Request] = []

    @property
    def landed(self) -> LandedState:
        if self.altitude_m == 0.0:
            return LandedState.ON_GROUND
        return LandedState.TAKEOFF if self.altitude_m < ALTITUDE_M else LandedState.IN_AIR

    def switch(self, mode: FlightMode, name: str = "", *, failsafe: bool = False) -> None:
        self.mode, self.name, self.failsafe = mode, name or mode.value, failsafe

    def tick(self, phase: SwarmPhase, *, land_now: bool = False, hold: bool = False, may_join: bool = True) -> None:
        self.now_s += TICK_S
        receive = self.flight.receive
        receive(AutopilotMode(self.mode, self.armed, self.name, self.failsafe, self.traits), self.now_s)
        receive(Position((0.0, 0.0, -self.altitude_m), (0.0, 0.0, 0.0)), self.now_s)
        receive(AutopilotHealth(True, 80), self.now_s)
        receive(Landed(self.landed), self.now_s)
        found = self.flight.vehicle.findings(self.now_s)
        found += [Finding(Cause.LAND_ALL)] * land_now + [Finding(Cause.NO_LEADER)] * hold
        out = self.flight.update_flight(phase, self.now_s, findings=found, may_join=may_join, may_take_off=True)
        self.asked = [action.request for action in out if isinstance(action, Ask)]
        if self.obeys:
            self._obey()

    def _obey(self) -> None:
        for request in self.asked:
            self.flight.receive(Answer(request, Result.ACCEPTED), self.now_s)
            match request:
                case Request.ARM:
                    self.armed = True
                case Request.OFFBOARD:
                    self.switch(M.OFFBOARD)
                case Request.TAKEOFF:
                    self.switch(self.traits.climbs_in)
                    self.altitude_m = 0.5
                case Request.LAND:
                    self.switch(M.LAND)
        if 0.0 < self.altitude_m < ALTITUDE_M and self.mode is self.traits.climbs_in:
            self.altitude_m = min(ALTITUDE_M, self.altitude_m + 0.5)
        elif self.mode is M.TAKEOFF:
            self.switch(M.HOLD)

    def until(self, what: Callable[[Vehicle], bool], phase: SwarmPhase, *, land_now: bool = False) -> None:
        for _ in range(400):
            if what(self):
                return
            self.tick(phase, land_now=land_now)
        raise AssertionError(self.flight.state)


def is_in(state: FlightState) -> Callable[[Vehicle], bool]:
    return lambda vehicle: vehicle.flight.state is state


# Each brings a vehicle there; airborne or armed, so that a pilot's mode means something.
def arming(v: Vehicle) -> None:
    v.until(is_in(FlightState.TAKING_OFF), SwarmPhase.GATHER)


def armed(v: Vehicle) -> None:
    v.until(lambda v: v.armed, SwarmPhase.GATHER)


def climbing(v: Vehicle) -> None:
    v.until(lambda v: v.altitude_m > 2.0, SwarmPhase.GATHER)


def in_phase(phase: SwarmPhase, state: FlightState) -> Callable[[Vehicle], None]:
    def bring(v: Vehicle) -> None:
        v.until(is_in(FlightState.GATHERING), SwarmPhase.GATHER)
        v.until(is_in(state), phase)

    return bring


def landing(v: Vehicle) -> None:
    in_phase(SwarmPhase.TRANSIT, FlightState.TRANSIT)(v)
    v.until(is_in(FlightState.LANDING), SwarmPhase.TRANSIT, land_now=True)


def descending(v: Vehicle) -> None:
    landing(v)
    v.until(lambda v: v.mode is M.LAND, SwarmPhase.TRANSIT, land_now=True)
    v.tick(SwarmPhase.TRANSIT, land_now=True)


def interrupted(v: Vehicle) -> None:
    in_phase(SwarmPhase.TRANSIT, FlightState.TRANSIT)(v)
    v.flight.stall()


def interrupted_climb(v: Vehicle) -> None:
    climbing(v)
    v.flight.stall()


def interrupted_before_offboard(v: Vehicle) -> None:
    v.until(is_in(FlightState.HOLD), SwarmPhase.GATHER)
    v.flight.stall()


def interrupted_landing(v: Vehicle) -> None:
    landing(v)
    v.flight.stall()


def released(v: Vehicle) -> None:
    in_phase(SwarmPhase.TRANSIT, FlightState.TRANSIT)(v)
    v.switch(M.OTHER, "ANOTHER")
    v.until(is_in(FlightState.RELEASED), SwarmPhase.TRANSIT)


PLACES = {
    "arming": arming,
    "armed": armed,
    "climbing": climbing,
    "hold": in_phase(SwarmPhase.ASSEMBLE, FlightState.HOLD),
    "gathering": in_phase(SwarmPhase.GATHER, FlightState.GATHERING),
    "transit": in_phase(SwarmPhase.TRANSIT, FlightState.TRANSIT),
    "coverage": in_phase(SwarmPhase.COVERAGE, FlightState.COVERAGE),
    "returning": in_phase(SwarmPhase.RETURN, FlightState.RETURNING),
    "landing": landing,
    "descending": descending,
    "interrupted": interrupted,
    "interrupted climb": interrupted_climb,
    "interrupted before OFFBOARD": interrupted_before_offboard,
    "interrupted landing": interrupted_landing,
    "released": released,
}
MAKES = {"PX4": PX4.traits, "ArduPilot": ARDUPILOT.traits}
PILOTS = [(M.OTHER, "STICKS"), (M.RETURN, ""), (M.LAND, ""), (M.HOLD, ""), (M.TAKEOFF, "")]
PHASES = list(SwarmPhase)
FLIGHTS, TICKS = 5, 40


def is_what_was_asked_for(place: str, make: str, mode: FlightMode) -> bool:
    """These look as the companion's own requests do: nobody can tell."""
    if place in ("arming", "armed") and make == "PX4":
        return mode is M.TAKEOFF
    if place in ("climbing", "interrupted climb") and make == "PX4":
        return mode is M.TAKEOFF
    if place == "interrupted before OFFBOARD" and make == "PX4":
        return mode is M.HOLD  # in which the climb ends
    return place in ("landing", "descending", "interrupted landing") and mode is M.LAND


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("mode", "name"), PILOTS)
def test_after_a_pilots_mode_nothing_is_sent_or_asked_for(make: str, place: str, mode: FlightMode, name: str) -> None:
    if is_what_was_asked_for(place, make, mode):
        return
    there = Vehicle(MAKES[make])
    PLACES[place](there)
    there.switch(mode, name)
    there.obeys = False
    wishes = random.Random(f"{make}, {place}, {mode}, {name}")
    for _ in range(FLIGHTS):
        vehicle = deepcopy(there)
        for _ in range(TICKS):
            land_now, hold, may_join = wishes.choices((False, True), k=3)
            vehicle.tick(wishes.choice(PHASES), land_now=land_now, hold=hold, may_join=may_join)
            assert vehicle.flight.state is FlightState.RELEASED
            assert not vehicle.flight.steers
            assert vehicle.asked == []
        # ... not even when the pilot looks in at the modes that the companion knows.
        for then in FlightMode:
            for failsafe in (False, True):
                vehicle.switch(then, failsafe=failsafe)
                vehicle.tick(SwarmPhase.TRANSIT)
                assert (vehicle.flight.steers, vehicle.asked) == (False, [])


@pytest.mark.parametrize("make", MAKES)
@pytest.mark.parametrize("place", PLACES)
def test_handed_back_in_a_mode_that_it_may_leave_the_vehicle_is_steered_again(make: str, place: str) -> None:
    vehicle = Vehicle(MAKES[make])
    PLACES[place](vehicle)
    vehicle.switch(M.OTHER, "STICKS")
    vehicle.until(is_in(FlightState.RELEASED), SwarmPhase.TRANSIT)
    vehicle.armed, vehicle.altitude_m = True, ALTITUDE_M
    vehicle.switch(M.HOLD)
    vehicle.tick(SwarmPhase.TRANSIT)
    assert not vehicle.flight.steers
    vehicle.flight.hand_back()
    vehicle.until(is_in(FlightState.TRANSIT), SwarmPhase.TRANSIT)
    assert vehicle.flight.state in STEERED
    assert vehicle.flight.steers
