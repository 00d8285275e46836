"""Values of other sensors become records with the tick's place; on the ground, and without records, none."""

from __future__ import annotations

from typing import Any

import pytest

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing import wire
from companion.payload.recorder import payload_of
from companion.payload.sample import PAYLOAD_KIND, PayloadSample, decode_sample
from companion.sensors.table import sensors_of
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import HOME, ME, heartbeat, packed, position
from tests.unit.mavlink.test_endpoint_survey import Kept

FLOWN = mission(payload=[{"name": "light", "unit": "lx", "source": "NAMED_VALUE_FLOAT.light"}])
IN_AIR = dialect.MAVLink_extended_sys_state_message(0, dialect.MAV_LANDED_STATE_IN_AIR)
ON_GROUND = dialect.MAVLink_extended_sys_state_message(0, dialect.MAV_LANDED_STATE_ON_GROUND)


def light(value: float) -> bytes:
    message = dialect.MAVLink_named_value_float_message(0, b"light", value)
    return wire.pack(message, seq=0, system=ME, component=158)


def flown(kept: Kept | None, *states: Any) -> Endpoint:
    link: Any = kept
    one = Endpoint(FLOWN, ME, sensors=sensors_of(FLOWN), payload=payload_of(FLOWN, ME), records=link)
    one.from_autopilot(packed(HOME, position(), heartbeat(), *states), 1.0)
    one.from_sensor(light(700.0), 1.0)
    return one


def test_a_value_becomes_a_record_with_the_ticks_place() -> None:
    kept = Kept()
    one = flown(kept, IN_AIR)
    one.tick(1.0)
    ((kind, body, now_s),) = kept.bodies
    sample = decode_sample(body, ME)
    own = one.agent.flight.vehicle.position
    assert own is not None
    assert (kind, now_s) == (PAYLOAD_KIND, 1.0)
    assert sample == PayloadSample(ME, "light", "lx", 700.0, own.pos_ned_m[0], own.pos_ned_m[1], 8.0, 1.0)


def test_on_the_ground_nothing_is_recorded() -> None:
    kept = Kept()
    flown(kept, ON_GROUND).tick(1.0)
    assert kept.bodies == []


def test_a_position_that_is_old_places_nothing_and_the_operator_is_told() -> None:
    kept = Kept()
    one = flown(kept, IN_AIR)
    one.tick(1.0)
    one.from_sensor(light(700.0), 9.0)
    out = one.tick(9.0)
    assert len(kept.bodies) == 1
    assert "payload: position unknown: not recorded" in [say.text for say in out.said]


def test_a_companion_without_records_flies_as_without_payload() -> None:
    one = flown(None, IN_AIR)
    out = one.tick(1.0)
    assert not any("payload" in say.text for say in out.said)


def test_an_error_of_the_payload_stops_its_records_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise ZeroDivisionError("nothing")

    monkeypatch.setattr("companion.mavlink.harvest.payload_place_of", refuse)
    one = flown(Kept(), IN_AIR)
    said = [say.text for k in range(3) for say in one.tick(1.0 + 0.05 * k).said]
    assert said.count("payload: stopped by an error") == 1
    assert one.payload is not None
    assert one.payload.error.startswith("ZeroDivisionError: nothing (test_endpoint_payload.py:")
