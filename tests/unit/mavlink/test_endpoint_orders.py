"""Orders at an endpoint: a ground station's commands where there are no keys, messages of the key where there are."""

from __future__ import annotations

from typing import Any

import pytest

from companion.keys.crypto import public_key
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.order import ORDER_ID, OrderKind
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import COMPANION, FLOWING, HOME, ME, heartbeat, packed, placed, read
from tests.unit.mavlink.orders_kit import DIGEST, OPERATOR_SEED, VEHICLE_SEED, Disk, frame, order

BOOT = 4711


def keyed() -> Endpoint:
    """One of a swarm with keys, on the ground."""
    flown = mission()
    book = OrderBook(
        operator=public_key(OPERATOR_SEED), digest=DIGEST, me=ME, size=flown.swarm.size, boot=BOOT, marks=Disk()
    )
    one = Endpoint(flown, ME, orders=book)
    one.from_autopilot(packed(HOME, heartbeat(), *FLOWING), 10.0)
    one.tick(10.0)
    return one


def command(number: int, param1: float = 0.0) -> bytes:
    message = dialect.MAVLink_command_long_message(ME, COMPANION, number, 0, param1, *(0.0,) * 6)
    return packed(message, system=255, component=190)


def ack(out: Any) -> Any:
    (found,) = [m for m in read(out.autopilot) if m.get_type() == "COMMAND_ACK"]
    return found


def start(one: Endpoint, seed: bytes = OPERATOR_SEED) -> bytes:
    size = one.agent.mission.swarm.size
    return order(OrderKind.START, 10, boots={ME: BOOT}, size=size, seed=seed)


@pytest.mark.parametrize("number", [dialect.MAV_CMD_MISSION_START, dialect.MAV_CMD_NAV_LAND])
def test_with_keys_a_command_is_denied_and_the_operator_told_what_to_use(number: int) -> None:
    one = keyed()
    one.from_autopilot(command(number), 10.05)
    out = one.tick(10.05)
    assert ack(out).result == dialect.MAV_RESULT_DENIED
    operator = one.agent.swarm.operator
    assert (operator.started, operator.aborts) == (False, False)
    name = "START" if number == dialect.MAV_CMD_MISSION_START else "ABORT"
    said = [*out.said, *one.tick(10.1).said]
    assert f"{name} needs the operator's key: companion order" in [say.text for say in said]


def test_with_keys_an_order_of_the_key_is_obeyed_with_the_next_tick_and_passed_on_as_it_came() -> None:
    one = keyed()
    payload = start(one)
    one.from_peers(frame(payload), 10.05)
    out = one.tick(10.05)
    assert one.agent.swarm.operator.started
    sent = [m for data in out.records for m in dialect.MAVLink(None).parse_buffer(data)]
    assert [(m.get_msgId(), m.get_srcSystem()) for m in sent] == [(ORDER_ID, ME)] * 2
    assert all(data[10:-2] == payload.rstrip(b"\0") for data in out.records)


def test_with_keys_an_order_of_a_vehicles_key_is_not() -> None:
    one = keyed()
    one.from_peers(frame(start(one, VEHICLE_SEED)), 10.05)
    out = one.tick(10.05)
    assert not one.agent.swarm.operator.started
    assert out.records == []


def test_without_keys_an_order_message_counts_for_nothing() -> None:
    one = placed()
    one.from_peers(frame(start(one)), 10.05)
    assert one.tick(10.05).records == []
    assert not one.agent.swarm.operator.started


@pytest.mark.parametrize(("param1", "holds"), [(0.0, True), (1.0, False)])
def test_without_keys_pause_holds_and_continue_goes_on(param1: float, holds: bool) -> None:
    one = placed()
    one.from_autopilot(command(dialect.MAV_CMD_DO_PAUSE_CONTINUE, param1), 10.05)
    assert ack(one.tick(10.05)).result == dialect.MAV_RESULT_ACCEPTED
    assert one.agent.swarm.operator.holds is holds
    assert one.agent.swarm.operator.started is not holds


def test_pause_of_another_kind_is_unsupported() -> None:
    one = placed()
    one.from_autopilot(command(dialect.MAV_CMD_DO_PAUSE_CONTINUE, 2.0), 10.05)
    assert ack(one.tick(10.05)).result == dialect.MAV_RESULT_UNSUPPORTED
