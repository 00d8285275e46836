"""A second flight on PX4: a landing leaves it in OFFBOARD, where it is not ready to arm."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.states import FlightState
from companion.mavlink import dialect
from companion.mavlink.autopilot_link.ground_hold import ASKS_MAX, RETRY_S, TEXT
from companion.mavlink.endpoint import Endpoint
from sim_bridge.world.autopilot import Link
from tests.unit.mavlink.endpoint_kit import HOME, TICK_S, endpoint, packed, position, read
from tests.unit.world.autopilot.px4.px4_pilot import ACCEPTED, LAND, STEP_S, Pilot

OFFBOARD, HOLD, POSCTL = 6 << 16, 4 << 16 | 3 << 24, 3 << 16
GUIDED = 4
READY = 1 << 28  # SYS_STATUS: the prearm bit
LANDED = dialect.MAVLink_extended_sys_state_message(0, 1)
IN_AIR = dialect.MAVLink_extended_sys_state_message(0, 2)


def heartbeat(custom_mode: int, *, armed: bool = False, make: int = 12) -> Any:
    return dialect.MAVLink_heartbeat_message(2, make, 0x81 if armed else 0x01, custom_mode, 0, 3)


def health(bits: int) -> Any:
    return dialect.MAVLink_sys_status_message(0, 0, bits, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0)


def modes_asked(
    one: Endpoint, *told: Any, seconds: float = 10.0, from_s: float = 10.0
) -> list[tuple[float, tuple[float, float, float]]]:
    """When it asks for another mode, and for which, while its autopilot tells the same."""
    asked = []
    one.from_autopilot(packed(HOME), from_s)
    for k in range(round(seconds / TICK_S)):
        now_s = from_s + k * TICK_S
        one.from_autopilot(packed(position(boot_ms=round(now_s * 1e3)), *told), now_s)
        asked += [
            (now_s, (m.param1, m.param2, m.param3))
            for m in read(one.tick(now_s).autopilot)
            if m.get_type() == "COMMAND_LONG" and m.command == dialect.MAV_CMD_DO_SET_MODE
        ]
    return asked


def test_the_bridges_px4_that_flew_is_ready_for_the_next_companion() -> None:
    pilot = Pilot().take_off(3.0).go_offboard()
    assert pilot.command(LAND) == ACCEPTED
    pilot.fly_until_disarmed(30.0)
    pilot.fly(60.0)
    assert pilot.modes[-1] == (OFFBOARD, 0)  # as recorded: UNINIT, for as long as nobody asks
    one, said = endpoint(), []
    for _ in range(round(6.0 / STEP_S)):
        out = one.tick(pilot.now_s)
        said += [say.text for say in out.said]
        pilot.autopilot.receive(Link.ONBOARD, out.autopilot, pilot.now_s)
        pilot.autopilot.update(pilot.now_s)
        pilot.body.step(STEP_S)
        pilot.steps += 1
        for datagram in pilot.autopilot.transmit(Link.ONBOARD, pilot.now_s):
            one.from_autopilot(datagram, pilot.now_s)
    assert (one.agent.flight.state, pilot.mode) == (FlightState.READY, "HOLD")
    assert said[:2] == [TEXT, "ready"]


def test_hold_is_asked_for_a_few_times_while_it_does_not_show() -> None:
    asked = modes_asked(endpoint(), heartbeat(OFFBOARD), health(0), LANDED, seconds=30.0)
    assert [mode for _, mode in asked] == [(1, 4, 3)] * ASKS_MAX
    times_s = [at_s for at_s, _ in asked]
    assert times_s == pytest.approx([times_s[0] + k * RETRY_S for k in range(ASKS_MAX)])


@pytest.mark.parametrize(
    "told",
    [
        (heartbeat(OFFBOARD), health(READY), LANDED),  # somebody streams: it can be armed as it is
        (heartbeat(HOLD), health(0), LANDED),
        (heartbeat(POSCTL), health(0), LANDED),  # the pilot's
        (heartbeat(OFFBOARD, armed=True), health(0), LANDED),
        (heartbeat(OFFBOARD), health(0), IN_AIR),  # disarmed: it falls
        (heartbeat(OFFBOARD), health(0)),  # where it is has not been told
        (heartbeat(OFFBOARD), LANDED),  # whether it is ready neither
        (heartbeat(GUIDED, make=3), health(0), LANDED),  # ArduPilot arms in GUIDED
    ],
)
def test_no_other_mode_is_ever_touched(told: tuple[Any, ...]) -> None:
    assert modes_asked(endpoint(), *told) == []


def test_a_vehicle_that_was_taken_over_is_its_pilots() -> None:
    one = endpoint()
    one.agent.flight.state = FlightState.RELEASED
    assert modes_asked(one, heartbeat(OFFBOARD), health(0), LANDED) == []


def test_a_mode_that_was_told_long_ago_may_be_another_by_now() -> None:
    one = endpoint()
    assert modes_asked(one, heartbeat(OFFBOARD), health(READY), LANDED, seconds=1.0) == []
    assert modes_asked(one, health(0), LANDED, from_s=15.0) == []
