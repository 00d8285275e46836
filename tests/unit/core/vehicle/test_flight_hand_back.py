"""A pilot is above all: what is not asked for while the flight mode is not known."""

from __future__ import annotations

import pytest

from companion.core.model.states import Request
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from companion.core.vehicle.requests import RETRY_S
from tests.unit.core.core_flight_kit import Bench, M, S, asked_to_arm, asked_to_climb, landing, released, streaming

HEARTBEAT_LOST_S = failsafe_engine.row(Cause.NO_HEARTBEAT).delay_s


def test_only_a_heartbeat_after_a_hand_back_tells_whose_the_mode_is() -> None:
    bench = released().seconds(2.0)
    bench.flight.hand_back()
    bench.seconds(0.9, heartbeat=False)  # its pilot has put it into HOLD, and the next HEARTBEAT will say so
    assert (bench.state, bench.flight.steers, bench.asked, bench.texts) == (S.HOLD, False, [], [])
    bench.tick(heartbeat=True, mode=M.HOLD)
    assert (bench.state, bench.flight.steers) == (S.HOLD, True)
    assert bench.seconds(RETRY_S).requests == [Request.OFFBOARD]


def test_one_handed_back_that_its_pilot_still_flies_stays_the_pilots() -> None:
    bench = released().seconds(2.0)
    bench.flight.hand_back()
    bench.seconds(3.0)
    assert bench.state is S.RELEASED
    assert bench.asked == []


@pytest.mark.parametrize("silent", [True, False])
def test_one_handed_back_without_a_heartbeat_is_sent_nothing(silent: bool) -> None:
    bench = released().seconds(2.0, mode=M.HOLD).seconds(2.0, heartbeat=False, silent=silent)
    bench.flight.hand_back()
    bench.seconds(60.0)
    assert bench.asked == []
    assert not bench.flight.steers
    assert bench.state is S.WAITING
    assert bench.texts[-1] == "waiting: no autopilot heartbeat"


@pytest.mark.parametrize("make", [streaming, asked_to_arm, asked_to_climb])
def test_nothing_is_asked_for_again_while_the_mode_is_not_known(make: type[Bench]) -> None:
    bench = make().seconds(HEARTBEAT_LOST_S + 0.1, heartbeat=False)
    assert bench.seconds(20.0).asked == []


def test_a_landing_is_asked_for_but_once_while_the_mode_is_not_known() -> None:
    bench = streaming().seconds(HEARTBEAT_LOST_S + 0.1, heartbeat=False).seconds(20.0, land_now=True)
    assert bench.requests == [Request.LAND]
    assert landing().seconds(20.0).requests.count(Request.LAND) > 5
