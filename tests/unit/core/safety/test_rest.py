"""A vehicle that is to rest: it stays where it came to rest, whatever its reported velocity says."""

from __future__ import annotations

import math

import pytest

from companion.core.model.events import Position
from companion.core.model.vectors import ZERO
from companion.core.safety.rest import AGAIN_S, BRAKES_S, JUMPS_M, PULL_MAX_MPS, SLACK_M, STANDS_MPS, RestHold

TICK_S = 0.05


def at(north_m: float, east_m: float = 0.0, speed_mps: float = 0.0) -> Position:
    return Position((north_m, east_m, -4.0), (speed_mps, 0.0, 0.0))


def test_it_brakes_first() -> None:
    rest = RestHold()
    for k in range(20):
        assert rest.hold(at(0.1 * k, speed_mps=2.0 - 0.08 * k), ZERO, TICK_S * k) == ZERO


def test_what_is_known_of_the_velocitys_error_is_taken_off() -> None:
    assert RestHold().hold(at(0.0, speed_mps=1.0), (0.25, -0.5, 0.1), 0.0) == (-0.25, 0.5, 0.0)


def test_one_that_never_stands_has_a_place_all_the_same() -> None:
    rest = RestHold()
    for k in range(round(BRAKES_S / TICK_S) + 2):
        rest.hold(at(0.0, speed_mps=0.6), ZERO, TICK_S * k)
    assert rest.hold(at(1.2, speed_mps=0.6), ZERO, TICK_S * (k + 1))[0] == pytest.approx(-PULL_MAX_MPS)


def test_a_position_that_jumps_moves_nobody() -> None:
    """It would fly blindly, by as much as its estimator has found out."""
    rest = RestHold()
    rest.hold(at(0.0), ZERO, 0.0)
    assert rest.hold(at(JUMPS_M + 0.1), ZERO, TICK_S) == ZERO
    assert rest.hold(at(JUMPS_M + 0.2), ZERO, 2 * TICK_S) == ZERO


def test_it_goes_back_to_where_it_came_to_rest_slowly() -> None:
    rest = RestHold()
    assert rest.hold(at(5.0, speed_mps=STANDS_MPS), ZERO, 0.0) == ZERO
    assert rest.hold(at(5.0 + 0.9 * SLACK_M), ZERO, TICK_S) == ZERO
    vel = rest.hold(at(5.0, 1.2), ZERO, 2 * TICK_S)
    assert vel[1] == pytest.approx(-PULL_MAX_MPS)
    assert (vel[0], vel[2]) == (0.0, 0.0)


def test_with_a_velocity_that_is_reported_wrongly_it_stays_all_the_same() -> None:
    """By zero velocity alone it would drift by 5 m."""
    rest, north_m = RestHold(), 0.0
    for k in range(400):
        commanded = rest.hold(at(north_m), ZERO, TICK_S * k)
        north_m += (commanded[0] + 0.25) * TICK_S  # it flies by what its autopilot takes for its velocity
    assert 0.0 < north_m < 0.7


def test_another_rest_has_another_place() -> None:
    rest = RestHold()
    rest.hold(at(0.0), ZERO, 0.0)
    later_s = AGAIN_S + 1.0
    assert rest.hold(at(9.0), ZERO, later_s) == ZERO
    assert rest.hold(at(9.0), ZERO, later_s + TICK_S) == ZERO


def test_while_its_position_is_old_it_only_brakes() -> None:
    rest = RestHold()
    rest.hold(at(0.0), ZERO, 0.0)
    assert rest.hold(None, ZERO, TICK_S) == ZERO
    assert rest.hold(at(3.0), ZERO, 2 * TICK_S) == ZERO  # its place is forgotten


def test_no_number_moves_nothing() -> None:
    rest = RestHold()
    rest.hold(at(0.0), ZERO, 0.0)
    assert rest.hold(at(math.nan), ZERO, TICK_S) == ZERO
