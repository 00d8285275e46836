"""A companion without its sockets: who it says it is, whom it listens to, what it answers."""

from __future__ import annotations

import itertools
import pickle
from typing import Any

import pytest
from core_kit import beacon, known_of, lease, mission
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega

from companion.core.peers import Neighbour
from companion.core.types import Ask, FlightMode, Request, Say, SendBeacon, Severity, VelocitySetpoint
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect, wire
from companion.mavlink.codec import Codec
from companion.mavlink.endpoint import FRAME_TRIES, HEARTBEAT_S, STREAMS_HZ, STREAMS_RETRY_S, SYNC_S, Endpoint, Outbox
from companion.mavlink.signing import Gate
from companion.mavlink.texts import Reader
from mission.frames import LocalFrame, Wgs84
from mission.model import RANGE_MAX_M, Mission

ME = 3
TICK_S = 0.05
COMPANION, AUTOPILOT, STATION = 191, 1, 190
HOME = dialect.MAVLink_home_position_message(470_000_000, 80_000_000, 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
TIMESYNC = dialect.MAVLINK_MSG_ID_TIMESYNC


def packed(*messages: Any, system: int = ME, component: int = AUTOPILOT) -> bytes:
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    return b"".join(m.pack(mav) for m in messages)


def position(north_m: float = 1.0, boot_ms: int = 1000) -> Any:
    return dialect.MAVLink_local_position_ned_message(boot_ms, north_m, 0.0, -8.0, 0.0, 0.0, 0.0)


def heartbeat(custom_mode: int = 4 << 16 | 3 << 24, *, make: int = 12, vehicle: int = 2) -> Any:
    return dialect.MAVLink_heartbeat_message(vehicle, make, 0x81, custom_mode, 4, 3)


def command(number: int, *, system: int = ME, component: int = COMPANION) -> Any:
    return dialect.MAVLink_command_long_message(system, component, number, 0, 0, 0, 0, 0, 0, 0, 0)


def endpoint(**tables: Any) -> Endpoint:
    return Endpoint(mission(**tables), ME)


def placed(**tables: Any) -> Endpoint:
    """One that knows where it is."""
    one = endpoint(**tables)
    one.from_autopilot(packed(HOME, position(), heartbeat()), 10.0)
    return one


def read(data: bytes) -> list[Any]:
    """As a ground station would."""
    return ardupilotmega.MAVLink(None).parse_buffer(data) or []


def ids(data: bytes) -> list[str]:
    return [m.get_type() for m in read(data)]


def beacon_of(sender: int, *, component: int = COMPANION, version: int = 1, **changes: Any) -> bytes:
    codec = Codec(sender, LocalFrame(Wgs84(47.0, 8.0, 400.0)))
    codec.home(HOME)
    codec.position(position(20.0))
    payload = codec.encode_beacon(beacon(sender, **changes))
    assert payload is not None
    fields = swarm_beacon.WireBeacon._make(swarm_beacon.PAYLOAD.unpack(payload))._replace(version=version)
    return wire.frame(
        swarm_beacon.MESSAGE_ID, swarm_beacon.PAYLOAD.pack(*fields), seq=0, system=sender, component=component
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
FLOWING = (
    position(),
    dialect.MAVLink_extended_sys_state_message(0, 1),
    dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, 42, 0, 0, 0, 0, 0, 0),
)
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
    assert intervals == {**{i: pytest.approx(1e6 / hz) for i, hz in STREAMS_HZ.items()}, HOME_ID: 2e6}
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
    one.from_autopilot(packed(*FLOWING[:2]), 2.1)
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
    one.agent.flight._requests.ask(Ask(Request.ARM), 10.0)
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
    one.agent.flight._requests.ask(Ask(Request.ARM), 10.0)
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


# --- peers ---


def test_beacon_of_a_neighbour_reaches_the_agent_relative_to_the_own_position() -> None:
    one = placed()
    one.from_peers(beacon_of(5, lease=lease(5, 7)), 10.0)
    (found,) = one.agent.localiser.peers.neighbours((1.0, 0.0, -8.0), 10.0)
    assert found.id == 5
    assert found.rel_ned_m == pytest.approx((19.0, 0.0, 0.0), abs=0.02)
    assert one.agent.swarm.election.lease == lease(5, 7)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xfd" * 300,
        beacon_of(5)[:-1],
        beacon_of(5, component=AUTOPILOT),
        packed(heartbeat(), system=5, component=COMPANION),
        packed(command(300)),
    ],
)
def test_anything_but_a_companions_beacon_is_ignored_on_the_peers_link(data: bytes) -> None:
    one = placed()
    one.from_peers(data, 10.0)
    assert one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.0) == []
    assert not one.agent.swarm.started
    assert one.datagrams_without_beacon == 1


def test_own_beacon_coming_back_is_ignored() -> None:
    one = placed()
    one.from_peers(beacon_of(ME, abort=True), 10.0)
    assert not one.agent.swarm.abort


def test_several_beacons_in_one_datagram_are_all_heard() -> None:
    one = placed()
    one.from_peers(b"\xfd" + beacon_of(5) + b"noise" + beacon_of(6), 10.0)
    assert [n.id for n in one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.0)] == [5, 6]
    assert one.datagrams_without_beacon == 0


def signed(frame: bytes) -> bytes:
    """The same frame with a signature that nobody can check."""
    payload = frame[10:-2]
    head = bytes([frame[0], frame[1], 1]) + frame[3:10]
    crc_extra = dialect.mavlink_map[int.from_bytes(frame[7:10], "little")].crc_extra
    crc = mcrf4xx(head[1:] + payload + bytes([crc_extra]))
    return head + payload + crc.to_bytes(2, "little") + bytes(range(13))


def test_signed_beacon_is_refused_and_an_unsigned_one_behind_it_heard() -> None:
    one = placed()
    one.from_peers(signed(beacon_of(5, abort=True)) + beacon_of(6), 10.0)
    assert [n.id for n in one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.0)] == [6]
    assert not one.agent.swarm.abort
    assert (one.peers_gate.signed, one.peers_gate.refused) == (1, 1)


def test_signed_frame_of_the_autopilot_is_taken_and_counted() -> None:
    one = endpoint()
    one.from_autopilot(signed(packed(heartbeat())), 10.0)
    assert one.codec.make is not None
    assert (one.autopilot_gate.signed, one.autopilot_gate.refused) == (1, 0)


def test_refused_frame_leaves_no_trace() -> None:
    """Of all that a companion takes: its state stays that of one that heard nothing, and so does what it sends."""
    request = dialect.MAVLink_timesync_message(0, 5)
    long = dialect.MAVLink_statustext_message(4, b"x" * 50, 3, 0)
    frames = [packed(m) for m in (HOME, position(), heartbeat(), request, command(300), long)]
    frames.append(packed(heartbeat(), system=ME + 1))
    one, untouched = placed(), placed()
    one.autopilot_gate = Gate(takes_signed=False)
    one.from_autopilot(b"".join(map(signed, frames)), 10.05)
    one.from_peers(signed(beacon_of(5, abort=True)) + signed(beacon_of(6, version=9)), 10.05)
    assert (one.autopilot_gate.refused, one.peers_gate.refused) == (len(frames), 2)
    one.autopilot_gate, one.peers_gate = untouched.autopilot_gate, untouched.peers_gate
    assert pickle.dumps(one) == pickle.dumps(untouched)
    for k in range(40):
        assert one.tick(10.1 + k / 20) == untouched.tick(10.1 + k / 20)


def test_beacons_of_another_version_are_counted_dropped_and_said_once_of_each_of_the_swarm() -> None:
    one = placed()
    said = []
    for k, (sender, version) in enumerate([(200, 0), (5, 0), (5, 2), (6, 255)]):
        one.from_peers(beacon_of(sender, version=version, abort=True), 10.0 + k / 20)
        said += [say for say in one.tick(10.0 + k / 20).said if "version" in say.text]
    one.from_peers(beacon_of(7), 10.2)
    assert said == [
        Say(Severity.WARNING, f"vehicle {k} sends beacons of version {version}, not 1: not heard")
        for k, version in ((5, 0), (6, 255))
    ]
    assert one.codec.other_versions == 4
    assert (one.codec.dropped, one.datagrams_without_beacon) == (0, 0)
    assert [n.id for n in one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.2)] == [7]
    assert not one.agent.swarm.abort


def test_receivers_that_share_a_reader_hear_what_others_hear_and_decode_each_frame_once() -> None:
    def heard(one: Endpoint) -> list[Neighbour]:
        return one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.0)

    shared = swarm_beacon.Reader(LocalFrame(Wgs84(47.0, 8.0, 400.0)), remembers=2)
    one, other = (Endpoint(mission(), k, beacons=shared) for k in (1, 3))
    alone = Endpoint(mission(), 1)
    for receiver in (one, other, alone):
        receiver.from_autopilot(packed(HOME, position(1.0), heartbeat(), system=receiver.id), 10.0)
    for sender in (5, 6, 7, 8):  # more than are remembered
        for receiver in (one, other, alone):
            receiver.from_peers(beacon_of(sender), 10.0)
    assert len(heard(one)) == 4
    known = [[known_of(neighbour) for neighbour in heard(receiver)] for receiver in (one, other, alone)]
    assert known[0] == known[1] == known[2]
    for mine, others, own in zip(heard(one), heard(other), heard(alone), strict=True):
        assert mine.beacon is others.beacon
        assert mine.beacon is not own.beacon
    assert shared.read(beacon_of(8)[:-1] + b"?") is None  # damaged: another frame


def test_reader_forgets_what_is_more_than_it_remembers() -> None:
    reader = swarm_beacon.Reader(LocalFrame(Wgs84(47.0, 8.0, 400.0)), remembers=2)
    frames = [beacon_of(sender) for sender in (5, 6, 7)]
    first = reader.read(frames[0])
    assert reader.read(frames[0]) is first
    for frame in frames:
        reader.read(frame)
    assert reader.read(frames[0]) == first
    assert reader.read(frames[0]) is not first


def test_beacon_goes_to_the_peers_alone_and_only_with_a_position() -> None:
    assert endpoint().tick(10.0).peers == b""
    out = placed().tick(10.0)
    ((sender, frame, wire),) = swarm_beacon.beacons(out.peers)
    assert (sender, frame[6]) == (ME, COMPANION)
    assert wire.lat == pytest.approx(470_000_090, abs=2)
    assert not list(swarm_beacon.beacons(out.autopilot))


# --- operators ---


@pytest.mark.parametrize(
    ("number", "started", "abort"),
    [(dialect.MAV_CMD_MISSION_START, True, False), (dialect.MAV_CMD_NAV_LAND, False, True)],
)
def test_operators_order_is_obeyed_and_acknowledged(number: int, started: bool, abort: bool) -> None:
    one = placed()
    one.from_autopilot(packed(command(number), system=255, component=STATION), 10.0)
    assert (one.agent.swarm.started, one.agent.swarm.abort) == (started, abort)
    (ack,) = [m for m in read(one.tick(10.0).autopilot) if m.get_type() == "COMMAND_ACK"]
    assert (ack.command, ack.result) == (number, 0)
    assert (ack.target_system, ack.target_component) == (255, STATION)
    assert "COMMAND_ACK" not in ids(one.tick(10.05).autopilot)


def test_unknown_order_is_answered_unsupported() -> None:
    one = placed()
    one.from_autopilot(packed(command(dialect.MAV_CMD_COMPONENT_ARM_DISARM), system=255, component=STATION), 10.0)
    (ack,) = [m for m in read(one.tick(10.0).autopilot) if m.get_type() == "COMMAND_ACK"]
    assert (ack.command, ack.result) == (400, 3)


@pytest.mark.parametrize(
    ("system", "component"), [(ME, AUTOPILOT), (ME, 0), (0, 0), (0, COMPANION), (ME + 1, COMPANION)]
)
def test_order_for_someone_else_is_neither_obeyed_nor_answered(system: int, component: int) -> None:
    one = placed()
    order = command(dialect.MAV_CMD_NAV_LAND, system=system, component=component)
    one.from_autopilot(packed(order, system=255, component=STATION), 10.0)
    assert not one.agent.swarm.abort
    assert "COMMAND_ACK" not in ids(one.tick(10.0).autopilot)


# --- clocks ---


def test_timesync_request_is_answered_last_with_its_own_time() -> None:
    one = placed()
    order = packed(command(dialect.MAV_CMD_MISSION_START), system=255, component=STATION)
    one.from_autopilot(order + packed(dialect.MAVLink_timesync_message(0, 123_456_789)), 10.0)
    assert one.requested_ns == 123_456_789
    *_, before, last = read(one.tick(10.0).autopilot)
    assert before.get_type() == "COMMAND_ACK"
    assert last.get_type() == "TIMESYNC"
    assert (last.tc1, last.ts1) == (10_000_000_000, 123_456_789)


def test_timesync_answer_is_never_a_request_even_at_time_zero() -> None:
    one = placed()
    one.from_autopilot(packed(dialect.MAVLink_timesync_message(0, 5)), 0.0)
    assert read(one.tick(0.0).autopilot)[-1].tc1 > 0


def test_answers_of_others_to_timesync_are_left_alone() -> None:
    one = placed()
    one.from_autopilot(packed(dialect.MAVLink_timesync_message(7, 5)), 10.0)
    assert "TIMESYNC" not in ids(one.tick(10.0).autopilot)
    assert one.requested_ns is None


def test_autopilots_time_is_asked_for_four_times_a_second_and_its_answer_bounds_the_delay() -> None:
    one = placed()
    asked_s = []
    for k in range(1, 201):
        now_s = 10.0 + k * TICK_S
        boot_ms = 1000 + 25 * k  # its clock runs at half the speed
        one.from_autopilot(packed(position(boot_ms=boot_ms)), now_s)
        for m in read(one.tick(now_s).autopilot):
            if m.get_type() == "TIMESYNC":
                assert m.tc1 == 0
                asked_s.append(now_s)
                one.from_autopilot(packed(dialect.MAVLink_timesync_message(boot_ms * 1_000_000, m.ts1)), now_s)
        assert one.agent.flight.vehicle.delay.late_s < 0.2
    assert len(asked_s) == pytest.approx(9.95 / SYNC_S, abs=3)


@pytest.mark.parametrize("tc1", [-1, -(1 << 63), (1 << 63) - 1, 1 << 62])
@pytest.mark.parametrize("ts1", [0, -(1 << 63), (1 << 63) - 1])
def test_absurd_answer_to_timesync_is_refused_and_harmless(tc1: int, ts1: int) -> None:
    one = placed()
    one.from_autopilot(packed(dialect.MAVLink_timesync_message(tc1, ts1)), 10.0)
    one.from_autopilot(packed(position(boot_ms=1050)), 10.05)
    one.tick(10.05)
    assert one.codec.dropped == 1
    assert one.agent.status(10.05).position_known


def test_clock_beyond_all_bounds_still_answers_a_timesync_request() -> None:
    one = placed()
    one.from_autopilot(packed(dialect.MAVLink_timesync_message(0, (1 << 63) - 1)), 1e10)
    (answer,) = [m for m in read(one.tick(1e10).autopilot) if m.get_type() == "TIMESYNC"]
    assert (answer.tc1, answer.ts1) == ((1 << 63) - 1, (1 << 63) - 1)


def test_flood_of_requests_is_answered_eight_times_a_tick_at_most() -> None:
    one = placed()
    for k in range(1, 101):
        one.from_autopilot(packed(dialect.MAVLink_timesync_message(0, k)), 10.0)
    found = [m.ts1 for m in read(one.tick(10.0).autopilot) if m.get_type() == "TIMESYNC"]
    assert found == list(range(93, 101))
    assert "TIMESYNC" not in ids(one.tick(10.05).autopilot)


# --- what the agent wants done ---


class Puppet:
    """In place of the agent."""

    def __init__(self, *actions: Any) -> None:
        self.actions = list(actions)

    def tick(self, _now_s: float) -> list[Any]:
        return self.actions


def told(*actions: Any) -> Outbox:
    one = placed()
    one.agent = Puppet(*actions)  # type: ignore[assignment]
    return one.tick(10.0)


def test_setpoint_goes_out_after_the_requests_stamped_with_the_ticks_time() -> None:
    out = told(Ask(Request.OFFBOARD), VelocitySetpoint((1.0, 0.0, 0.0), 0.5))
    *_, ask, setpoint = read(out.autopilot)
    assert (ask.get_type(), ask.command) == ("COMMAND_LONG", 176)
    assert (setpoint.get_type(), setpoint.time_boot_ms, setpoint.vx) == ("SET_POSITION_TARGET_LOCAL_NED", 10_000, 1.0)


def test_takeoff_is_asked_for_above_mean_sea_level() -> None:
    asked = [m for m in read(told(Ask(Request.TAKEOFF, 8.0)).autopilot) if m.get_type() == "COMMAND_LONG"]
    assert [m.param7 for m in asked if m.command == 22] == [408.0]


def put_together(*messages: Any) -> list[str]:
    """Whole texts of one sender."""
    reader = Reader()
    return [text for m in messages if m.get_type() == "STATUSTEXT" and (text := reader.read(m)) is not None]


MISSING = "holding: no majority, without " + ", ".join(map(str, range(9, 26)))


@pytest.mark.parametrize(
    ("text", "on_wire", "chunks"),
    [
        ("ready", "ready", 1),
        ("x" * 50, "x" * 50, 1),
        (MISSING, MISSING, 2),
        ("x" * 100, "x" * 100, 3),  # the last is empty: the two before it are full
        ("Bäume über Zürich " * 5, "B?ume ?ber Z?rich " * 5, 2),
        ("x" * 199, "x" * 199, 4),
        ("x" * 200, "x" * 196 + "...", 4),
        ("abcdefghi " * 30, ("abcdefghi " * 19).strip() + "...", 4),  # and no half of a word
    ],
)
def test_what_is_said_comes_whole_in_chunks_or_is_cut_at_a_word(text: str, on_wire: str, chunks: int) -> None:
    out = told(Say(Severity.WARNING, text))
    found = [m for m in read(out.autopilot) if m.get_type() == "STATUSTEXT"]
    assert [m.severity for m in found] == [4] * chunks
    assert put_together(*found) == [on_wire]
    assert len(found[-1].text) < 50 or not found[-1].id  # so that its reader knows it for the last
    assert out.said == [Say(Severity.WARNING, text)]  # the log has all of it


def test_each_text_of_a_companion_has_its_own_number() -> None:
    one = placed()
    one.agent = Puppet(Say(Severity.WARNING, "x" * 80), Say(Severity.WARNING, "y" * 80))  # type: ignore[assignment]
    found = [m for k in range(2) for m in read(one.tick(10.0 + k).autopilot) if m.get_type() == "STATUSTEXT"]
    assert [(m.id, m.chunk_seq) for m in found] == [(k, seq) for k in (1, 2, 3, 4) for seq in (0, 1)]
    assert put_together(*found) == ["x" * 80, "y" * 80] * 2


def test_numbers_of_texts_come_round_without_a_zero() -> None:
    one = placed()
    one._text_id = 0xFFFF
    one.agent = Puppet(Say(Severity.WARNING, "x" * 80))  # type: ignore[assignment]
    assert put_together(*read(one.tick(10.0).autopilot)) == ["x" * 80]


def test_nothing_to_do_sends_nothing() -> None:
    one = placed()
    one.tick(10.0)
    one.agent = Puppet()  # type: ignore[assignment]
    out = one.tick(10.05)
    assert (out.autopilot, out.peers, out.said) == (b"", b"", [])


def test_longest_range_that_a_mission_may_have_fits_the_wire() -> None:
    longest = {"transit_range_m": RANGE_MAX_M, "full_range_m": RANGE_MAX_M}
    ((_, _, found),) = swarm_beacon.beacons(placed(radio=longest).tick(10.0).peers)
    assert found.range_dm == RANGE_MAX_M * 10


def test_clock_that_counts_from_1970_does_no_harm() -> None:
    one = Endpoint(mission(swarm={"size": 1}), 1)
    on_ground = dialect.MAVLink_extended_sys_state_message(0, 1)
    disarmed = dialect.MAVLink_heartbeat_message(2, 12, 0x01, 4 << 16 | 3 << 24, 3, 3)
    for k in range(60):
        now_s = 1.7e9 + k * TICK_S
        told = packed(HOME, position(boot_ms=50 * k), *FLOWING[1:], disarmed, on_ground, system=1)
        one.from_autopilot(told, now_s)
        out = one.tick(now_s)
        assert bool(out.peers) is (k % 2 == 0)
    assert one.agent.swarm.election.acts


def test_beacon_before_home_is_known_is_not_sent() -> None:
    one = endpoint()
    one.agent = Puppet(SendBeacon(beacon(ME)))  # type: ignore[assignment]
    assert one.tick(10.0).peers == b""
