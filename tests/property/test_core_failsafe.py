"""The table of failsafes: of any set of causes the one that stands highest decides, in the table and in a flight."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.model.actions import Ask, Say
from companion.core.model.events import AutopilotHealth, AutopilotMode, Landed, Position
from companion.core.model.states import FlightMode, FlightState, LandedState, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import ROWS, TABLE, Cause, Clear, Finding, Response
from companion.core.vehicle.flight import Flight
from companion.mavlink.makes.px4 import PX4

GAP_SHOWN_S = failsafe_engine.row(Cause.SETPOINTS_CUT).lingers_s
TICK_S = 0.05
causes = st.sets(st.sampled_from(Cause)).map(list)
FROM_OUTSIDE = [
    Cause.LAND_ALL,
    Cause.BATTERY_CRITICAL,
    Cause.ALONE_LONG,
    Cause.NO_MAJORITY_LONG,
    Cause.OBSTACLES_LOST,
    Cause.SWARM_LANDS,
    Cause.NO_POSITION,
    Cause.TELEMETRY_LATE,
    Cause.OBSTACLES_STALE,
    Cause.NO_HEARTBEAT,
    Cause.OPERATOR_HOLDS,
    Cause.NO_NEIGHBOUR,
    Cause.NO_LEADER,
    Cause.NO_MAJORITY,
    Cause.BATTERY_LOW,
]
# What the autopilot shows -> what is found in that.
SHOWN = {
    (FlightMode.OFFBOARD, True, False): None,
    (FlightMode.OFFBOARD, False, False): Cause.DISARMED_IN_AIR,
    (FlightMode.OTHER, True, False): Cause.PILOT_MODE,
    (FlightMode.HOLD, True, False): Cause.PILOT_MODE,
    (FlightMode.RETURN, True, True): Cause.FAILSAFE_MODE,
    (FlightMode.HOLD, True, True): Cause.FAILSAFE_HOLD,
}
LEADS_TO = {
    Response.LISTEN: FlightState.WAITING,
    Response.END: FlightState.LANDED,
    Response.RELEASE: FlightState.RELEASED,
    Response.LAND: FlightState.LANDING,
    Response.REST: FlightState.HOLD,
    Response.HOLD: FlightState.HOLD,
    Response.RESIGN: FlightState.TRANSIT,
}


def test_rows_stand_in_the_order_of_their_precedence_and_every_cause_has_one() -> None:
    assert [row.cause for row in TABLE] == sorted(Cause)
    assert all(row.when and (row.until or row.clear is not Clear.GONE) for row in TABLE)
    assert all(len(row.text.encode()) <= 50 for row in TABLE)
    assert {row.response for row in TABLE} == set(Response)


def test_times_in_the_texts_of_a_row_are_its_own_values() -> None:
    written = {row.cause.name: f"{row.when}; {row.text}; {row.until}" for row in ROWS}
    assert {
        cause: found for cause, text in written.items() if (found := re.findall(r"[0-9.]+ (?:s|periods)\b", text))
    } == {}
    assert not any("_s}" in f"{row.when}{row.text}{row.until}" for row in TABLE)
    assert failsafe_engine.row(Cause.OBSTACLES_LOST).text == "land: no obstacle scan for 60 s"
    assert failsafe_engine.row(Cause.TELEMETRY_LATE).until == "they are less than 0.2 s under way"


@given(causes, st.randoms(use_true_random=False))
def test_what_stands_highest_decides_whatever_else_is_found_in_whatever_order(found: list[Cause], rng: object) -> None:
    rng.shuffle(found)  # type: ignore[attr-defined]
    findings = [Finding(cause) for cause in found]
    decides = failsafe_engine.decide(findings)
    assert decides == (Finding(min(found, key=[row.cause for row in TABLE].index)) if found else None)
    if decides is not None:  # and when that one is gone, the next
        findings.remove(decides)
        after = failsafe_engine.decide(findings)
        assert after is None or after.cause > decides.cause


@given(causes)
def test_rest_and_resignation_hold_whichever_cause_decides(found: list[Cause]) -> None:
    findings = [Finding(cause) for cause in found]
    blind = {row.cause for row in TABLE if row.response is Response.REST}
    unfit = {row.cause for row in TABLE if row.resigns}
    assert failsafe_engine.rests(findings) == bool(blind & set(found))
    assert failsafe_engine.resigns(findings) == bool(unfit & set(found))


def test_a_vehicle_that_is_blind_or_short_of_charge_does_not_lead() -> None:
    demands = {row.cause for row in TABLE if row.response in (Response.REST, Response.RESIGN)}
    unfit = {row.cause for row in TABLE if row.resigns}
    assert {Cause.NO_POSITION, Cause.TELEMETRY_LATE, Cause.OBSTACLES_STALE, Cause.BATTERY_LOW} <= demands
    assert demands | {Cause.BATTERY_CRITICAL} <= unfit


class Steered:
    """A flight in transit over its autopilot, as far as the table needs one."""

    def __init__(self) -> None:
        self.flight, self.now_s = Flight(8.0), 100.0
        self.shown = (FlightMode.OFFBOARD, True, False)
        self.step([], may_join=True)
        for _ in range(round(GAP_SHOWN_S / TICK_S) + 2):  # until the first message ends no gap any more
            self.step([])
        assert self.flight.state is FlightState.TRANSIT

    def step(self, found: list[Cause], *, may_join: bool = False, gap_s: float = 0.0) -> list[Ask | Say]:
        self.now_s += TICK_S + gap_s
        mode, armed, by_failsafe = self.shown
        self.flight.receive(AutopilotMode(mode, armed, mode.name, by_failsafe, PX4.traits), self.now_s)
        self.flight.receive(AutopilotHealth(True, 80), self.now_s)
        self.flight.receive(Landed(LandedState.IN_AIR), self.now_s)
        self.flight.receive(Position((0.0, 0.0, -8.0), ZERO), self.now_s)
        findings = [Finding(cause) for cause in found]
        return self.flight.update_flight(
            SwarmPhase.TRANSIT, self.now_s, findings=findings, may_join=may_join, may_take_off=True
        )


@given(st.sampled_from(list(SHOWN)), st.booleans(), st.sets(st.sampled_from(FROM_OUTSIDE)).map(list))
def test_a_steered_flight_does_what_the_row_says_that_stands_highest(
    shown: tuple[FlightMode, bool, bool], cut_off: bool, given_to_it: list[Cause]
) -> None:
    one = Steered()
    one.shown = shown
    found = set(given_to_it)
    if SHOWN[shown] is not None:
        found.add(SHOWN[shown])
    if cut_off and shown == (FlightMode.HOLD, True, True):
        found.add(Cause.SETPOINTS_CUT)
    out = one.step(given_to_it, gap_s=0.5 if cut_off else 0.0)
    if not found:
        assert (one.flight.state, one.flight.cause, one.flight.steers, out) == (FlightState.TRANSIT, None, True, [])
        return
    row = failsafe_engine.row(min(found))
    assert one.flight.cause is row.cause
    assert one.flight.state is LEADS_TO[row.response]
    assert one.flight.steers is (row.response not in (Response.LISTEN, Response.RELEASE))
    said = [action for action in out if isinstance(action, Say)]
    if row.text and row.cause is not Cause.TELEMETRY_LATE:
        assert [say.severity for say in said] == [row.severity]
        assert said[0].text.startswith(row.text.partition("{}")[0])
    else:  # late telemetry is told of by the vehicle, in every state
        assert said == []


@pytest.mark.parametrize(
    "cause", [c for c in FROM_OUTSIDE if failsafe_engine.row(c).response in (Response.HOLD, Response.REST)]
)
def test_hold_ends_with_its_cause_and_is_said_again_when_that_comes_back(cause: Cause) -> None:
    one = Steered()
    texts = []
    for found in ([cause], [cause], [], [cause]):
        texts.append([a.text for a in one.step(found) if isinstance(a, Say)])
        assert one.flight.state is (FlightState.HOLD if found else FlightState.TRANSIT)
        assert one.flight.cause is (cause if found else None)
    assert texts[1:3] == [[], []]
    assert texts[0] == texts[3]
