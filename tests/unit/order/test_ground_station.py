"""A ground station's commands become orders of the key, as pymavlink sends and reads them."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega

from companion.core.model.states import FlightState
from companion.mavlink.orders.order import OrderKind, order_payload, read_order
from companion.order.ground_station import CONFIRM_S, GroundStation
from companion.order.station import OPERATOR_ID, Numbered, OrderFileError
from tests.unit.mavlink.orders_kit import SIZE
from tests.unit.order.test_station import Ground

START, HOLD, LAND, ABORT = OrderKind
M = ardupilotmega


class Gateway:
    """The gateway between both radios."""

    def __init__(self, *ready: int) -> None:
        self.ground = Ground()
        self.lines: list[str] = []
        self.link = GroundStation(self.ground.station, SIZE, self.lines.append)
        for vehicle in ready:
            self.ground.hear(vehicle, state=FlightState.READY, airborne=False)

    def command(self, number: int, param1: float = 0.0, *, system: int = 1, component: int = 191) -> list[Any]:
        mav = M.MAVLink(None, srcSystem=255, srcComponent=190)
        message = M.MAVLink_command_long_message(system, component, number, 0, param1, *(0.0,) * 6)
        self.link.receive(message.pack(mav), self.ground.now_s)
        answers = b"".join(self.link.datagrams(self.ground.now_s))
        return [m for m in M.MAVLink(None).parse_buffer(answers) or [] if m.get_type() != "HEARTBEAT"]

    def ordered(self) -> OrderKind | None:
        sent = self.ground.station.datagrams(self.ground.now_s)
        payload = order_payload(sent[0]) if sent else None
        order = None if payload is None else read_order(payload)
        return None if order is None else order.kind


@pytest.mark.parametrize(
    ("number", "param1", "kind"),
    [
        (M.MAV_CMD_MISSION_START, 0.0, START),
        (M.MAV_CMD_DO_PAUSE_CONTINUE, 0.0, HOLD),
        (M.MAV_CMD_DO_PAUSE_CONTINUE, 1.0, START),
        (M.MAV_CMD_NAV_LAND, 0.0, ABORT),
    ],
)
def test_command_is_ordered_and_answered_as_by_the_vehicle(number: int, param1: float, kind: OrderKind) -> None:
    gateway = Gateway(1, 2, 3, 4)
    ack, text = sorted(gateway.command(number, param1, system=3), key=lambda m: m.get_type())
    assert (ack.command, ack.result, ack.get_srcSystem(), ack.get_srcComponent()) == (number, 0, 3, 191)
    assert (ack.target_system, ack.target_component) == (255, 190)
    assert text.text == f"{kind.name}: ordered"
    assert gateway.ordered() is kind


def test_start_without_some_is_asked_for_twice() -> None:
    gateway = Gateway(1, 2)
    answers = gateway.command(M.MAV_CMD_MISSION_START)
    assert [m.result for m in answers if m.get_type() == "COMMAND_ACK"] == [M.MAV_RESULT_TEMPORARILY_REJECTED]
    assert gateway.lines == ["START again within 10 s to go without 3, 4"]
    assert gateway.ordered() is None
    gateway.ground.now_s += CONFIRM_S + 0.1
    for vehicle in (1, 2):
        gateway.ground.hear(vehicle, state=FlightState.READY, airborne=False)
    gateway.command(M.MAV_CMD_MISSION_START)  # too late: asked anew
    assert gateway.ordered() is None
    gateway.ground.now_s += 1.0
    gateway.command(M.MAV_CMD_MISSION_START)
    assert gateway.ordered() is START


@pytest.mark.parametrize(("system", "component"), [(5, 191), (1, 1), (251, 191)])
def test_command_to_somebody_else_is_neither_ordered_nor_answered(system: int, component: int) -> None:
    gateway = Gateway(1, 2, 3, 4)
    assert gateway.command(M.MAV_CMD_NAV_LAND, system=system, component=component) == []
    assert gateway.ordered() is None


def test_start_that_cannot_be_counted_is_answered_and_the_gateway_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    gateway = Gateway(1, 2, 3, 4)

    def fail(_digest: bytes, _choose: Any, *, only_stops: bool) -> Numbered:
        if only_stops:
            return Numbered(9, bytes(8), "full")
        raise OrderFileError("k.orders: is none")

    monkeypatch.setattr(gateway.ground.station._file, "next_order", fail)
    ack = next(m for m in gateway.command(M.MAV_CMD_MISSION_START) if m.get_type() == "COMMAND_ACK")
    assert ack.result == M.MAV_RESULT_FAILED
    assert gateway.ordered() is None
    ack = next(m for m in gateway.command(M.MAV_CMD_NAV_LAND) if m.get_type() == "COMMAND_ACK")
    assert ack.result == M.MAV_RESULT_ACCEPTED
    assert gateway.ordered() is ABORT
    assert gateway.lines == [
        "START: not ordered: k.orders: is none",
        "ABORT goes out, counted by the clock alone: full",
        "ABORT: ordered",
    ]


def test_command_int_is_ordered_and_answered_too() -> None:
    gateway = Gateway(1, 2, 3, 4)
    mav = M.MAVLink(None, srcSystem=255, srcComponent=190)
    message = M.MAVLink_command_int_message(0, 0, 0, M.MAV_CMD_NAV_LAND, 0, 0, *(0.0,) * 4, 0, 0, 0.0)
    gateway.link.receive(message.pack(mav), gateway.ground.now_s)
    answers = M.MAVLink(None).parse_buffer(b"".join(gateway.link.datagrams(gateway.ground.now_s)))
    assert [m.result for m in answers if m.get_type() == "COMMAND_ACK"] == [M.MAV_RESULT_ACCEPTED]
    assert gateway.ordered() is ABORT


def test_other_command_is_unsupported() -> None:
    gateway = Gateway(1, 2, 3, 4)
    (ack,) = gateway.command(M.MAV_CMD_DO_SET_HOME)
    assert ack.result == M.MAV_RESULT_UNSUPPORTED
    assert gateway.ordered() is None


def test_it_is_seen_once_a_second_as_an_onboard_computer() -> None:
    gateway = Gateway()
    seen = [gateway.link.datagrams(100.0 + k * 0.05) for k in range(40)]
    beats = M.MAVLink(None).parse_buffer(b"".join(b"".join(out) for out in seen))
    assert [(m.get_type(), m.get_srcSystem(), m.get_srcComponent()) for m in beats] == [
        ("HEARTBEAT", OPERATOR_ID, 191)
    ] * 2
