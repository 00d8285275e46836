"""An endpoint: its identity, its streams, and which senders it listens to."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

from companion.core.model.actions import Ask
from companion.core.model.states import FlightMode, Request
from companion.mavlink import dialect
from companion.mavlink.beacon import beacons
from companion.mavlink.endpoint import HEARTBEAT_S, Endpoint
from companion.mavlink.makes.px4 import PX4
from companion.mavlink.streams import FIX_HZ, FRAME_TRIES, STREAMS_HZ, STREAMS_RETRY_S, receiver_hz
from mission.document.model import Mission
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import (
    AUTOPILOT,
    COMPANION,
    FLOWING,
    HOME,
    ME,
    STATION,
    TICK_S,
    command,
    endpoint,
    heartbeat,
    ids,
    packed,
    placed,
    position,
    read,
)

# --- identity ---


def test_heartbeat_is_an_onboard_computers_of_the_vehicles_system() -> None:
    (found,) = [m for m in read(endpoint().tick(10.0).autopilot) if m.get_type() == "HEARTBEAT"]
    assert (found.get_srcSystem(), found.get_srcComponent()) == (ME, COMPANION)
    assert (found.type, found.autopilot, found.base_mode) == (18, 8, 0)


def test_heartbeat_comes_once_a_second_from_the_tick_that_steers() -> None:
    one = endpoint()
    times = [k * TICK_S for k in range(200) if "HEARTBEAT" in ids(one.tick(k * TICK_S).autopilot)]
    assert [round(b - a, 3) for a, b in itertools.pairwise(times)] == [HEARTBEAT_S] * (len(times) - 1)
    assert len(times) == 10


def test_hello_is_a_heartbeat() -> None:
    (found,) = read(endpoint().hello())
    assert (found.get_type(), found.get_srcSystem(), found.get_srcComponent()) == ("HEARTBEAT", ME, COMPANION)


def test_sequence_numbers_of_each_link_run_without_a_gap() -> None:
    one = placed()
    autopilot, peers = [], []
    for k in range(400):
        out = one.tick(10.0 + k * TICK_S)
        autopilot += [m.get_header().seq for m in read(out.autopilot)]
        peers += [out.peers[4]] if out.peers else []
    for found in (autopilot, peers):
        assert len(found) > 20
        assert found == [(found[0] + k) % 256 for k in range(len(found))]


def test_mission_without_an_origin_is_refused() -> None:
    nowhere = Mission.model_validate(
        {"schema": 1, "route": {"d1_enu_m": (0, 0, 8), "d2_enu_m": (90, 0, 8), "vel_leader_mps": 1}}
    )
    with pytest.raises(ValueError, match="no \\[origin\\]"):
        Endpoint(nowhere, 1)


@pytest.mark.parametrize("vehicle_id", [0, 9, 250])
def test_vehicle_that_the_mission_does_not_know_is_refused(vehicle_id: int) -> None:
    with pytest.raises(ValueError, match=r"the mission has 1\.\.8"):
        Endpoint(mission(), vehicle_id)


# --- streams ---


HOME_ID, ORIGIN_ID, EKF_ID = 242, 49, 193


ORIGIN = dialect.MAVLink_gps_global_origin_message(470_000_000, 80_000_000, 400_000, 0)


def asks(one: Endpoint, now_s: float) -> list[tuple[int, int]]:
    """(command, message id) of the requests for messages in a tick."""
    return [(m.command, int(m.param1)) for m in read(one.tick(now_s).autopilot) if m.get_type() == "COMMAND_LONG"]


def test_streams_are_asked_for_until_they_flow_and_again_when_they_stop() -> None:
    one = endpoint()
    asked_s = [k * TICK_S for k in range(100) if asks(one, k * TICK_S)]
    assert asked_s == pytest.approx([0.0, 2.0, 4.0])
    one.from_autopilot(packed(HOME, ORIGIN), 5.0)
    for k in range(100, 200):
        one.from_autopilot(packed(*FLOWING), k * TICK_S)
        assert not asks(one, k * TICK_S)
    again_s = [k * TICK_S for k in range(200, 300) if asks(one, k * TICK_S)]
    assert again_s == pytest.approx([9.95 + STREAMS_RETRY_S, 9.95 + 2 * STREAMS_RETRY_S], abs=0.06)


def test_streams_are_those_of_the_loop_and_the_frame_is_asked_for_until_known() -> None:
    one = endpoint()
    commands = [m for m in read(one.tick(0.0).autopilot) if m.get_type() == "COMMAND_LONG"]
    assert {(m.target_system, m.target_component) for m in commands} == {(ME, AUTOPILOT)}
    intervals = {int(m.param1): m.param2 for m in commands if m.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL}
    streams_hz = {**STREAMS_HZ, **FIX_HZ}
    assert intervals == {**{i: pytest.approx(1e6 / hz) for i, hz in streams_hz.items()}, HOME_ID: 2e6}
    assert [m.param1 for m in commands if m.command == dialect.MAV_CMD_REQUEST_MESSAGE] == [ORIGIN_ID, HOME_ID]
    one.from_autopilot(packed(HOME, ORIGIN), 1.0)
    assert not {HOME_ID, ORIGIN_ID} & {message_id for _, message_id in asks(one, 2.0)}


@pytest.mark.parametrize(("known", "missing"), [(HOME, ORIGIN_ID), (ORIGIN, HOME_ID)])
def test_one_that_is_missing_while_the_frame_is_known_is_asked_for_a_few_times_only(known: Any, missing: int) -> None:
    one = endpoint()
    one.from_autopilot(packed(known), 0.0)
    asked = [message_id for k in range(600) for command, message_id in asks(one, k * TICK_S) if command == 512]
    assert asked == [missing] * FRAME_TRIES


def test_only_the_stream_that_does_not_come_is_asked_for() -> None:
    one = endpoint()
    one.from_autopilot(packed(HOME, ORIGIN, *FLOWING), 0.0)
    assert asks(one, 0.0) == []
    one.from_autopilot(packed(*FLOWING[:2], *FLOWING[3:]), 2.1)
    assert asks(one, 2.1) == [(511, dialect.MAVLINK_MSG_ID_SYS_STATUS)]


@pytest.mark.parametrize(("make", "asked"), [(3, [(511, EKF_ID)]), (12, [])])
def test_what_only_one_make_has_is_asked_of_that_make_as_soon_as_it_is_recognised(make: int, asked: list[Any]) -> None:
    one = endpoint()
    one.from_autopilot(packed(HOME, ORIGIN, *FLOWING), 10.0)
    one.tick(10.0)
    one.from_autopilot(packed(heartbeat(make=make)), 10.2)
    assert asks(one, 10.2) == asked


# --- whom it listens to ---


@pytest.mark.parametrize(
    ("system", "component"), [(ME + 1, AUTOPILOT), (ME, COMPANION), (ME, STATION), (255, STATION), (0, 0)]
)
def test_only_the_own_autopilot_is_believed(system: int, component: int) -> None:
    one = endpoint()
    texts = dialect.MAVLink_statustext_message(4, b"nonsense")
    one.from_autopilot(packed(HOME, position(), heartbeat(), texts, system=system, component=component), 10.0)
    assert not one.codec.home_known
    assert one.agent.flight.vehicle.position is None
    assert one.tick(10.0).peers == b""


def test_own_autopilot_is_believed() -> None:
    one = placed()
    assert one.codec.home_known
    assert one.agent.flight.vehicle.position is not None
    assert one.agent.flight.vehicle.mode is not None
    assert one.agent.flight.vehicle.mode.mode is FlightMode.HOLD


def test_all_that_the_autopilot_says_reaches_the_agent() -> None:
    one = placed()
    health = dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 42, 0, 0, 0, 0, 0, 0)
    landed = dialect.MAVLink_extended_sys_state_message(0, 2)
    text = dialect.MAVLink_statustext_message(4, b"Arming denied: compass")
    refused = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0, 0, ME, COMPANION)
    one.agent.flight._requests.send_request(Ask(Request.ARM), PX4.traits, 10.0)
    one.from_autopilot(packed(health, landed, text, refused), 10.0)
    assert one.agent.flight.vehicle.battery_percent == 42
    assert one.agent.flight.vehicle.airborne
    said = [say.text for say in one.tick(10.25).said]
    assert "arm refused (TEMPORARILY_REJECTED): Arming denied: compass" in said


def test_autopilots_of_other_vehicles_on_the_link_are_noticed() -> None:
    one = placed()
    assert one.foreign_autopilots == frozenset()
    one.from_autopilot(packed(heartbeat(), system=9) + packed(heartbeat(), system=255, component=STATION), 10.0)
    assert one.foreign_autopilots == {9}


def test_link_may_be_a_byte_stream() -> None:
    one = Endpoint(mission(), ME, autopilot_is_stream=True)
    for byte in packed(HOME, position(), heartbeat()):
        one.from_autopilot(bytes([byte]), 10.0)
    assert one.agent.flight.vehicle.position is not None


@pytest.mark.parametrize(
    ("system", "component", "mine"),
    [(ME, STATION, False), (255, 0, False), (ME + 1, COMPANION, False), (0, 0, True), (ME, 0, True), (ME, 191, True)],
)
def test_answers_to_others_are_not_taken_for_the_own(system: int, component: int, mine: bool) -> None:
    one = placed()
    one.agent.flight._requests.send_request(Ask(Request.ARM), PX4.traits, 10.0)
    ack = dialect.MAVLink_command_ack_message(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 4, 0, 0, system, component)
    one.from_autopilot(packed(ack), 10.0)
    assert [say.text for say in one.tick(10.25).said if "refused" in say.text] == ["arm refused (FAILED)"] * mine


@pytest.mark.parametrize("vehicle", [5, 6, 18, 26, 27, 30])
def test_heartbeat_of_what_is_no_autopilot_is_not_taken_for_it(vehicle: int) -> None:
    one = placed()
    before = one.agent.flight.vehicle.mode
    one.from_autopilot(packed(heartbeat(0, make=8, vehicle=vehicle)), 10.1)
    one.from_autopilot(packed(heartbeat(0, make=8, vehicle=vehicle), system=9), 10.1)
    assert one.agent.flight.vehicle.mode is before
    assert one.foreign_autopilots == frozenset()


@pytest.mark.parametrize(
    ("make", "vehicle", "words"),
    [(4, 2, "autopilot 4 is unknown"), (3, 1, "vehicle type 1 is no multicopter"), (12, 21, "vehicle type 21")],
)
def test_unknown_autopilot_is_said_in_words_and_asked_for_nothing(make: int, vehicle: int, words: str) -> None:
    one = placed(swarm={"size": 3})
    said = []
    for k in range(200):
        now_s = 11.0 + k * TICK_S
        still = dialect.MAVLink_heartbeat_message(vehicle, make, 0x01, 0, 3, 3)
        one.from_autopilot(packed(ORIGIN, *FLOWING, still, command(dialect.MAV_CMD_MISSION_START)), now_s)
        out = one.tick(now_s)
        said += [say.text for say in out.said]
        assert not {m.command for m in read(out.autopilot) if m.get_type() == "COMMAND_LONG"} & {400, 176, 22, 21}
    assert any(text.startswith(f"waiting: {words}") for text in said)


# --- a GNSS fix that is lost ---


def fix(fix_type: int) -> Any:
    return dialect.MAVLink_gps_raw_int_message(0, fix_type, 0, 0, 0, 80, 80, 0, 0, 12, 0, 900, 900, 0, 0)


def told_error_m(one: Endpoint, now_s: float) -> float:
    """As its beacon says; in two ticks there is one."""
    data = one.tick(now_s).peers + one.tick(now_s + TICK_S).peers
    ((_, _, said), *_) = beacons(data)
    return said.position_error / 10.0


def test_a_vehicle_without_a_fix_says_in_its_beacons_that_it_may_be_off() -> None:
    """Its autopilot goes on reporting positions, as if nothing were."""
    one = placed()
    one.from_autopilot(packed(fix(3), dialect.MAVLink_extended_sys_state_message(0, 2)), 10.0)
    assert told_error_m(one, 10.1) == 0.0
    one.from_autopilot(packed(fix(1), position(boot_ms=2000)), 11.0)
    assert told_error_m(one, 11.1) == pytest.approx(0.5 * 0.25 * 2.1**2, abs=0.06)
    one.from_autopilot(packed(dialect.MAVLink_extended_sys_state_message(0, 1)), 11.2)  # on the ground
    assert told_error_m(one, 11.3) == 0.0


def test_the_receivers_word_is_asked_for_where_it_counts() -> None:
    asked = dialect.MAVLINK_MSG_ID_GPS_RAW_INT
    assert asked in receiver_hz(mission(), ME)
    ranging = mission(
        swarm={"size": 4, "gnss": "leader", "leader_priority": [1]},
        ranging={"start_enu_m": [[8.0 * k, 0.0, 0.0] for k in range(4)]},
    )
    assert receiver_hz(ranging, 1) == {}  # reception has its own rates
