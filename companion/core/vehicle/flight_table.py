"""The state machine of one vehicle's flight: state and event -> next state and effects. `Flight` runs it.

What is not in the table is refused: it raises, as a broken invariant does.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from companion.core.model.states import STEERED, FlightState, SwarmPhase
from companion.core.vehicle.failsafe import Response


class FlightEvent(Enum):
    """Events that move a flight on; the value says so in words."""

    CHECKS_PASS = "on the ground, it has all that it takes to fly"
    CHECKS_FAIL = "before it has asked for the climb it lacks something again, may not fly, or is armed by another"
    TAKE_OFF = "the swarm takes off, or flies"
    CLIMB_ENDS = "at its altitude the autopilot has ended the climb; or another that flies is too near"
    JOIN = "in the air, it hears its autopilot and a leader that flies"
    HOLD = "a failsafe has it hold, or its phase or its autopilot is not there yet"
    GATHER = "the swarm gathers at d1"
    TRANSIT = "the swarm is on its way to d2"
    COVER = "the swarm covers d2"
    RETURN = "the swarm returns to d1"
    SEEK = "a failsafe has it look for the others"
    LAND = "a failsafe has it land"
    DISARM = "the landing ends: disarmed"
    LISTEN = "a failsafe has it listen first"
    LISTEN_ON = "the same, while the climb or the landing goes on that it has asked for"
    RELEASE = "a failsafe gives it to the pilot, or to the autopilot"
    END = "a failsafe ends the flight: its motors are off"
    HAND_BACK_IN_AIR = "an operator hands it back, in the air"
    HAND_BACK_ON_GROUND = "an operator hands it back, on the ground"


class Effect(Enum):
    """Effects of a transition, in the order of the row; the value says so in words."""

    START_OVER = "forgets what it has seen of this flight"
    LISTEN = "sends no setpoints; only a HEARTBEAT after this counts"
    STOP = "sends no setpoints"
    STREAM = "streams setpoints"
    CLIMBS_ON = "need not see the climb begin"
    AWAIT_FAILSAFE_END = "streams first, to see the autopilot's failsafe end by itself"
    OVERRULE_FAILSAFE = "takes the autopilot's hold as the operator's wish to be steered"
    CLEAR_CAUSE = "has no failsafe that decides"


class Transition(NamedTuple):
    """One row's right side."""

    state: FlightState
    effects: tuple[Effect, ...] = ()


S, E, F = FlightState, FlightEvent, Effect
LISTENS = Transition(S.WAITING, (F.START_OVER, F.LISTEN))
RELEASES = Transition(S.RELEASED, (F.STOP,))
LANDS = Transition(S.LANDING)
ENDS = Transition(S.LANDED)
IN_FLIGHT: dict[FlightEvent, Transition] = {
    E.HOLD: Transition(S.HOLD),
    E.GATHER: Transition(S.GATHERING),
    E.TRANSIT: Transition(S.TRANSIT),
    E.COVER: Transition(S.COVERAGE),
    E.RETURN: Transition(S.RETURNING),
    E.SEEK: Transition(S.SEEKING),
    E.LAND: LANDS,
    E.LISTEN: LISTENS,
    E.RELEASE: RELEASES,
    E.END: ENDS,
}
TRANSITIONS: dict[FlightState, dict[FlightEvent, Transition]] = {
    S.WAITING: {
        E.CHECKS_PASS: Transition(S.READY, (F.CLEAR_CAUSE,)),
        E.JOIN: Transition(S.HOLD, (F.AWAIT_FAILSAFE_END, F.CLEAR_CAUSE)),
        E.LAND: LANDS,
        E.LISTEN: LISTENS,
        E.RELEASE: RELEASES,
    },
    S.READY: {
        E.CHECKS_FAIL: Transition(S.WAITING),
        E.TAKE_OFF: Transition(S.TAKING_OFF),
        E.LISTEN: LISTENS,
    },
    S.TAKING_OFF: {
        E.CHECKS_FAIL: Transition(S.WAITING, (F.START_OVER, F.STOP)),
        E.CLIMB_ENDS: Transition(S.HOLD, (F.STREAM,)),
        E.LAND: LANDS,
        E.LISTEN: LISTENS,
        E.LISTEN_ON: Transition(S.TAKING_OFF, (F.CLIMBS_ON, F.LISTEN)),
        E.RELEASE: RELEASES,
        E.END: ENDS,
    },
    **{state: IN_FLIGHT for state in FlightState if state in STEERED},
    S.LANDING: {
        E.DISARM: ENDS,
        E.LISTEN_ON: Transition(S.LANDING, (F.LISTEN,)),
        E.RELEASE: RELEASES,
    },
    S.RELEASED: {
        E.HAND_BACK_IN_AIR: Transition(S.HOLD, (F.START_OVER, F.LISTEN, F.OVERRULE_FAILSAFE, F.CLEAR_CAUSE)),
        E.HAND_BACK_ON_GROUND: Transition(S.WAITING, (F.START_OVER, F.LISTEN, F.OVERRULE_FAILSAFE, F.CLEAR_CAUSE)),
    },
    S.LANDED: {},
}
EVENT_OF_PHASE = {
    SwarmPhase.ASSEMBLE: E.HOLD,
    SwarmPhase.GATHER: E.GATHER,
    SwarmPhase.TRANSIT: E.TRANSIT,
    SwarmPhase.COVERAGE: E.COVER,
    SwarmPhase.RETURN: E.RETURN,
    SwarmPhase.LAND: E.HOLD,
}
# Responses that take the vehicle out of what it does. LISTEN: LISTEN_ON, where the autopilot goes on by itself.
EVENT_OF_RESPONSE = {
    Response.LISTEN: E.LISTEN,
    Response.RELEASE: E.RELEASE,
    Response.LAND: E.LAND,
    Response.END: E.END,
}


def transition(state: FlightState, event: FlightEvent) -> Transition:
    """The row of a state and an event; ValueError: refused."""
    row = TRANSITIONS[state].get(event)
    if row is None:
        raise ValueError(f"flight state {state.name}: {event.name} is refused")
    return row
