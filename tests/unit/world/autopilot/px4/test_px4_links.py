"""What PX4 answers to a mission's upload, what it passes on between its links, and what damage does to it."""

from __future__ import annotations

import random
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame
from sim_bridge.world.autopilot import (
    PROFILES,
    Link,
    Px4Autopilot,
    StreamProfile,
)
from tests.unit.world.autopilot.autopilot_kit import ORIGIN, STEP_S, long
from tests.unit.world.autopilot.px4.px4_kit import (
    ACCEPTED,
    ARM,
    OFFBOARD,
    SET_MODE,
    UNSUPPORTED,
    Body,
    Flight,
    velocity,
)

# Missions: none, but nobody waits in vain


def test_the_mission_is_empty() -> None:
    (count,) = Flight().ask(mav.MAVLink_mission_request_list_message(1, 1, 1))
    assert (count.count, count.mission_type, count.target_system, count.target_component) == (0, 1, 1, 191)


@pytest.mark.parametrize(("count", "result"), [(3, 3), (0, 0)])
def test_an_upload_is_refused_unless_empty(count: int, result: int) -> None:
    (ack,) = Flight().ask(mav.MAVLink_mission_count_message(1, 1, count, 0))
    assert ack.type == result


def test_clearing_the_mission_works() -> None:
    (ack,) = Flight().ask(mav.MAVLink_mission_clear_all_message(1, 1, 0))
    assert ack.type == mav.MAV_MISSION_ACCEPTED


def test_request_data_stream_is_ignored() -> None:
    assert Flight().ask(mav.MAVLink_request_data_stream_message(1, 1, 0, 10, 1)) == []


# Forwarding


def forwarded(flight: Flight, message: Any, link: Link) -> list[bytes]:
    """What a frame sent on `link` makes come out of the other, if it is that frame."""
    other = Link.GROUND if link is Link.ONBOARD else Link.ONBOARD
    flight.listen(other)
    frame = flight.send(message, link)
    sent = flight.autopilot.transmit(other, flight.now_s)
    return [datagram for datagram in sent if datagram == frame]


@pytest.mark.parametrize(
    ("message", "goes"),
    [
        (mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), True),
        (long(42001, component=191), True),
        (long(42001, component=0), True),
        (long(42001, component=1), False),
        (long(42001, system=2, component=191), False),
        (mav.MAVLink_param_request_list_message(1, 191), True),
    ],
)
def test_ground_to_companion(message: Any, goes: bool) -> None:
    assert bool(forwarded(Flight(), message, Link.GROUND)) is goes


@pytest.mark.parametrize(
    ("message", "goes"),
    [
        (mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3), True),
        (mav.MAVLink_statustext_message(6, b"leader", 0, 0), True),
        (mav.MAVLink_command_ack_message(42001, 0, 0, 0, 255, 190), True),
        (long(400, 1.0, system=255, component=190), True),
        (velocity(1.0), False),
        (mav.MAVLink_timesync_message(0, 5), False),
        (long(400, 1.0), False),
    ],
)
def test_companion_to_ground(message: Any, goes: bool) -> None:
    assert bool(forwarded(Flight(), message, Link.ONBOARD)) is goes


def test_a_broadcast_command_is_forwarded_and_answered() -> None:
    flight = Flight()
    message = long(42001, component=0)
    (ack,) = flight.ask(message, Link.GROUND)
    assert ack.result == UNSUPPORTED


def test_a_vehicle_with_one_link_forwards_nowhere() -> None:
    flight = Flight(links={Link.ONBOARD: StreamProfile.MINIMAL})
    flight.send(mav.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    assert flight.listen() != []


def test_its_own_messages_that_come_back_are_ignored() -> None:
    flight = Flight().ready()
    flight.codecs[Link.GROUND] = mav.MAVLink(None, srcSystem=1, srcComponent=1)
    assert flight.ask(long(ARM, 1.0), Link.GROUND) == []
    assert flight.listen(Link.ONBOARD) == []


# Hostile bytes


def test_damaged_datagrams_never_raise() -> None:
    rng = random.Random(7)
    flight = Flight().offboard()
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    for _ in range(3000):
        kind = rng.choice(list(mav.mavlink_map.values()))
        frame = bytearray(rng.randbytes(kind.unpacker.size) if rng.random() < 0.5 else bytes(8))
        message = kind(*decoded(kind, bytes(frame)))
        data = bytearray(message.pack(codec))
        if rng.random() < 0.5:
            data[rng.randrange(len(data))] ^= rng.randrange(256)
        flight.autopilot.receive(rng.choice(list(Link)), bytes(data), flight.now_s)
        flight.run(STEP_S)


def decoded(kind: Any, payload: bytes) -> list[Any]:
    """Fields of a message in constructor order, from any bytes, addressed to the autopilot."""
    values = kind.unpacker.unpack(payload.ljust(kind.unpacker.size, b"\0")[: kind.unpacker.size])
    fields: dict[str, Any] = {}
    at = 0
    for name, length in zip(kind.ordered_fieldnames, lengths(kind), strict=True):
        if isinstance(values[at], bytes):
            fields[name] = values[at]
            at += 1
        else:
            fields[name] = values[at] if length <= 1 else list(values[at : at + length])
            at += max(length, 1)
    if "target_system" in fields:
        fields["target_system"] = 1
    if "target_component" in fields:
        fields["target_component"] = 1
    return [fields[name] for name in kind.fieldnames]


def lengths(kind: Any) -> list[int]:
    return list(kind.lengths)


@pytest.mark.parametrize("sysid", [0, 256])
def test_a_sysid_out_of_range_is_refused(sysid: int) -> None:
    with pytest.raises(ValueError, match=r"must be 1\.\.255"):
        Px4Autopilot(sysid, Body(), LocalFrame(ORIGIN))


def test_targets_are_silent_from_offboard_until_the_first_setpoint() -> None:
    """As in px4_pymavlink_A and _B; later, with stale setpoints, they go on."""
    flight = Flight(links=PROFILES).ready()
    assert flight.command(SET_MODE, *OFFBOARD) == ACCEPTED
    flight.heard[Link.ONBOARD].clear()
    flight.run(1.0)
    targets = {"SERVO_OUTPUT_RAW", "ATTITUDE_TARGET", "POSITION_TARGET_LOCAL_NED"}
    assert not targets & {m.get_type() for m in flight.heard[Link.ONBOARD]}
    flight.send(mav.MAVLink_set_position_target_local_ned_message(0, 1, 1, 1, 0x5C7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0))
    flight.run(3.0)
    flight.heard[Link.ONBOARD].clear()
    flight.run(1.0)
    assert targets <= {m.get_type() for m in flight.heard[Link.ONBOARD]}
