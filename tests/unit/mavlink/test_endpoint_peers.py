"""An endpoint and its peers, its operators and clocks."""

from __future__ import annotations

import pickle
from typing import Any

import pytest
from fastcrc.crc16 import mcrf4xx

from companion.core.model.actions import Say
from companion.core.model.neighbour import Neighbour
from companion.core.model.states import Severity
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.endpoint import SYNC_S, Endpoint
from companion.mavlink.framing import wire
from companion.mavlink.framing.signing import Gate
from companion.mavlink.own_messages import BEACON_PAYLOAD
from mission.common.frames import LocalFrame, Wgs84
from tests.unit.core.core_kit import beacon, known_of, lease, mission
from tests.unit.mavlink.endpoint_kit import (
    AUTOPILOT,
    COMPANION,
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


def beacon_of(sender: int, *, component: int = COMPANION, version: int = 1, **changes: Any) -> bytes:
    codec = Codec(sender, LocalFrame(Wgs84(47.0, 8.0, 400.0)))
    codec.home(HOME)
    codec.position(position(20.0))
    payload = codec.encode_beacon(beacon(sender, **changes))
    assert payload is not None
    fields = swarm_beacon.WireBeacon._make(BEACON_PAYLOAD.unpack(payload))._replace(version=version)
    return wire.frame(swarm_beacon.MESSAGE_ID, BEACON_PAYLOAD.pack(*fields), seq=0, system=sender, component=component)


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
    assert not one.agent.swarm.operator.started
    assert one.peers.without_beacon == 1


def test_own_beacon_coming_back_is_ignored() -> None:
    one = placed()
    one.from_peers(beacon_of(ME, abort=True), 10.0)
    assert not one.agent.swarm.operator.aborts


def test_several_beacons_in_one_datagram_are_all_heard() -> None:
    one = placed()
    one.from_peers(b"\xfd" + beacon_of(5) + b"noise" + beacon_of(6), 10.0)
    assert [n.id for n in one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.0)] == [5, 6]
    assert one.peers.without_beacon == 0


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
    assert not one.agent.swarm.operator.aborts
    assert one.peers.guard.refused == {"signed": 1}


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
    assert (one.autopilot_gate.refused, one.peers.guard.refused) == (len(frames), {"signed": 2})
    one.autopilot_gate = untouched.autopilot_gate
    one.peers.guard.refused.clear()
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
        Say(Severity.WARNING, f"vehicle {k} beacon version {version}, not 1: ignored")
        for k, version in ((5, 0), (6, 255))
    ]
    assert one.codec.other_versions == 4
    assert (one.codec.dropped, one.peers.without_beacon) == (0, 0)
    assert [n.id for n in one.agent.localiser.peers.neighbours((0.0, 0.0, 0.0), 10.2)] == [7]
    assert not one.agent.swarm.operator.aborts


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
            receiver.from_peers(beacon_of(sender, route_cost=1.0), 10.0)
    assert len(heard(one)) == 4
    known = [[known_of(neighbour) for neighbour in heard(receiver)] for receiver in (one, other, alone)]
    assert known[0] == known[1] == known[2]
    for mine, others, own in zip(heard(one), heard(other), heard(alone), strict=True):
        assert mine.beacon is others.beacon
        assert mine.beacon is not own.beacon
    assert shared.decode_frame(beacon_of(8)[:-1] + b"?") is None  # damaged: another frame


def test_reader_forgets_what_is_more_than_it_remembers() -> None:
    reader = swarm_beacon.Reader(LocalFrame(Wgs84(47.0, 8.0, 400.0)), remembers=2)
    frames = [beacon_of(sender) for sender in (5, 6, 7)]
    first = reader.decode_frame(frames[0])
    assert reader.decode_frame(frames[0]) is first
    for frame in frames:
        reader.decode_frame(frame)
    assert reader.decode_frame(frames[0]) == first
    assert reader.decode_frame(frames[0]) is not first


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
    assert (one.agent.swarm.operator.started, one.agent.swarm.operator.aborts) == (started, abort)
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
    assert not one.agent.swarm.operator.aborts
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


def test_one_that_is_proven_to_lie_is_blocked_and_the_proof_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    one = placed()
    monkeypatch.setattr(one.peers.guard, "take_liars", lambda: [5])
    monkeypatch.setattr(one.peers.guard, "take_proofs", lambda: [b"one", b"two"])
    sent = one.tick(10.0)
    assert sent.peers.endswith(b"onetwo")
    assert one.agent.swarm.trust.blocklist.has(5)
    one.from_peers(beacon_of(5, lease=lease(5, 7)), 10.1)
    assert one.agent.swarm.election.lease != lease(5, 7)
