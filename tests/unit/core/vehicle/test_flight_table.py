"""The table of flight states: closed, and at one with the table of failsafes."""

from __future__ import annotations

import itertools

import pytest

from companion.core.model.states import STEERED, FlightState, SwarmPhase
from companion.core.vehicle.failsafe import TABLE, Clear, Response
from companion.core.vehicle.flight_table import (
    EVENT_OF_PHASE,
    EVENT_OF_RESPONSE,
    TRANSITIONS,
    FlightEvent,
    transition,
)

S, E = FlightState, FlightEvent
# What ends each response that takes a vehicle out of what it does: the events that lead on from the state it leads to.
EXITS = {
    Clear.JOINED: {E.CHECKS_PASS, E.JOIN},
    Clear.HANDED_BACK: {E.HAND_BACK_IN_AIR, E.HAND_BACK_ON_GROUND},
    Clear.LANDED: {E.DISARM},
    Clear.RESTARTED: set(),
}
NEVER_MIND = {E.LISTEN, E.LISTEN_ON, E.RELEASE, E.LAND}  # another failsafe's


@pytest.mark.parametrize(("state", "event"), list(itertools.product(FlightState, FlightEvent)))
def test_every_event_in_every_state_has_a_row_or_is_refused(state: FlightState, event: FlightEvent) -> None:
    row = TRANSITIONS[state].get(event)
    if row is not None:
        assert transition(state, event) is row
        return
    with pytest.raises(ValueError, match=f"{state.name}: {event.name} is refused"):
        transition(state, event)


def test_every_event_leads_somewhere_and_every_state_is_reached_from_the_first() -> None:
    assert {event for rows in TRANSITIONS.values() for event in rows} == set(FlightEvent)
    reached, new = {S.WAITING}, {S.WAITING}
    while new:
        new = {row.state for state in new for row in TRANSITIONS[state].values()} - reached
        reached |= new
    assert reached == set(FlightState)


def test_every_phase_has_its_event_in_every_state_that_is_steered() -> None:
    assert set(EVENT_OF_PHASE) == set(SwarmPhase)
    for state in STEERED:
        assert set(EVENT_OF_PHASE.values()) <= set(TRANSITIONS[state])
        assert all(TRANSITIONS[state][event].state in STEERED for event in EVENT_OF_PHASE.values())


def test_a_vehicle_is_taken_from_its_pilot_by_a_hand_back_alone_and_flies_no_more_once_it_has_landed() -> None:
    assert set(TRANSITIONS[S.RELEASED]) == EXITS[Clear.HANDED_BACK]
    assert TRANSITIONS[S.LANDED] == {}


def test_what_clears_a_failsafe_is_what_leads_out_of_the_state_that_it_leads_to() -> None:
    for row in TABLE:
        event = EVENT_OF_RESPONSE.get(row.response)
        if event is None:
            assert row.clear is Clear.GONE
            continue
        states = {rows[event].state for rows in TRANSITIONS.values() if event in rows}
        assert len(states) == 1
        exits = set(TRANSITIONS[states.pop()]) - NEVER_MIND
        if row.response is Response.LAND:  # an order to land, once given, holds until the companion is started again
            assert (exits, row.clear in (Clear.LANDED, Clear.RESTARTED)) == ({E.DISARM}, True)
        else:
            assert exits == EXITS[row.clear]
