"""Messages <-> core types: units, frames, and what is refused."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest
from core_kit import beacon, lease

from companion.core.types import (
    CLIMBS_IN_OFFBOARD,
    Answer,
    AutopilotMode,
    Beacon,
    Candidate,
    FlightMode,
    FlightState,
    HeardBeacon,
    Landed,
    LandedState,
    Position,
    Request,
    Result,
    Sighting,
    SwarmPhase,
)
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect, wire
from companion.mavlink.codec import FASTEST_MPS, FURTHEST_M, Codec
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.make import REQUESTS, Make
from companion.mavlink.makes.px4 import PX4
from mission.frames import LocalFrame, Vec3, Wgs84
from mission.tables import MAX_STOPS

ORIGIN = Wgs84(47.0, 8.0, 400.0)
FRAME = LocalFrame(ORIGIN)
NAN, INF = math.nan, math.inf
BAD_FLOATS = [NAN, INF, -INF, 1e30]


def home(at_ned_m: Vec3, local_m: Vec3 = (0.0, 0.0, 0.0)) -> Any:
    """HOME_POSITION of a vehicle whose local frame has `local_m` at this point of the mission's."""
    point = FRAME.to_wgs84(at_ned_m)
    return dialect.MAVLink_home_position_message(
        round(point.lat_deg * 1e7),
        round(point.lon_deg * 1e7),
        round(point.alt_m * 1e3),
        *local_m,
        [1, 0, 0, 0],
        0,
        0,
        0,
    )


def local_position(local_m: Vec3, vel: Vec3 = (0.0, 0.0, 0.0)) -> Any:
    return dialect.MAVLink_local_position_ned_message(1000, *local_m, *vel)


def codec_at(pos_ned_m: Vec3, *, start_ned_m: Vec3 = (0.0, 0.0, 0.0), vehicle_id: int = 1) -> Codec:
    """Of a vehicle at a place of the mission's frame, whose own local frame begins at `start_ned_m`."""
    codec = Codec(vehicle_id, FRAME)
    codec.home(home(start_ned_m))
    local = (pos_ned_m[0] - start_ned_m[0], pos_ned_m[1] - start_ned_m[1], pos_ned_m[2] - start_ned_m[2])
    assert codec.position(local_position(local)) is not None
    return codec


def on_wire(payload: bytes | None, sender: int = 2) -> tuple[int, swarm_beacon.WireBeacon]:
    assert payload is not None
    ((system, _, fields),) = swarm_beacon.beacons(
        wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=swarm_beacon.COMPONENT)
    )
    return system, fields


def heard(codec: Codec, sender: int, fields: swarm_beacon.WireBeacon) -> HeardBeacon | None:
    return codec.beacon(swarm_beacon.decode(sender, fields, FRAME))


def wire_beacon(**changes: Any) -> swarm_beacon.WireBeacon:
    """A plausible beacon from ten metres north of the origin, with these fields changed."""
    payload = codec_at((10.0, 0.0, -8.0)).encode_beacon(beacon(2, lease=lease(2), dest_ned_m=(1.0, 2.0, 3.0)))
    return on_wire(payload)[1]._replace(**changes)


# --- the frame tie ---


def test_position_is_unknown_until_home_is() -> None:
    codec = Codec(1, FRAME)
    assert codec.position(local_position((1.0, 2.0, -3.0))) is None
    assert not codec.home_known
    codec.home(home((0.0, 0.0, 0.0)))
    assert codec.home_known
    assert codec.position(local_position((1.0, 2.0, -3.0), (0.5, -0.25, 1.0))) == Position(
        pytest.approx((1.0, 2.0, -3.0), abs=0.01), (0.5, -0.25, 1.0), 1.0
    )


def test_local_frame_that_began_elsewhere_is_tied_to_the_missions() -> None:
    codec = Codec(1, FRAME)
    codec.home(home((120.0, -45.0, -2.0), local_m=(3.0, 4.0, -0.5)))
    found = codec.position(local_position((13.0, 4.0, -8.5)))
    assert found is not None
    assert found.pos_ned_m == pytest.approx((130.0, -45.0, -10.0), abs=0.01)


def test_origin_of_the_local_frame_is_believed_before_home_and_after_it() -> None:
    for origin_first in (True, False):
        codec = Codec(1, FRAME)
        ties = [
            lambda c: c.origin(dialect.MAVLink_gps_global_origin_message(470_000_000, 80_000_000, 401_000, 0)),
            lambda c: c.home(home((0.5, -0.3, -2.5))),  # PX4's first one, before its estimator is there
        ]
        for tie in ties if origin_first else reversed(ties):
            tie(codec)
        assert codec.frame_known
        found = codec.position(local_position((1.0, 2.0, -3.0)))
        assert found is not None
        assert found.pos_ned_m == pytest.approx((1.0, 2.0, -4.0), abs=0.01)


def test_origin_on_the_other_side_of_the_earth_is_refused() -> None:
    codec = Codec(1, FRAME)
    codec.origin(dialect.MAVLink_gps_global_origin_message(0, 0, 0, 0))
    assert not codec.frame_known
    assert codec.dropped == 1


def test_autopilot_that_moves_its_home_does_not_move_the_vehicle() -> None:
    codec = Codec(1, FRAME)
    before, after = [], []
    for found, tie in (
        (before, home((50.0, 20.0, 0.0), (0.0, 0.0, 0.0))),
        (after, home((60.0, 25.0, -1.0), (10.0, 5.0, -1.0))),
    ):
        codec.home(tie)
        found.append(codec.position(local_position((7.0, 7.0, -7.0))).pos_ned_m)  # type: ignore[union-attr]
    assert after[0] == pytest.approx(before[0], abs=0.02)


@pytest.mark.parametrize("here", [(0.0, 0.0, -8.0), (151.3, -98.7, -20.2)])
@pytest.mark.parametrize("there", [(10.0, 3.0, -9.0), (-212.4, 77.7, -3.3)])
def test_two_vehicles_with_different_local_origins_agree_within_two_centimetres(here: Vec3, there: Vec3) -> None:
    me = codec_at(here, start_ned_m=(33.0, -12.0, 1.0), vehicle_id=1)
    other = codec_at(there, start_ned_m=(-70.0, 5.0, -2.0), vehicle_id=2)
    found = heard(me, *on_wire(other.encode_beacon(beacon(2))))
    assert found is not None
    truth = tuple(t - h for h, t in zip(here, there, strict=True))
    assert found.rel_ned_m == pytest.approx(truth, abs=0.02)


@pytest.mark.parametrize("bad", [*BAD_FLOATS, FURTHEST_M * 1.01])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_home_that_makes_no_sense_is_refused_and_the_last_one_kept(bad: float, axis: str) -> None:
    codec = codec_at((1.0, 2.0, -3.0))
    garbage = home((0.0, 0.0, 0.0))
    setattr(garbage, axis, bad)
    codec.home(garbage)
    assert codec.dropped == 1
    found = codec.position(local_position((1.0, 2.0, -3.0)))
    assert found is not None
    assert found.pos_ned_m == pytest.approx((1.0, 2.0, -3.0), abs=0.01)


def test_home_across_the_antimeridian_is_near() -> None:
    codec = Codec(1, LocalFrame(Wgs84(-17.0, 179.9999, 0.0)))
    codec.home(dialect.MAVLink_home_position_message(-170_000_000, -1_799_999_000, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    assert codec.home_known


def test_home_on_the_other_side_of_the_earth_is_refused() -> None:
    codec = Codec(1, FRAME)
    codec.home(dialect.MAVLink_home_position_message(0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
    assert not codec.home_known
    assert codec.dropped == 1


@pytest.mark.parametrize("bad", BAD_FLOATS)
@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
def test_own_position_that_makes_no_sense_is_refused(bad: float, field: str) -> None:
    codec = codec_at((1.0, 2.0, -3.0))
    garbage = local_position((5.0, 5.0, -5.0))
    setattr(garbage, field, bad)
    assert codec.position(garbage) is None
    assert codec.dropped == 1
    # ... and is not what the next beacon tells.
    assert on_wire(codec.encode_beacon(beacon()))[1].alt == 403_000


# --- the autopilot's word ---


@pytest.mark.parametrize(
    ("custom_mode", "mode", "name"),
    [
        (6 << 16, FlightMode.OFFBOARD, "OFFBOARD"),
        (4 << 16 | 2 << 24, FlightMode.TAKEOFF, "AUTO.TAKEOFF"),
        (4 << 16 | 3 << 24, FlightMode.HOLD, "AUTO.HOLD"),
        (4 << 16 | 5 << 24, FlightMode.RETURN, "AUTO.RTL"),
        (4 << 16 | 6 << 24, FlightMode.LAND, "AUTO.LAND"),
        (3 << 16, FlightMode.OTHER, "POSCTL"),
        (4 << 16 | 4 << 24, FlightMode.OTHER, "custom mode 0x4040000"),
        (0, FlightMode.OTHER, "custom mode 0x0"),
        (0xFFFFFFFF, FlightMode.OTHER, "custom mode 0xffffffff"),
    ],
)
@pytest.mark.parametrize("armed", [True, False])
def test_px4s_modes_are_told_apart(custom_mode: int, mode: FlightMode, name: str, armed: bool) -> None:
    base_mode = 1 | (128 if armed else 0)
    message = dialect.MAVLink_heartbeat_message(2, 12, base_mode, custom_mode, 4, 3)
    assert Codec(1, FRAME).mode(message) == AutopilotMode(mode, armed, name)


@pytest.mark.parametrize(
    ("custom_mode", "mode", "name"),
    [
        (4, FlightMode.OFFBOARD, "GUIDED"),
        (17, FlightMode.HOLD, "BRAKE"),
        (9, FlightMode.LAND, "LAND"),
        (6, FlightMode.RETURN, "RTL"),
        (5, FlightMode.OTHER, "LOITER"),  # follows the sticks
        (0, FlightMode.OTHER, "STABILIZE"),
        (99, FlightMode.OTHER, "custom mode 0x63"),
    ],
)
@pytest.mark.parametrize(("status", "failsafe"), [(3, False), (4, False), (5, True), (6, True)])
def test_ardupilots_modes_are_told_apart(
    custom_mode: int, mode: FlightMode, name: str, status: int, failsafe: bool
) -> None:
    message = dialect.MAVLink_heartbeat_message(2, 3, 0x81, custom_mode, status, 3)
    found = Codec(1, FRAME).mode(message)
    assert found == AutopilotMode(mode, True, name, failsafe, CLIMBS_IN_OFFBOARD)


@pytest.mark.parametrize(
    ("prearm", "flags", "ready"),
    [(0, 0x33F, False), (1, 0xA7, False), (1, 0, False), (1, 0x33F, True), (1, 0x10, True)],
)
def test_ardupilot_is_ready_with_the_prearm_bit_and_a_level_position(prearm: int, flags: int, ready: bool) -> None:
    codec = Codec(1, FRAME)
    codec.mode(dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3))
    codec.ekf(dialect.MAVLink_ekf_status_report_message(flags, 0, 0, 0, 0, 0))
    health = codec.health(dialect.MAVLink_sys_status_message(0, 0, prearm << 28, 0, 0, 0, 50, 0, 0, 0, 0, 0, 0))
    assert health.ready_to_arm is ready


def chunk(text: str, text_id: int = 0, seq: int = 0) -> Any:
    return dialect.MAVLink_statustext_message(4, text.encode(), text_id, seq)


def texts(*messages: Any) -> list[str]:
    codec = Codec(1, FRAME)
    parsed = [m for sent in messages for m in dialect.MAVLink(None).parse_buffer(sent.pack(dialect.MAVLink(None)))]
    return [found.text for m in parsed if (found := codec.text(m)) is not None]


def test_text_in_chunks_is_put_together_and_its_tab_dropped() -> None:
    long = "Preflight Fail: " + "barometer 0 and then some more of it " * 3 + "end\t"
    parts = [long[k : k + 50] for k in range(0, len(long), 50)]
    assert texts(*[chunk(part, 7, seq) for seq, part in enumerate(parts)]) == [long.strip()]


def test_text_of_exactly_fifty_letters_ends_with_an_empty_chunk() -> None:
    assert texts(chunk("x" * 50, 7), chunk("", 7, 1)) == ["x" * 50]
    assert texts(chunk("x" * 50)) == ["x" * 50]  # without an id it is whole


@pytest.mark.parametrize(
    "sent",
    [
        [chunk("y" * 50, 7, 1), chunk("end", 7, 2)],
        [chunk("x" * 50, 7), chunk("end", 7, 2)],
        [chunk("x" * 50, 7), chunk("end", 8, 1)],
    ],
)
def test_text_that_lacks_a_chunk_is_dropped_and_the_next_one_is_heard(sent: list[Any]) -> None:
    assert texts(*sent, chunk("next", 9)) == ["next"]


def test_endless_text_is_cut() -> None:
    assert [len(text) for text in texts(*[chunk("x" * 50, 7, k) for k in range(8)])] == [400]


@pytest.mark.parametrize(
    ("remaining", "percent"), [(0, 0), (55, 55), (100, 100), (-1, None), (101, None), (-128, None)]
)
def test_battery_is_a_percentage_or_unknown(remaining: int, percent: int | None) -> None:
    message = dialect.MAVLink_sys_status_message(0, 0, 1 << 28, 0, 0, 0, remaining, 0, 0, 0, 0, 0, 0)
    health = Codec(1, FRAME).health(message)
    assert (health.ready_to_arm, health.battery_percent) == (True, percent)


def test_ready_to_arm_is_the_prearm_bit_of_health_alone() -> None:
    message = dialect.MAVLink_sys_status_message(
        1 << 28, 1 << 28, ~(1 << 28) & 0xFFFFFFFF, 0, 0, 0, 50, 0, 0, 0, 0, 0, 0
    )
    assert not Codec(1, FRAME).health(message).ready_to_arm


@pytest.mark.parametrize("value", [*range(7), 128, 255])
def test_landed_state_is_one_of_the_enum_or_refused(value: int) -> None:
    codec = Codec(1, FRAME)
    found = codec.landed(dialect.MAVLink_extended_sys_state_message(0, value))
    assert found == (Landed(LandedState(value)) if value <= 4 else None)
    assert codec.dropped == (value > 4)


@pytest.mark.parametrize("request_", list(Request))
@pytest.mark.parametrize("result", list(Result))
def test_answer_names_the_request(request_: Request, result: Result) -> None:
    command, _ = PX4.command(request_, Codec(1, FRAME).altitude(0.0))
    message = dialect.MAVLink_command_ack_message(command, result)
    assert Codec(1, FRAME).answer(message) == Answer(request_, result)


def test_answer_to_what_the_core_did_not_ask_is_no_news() -> None:
    codec = Codec(1, FRAME)
    assert codec.answer(dialect.MAVLink_command_ack_message(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0)) is None
    assert codec.dropped == 0
    assert codec.answer(dialect.MAVLink_command_ack_message(dialect.MAV_CMD_NAV_LAND, 200)) is None
    assert codec.dropped == 1


def test_text_is_trimmed() -> None:
    text = Codec(1, FRAME).text(dialect.MAVLink_statustext_message(4, b" Arming denied "))
    assert (text.severity, text.text) == (4, "Arming denied")


# --- to the autopilot ---


def test_setpoint_is_velocity_and_yaw_and_nothing_else() -> None:
    payload = Codec(7, FRAME).setpoint((1.0, -2.0, 0.5), 1.25, 123_456)
    setpoint = dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
    m = wire.fields(wire.frame(setpoint, payload, seq=0, system=7, component=191))
    assert (m.time_boot_ms, m.target_system, m.target_component) == (123_456, 7, 1)
    assert m.coordinate_frame == 1  # MAV_FRAME_LOCAL_NED
    assert (m.vx, m.vy, m.vz, m.yaw) == (1.0, -2.0, 0.5, 1.25)
    ignored = {"x", "y", "z", "ax", "ay", "az", "yaw_rate"}
    bits = {"x": 0, "y": 1, "z": 2, "vx": 3, "vy": 4, "vz": 5, "ax": 6, "ay": 7, "az": 8, "yaw": 10, "yaw_rate": 11}
    assert {name for name, bit in bits.items() if m.type_mask >> bit & 1} == ignored
    assert not m.type_mask >> 9 & 1  # not a force
    assert m.type_mask < 1 << 12
    assert (m.x, m.y, m.z, m.afx, m.afy, m.afz, m.yaw_rate) == (0.0,) * 7


def test_command_goes_to_the_own_autopilot_padded_with_zeros() -> None:
    m = Codec(7, FRAME).command(511, 32, 50_000.0)
    assert (m.target_system, m.target_component, m.command, m.confirmation) == (7, 1, 511, 0)
    parameters = [m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7]
    assert parameters == [32, 50_000.0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("make", "request_", "command", "parameters"),
    [
        (PX4, Request.ARM, 400, [1, 0, 0, 0, 0, 0, 0]),  # never forced: param2 is not 21196
        (PX4, Request.OFFBOARD, 176, [1, 6, 0, 0, 0, 0, 0]),
        (PX4, Request.TAKEOFF, 22, [NAN] * 6 + [408.0]),
        (PX4, Request.LAND, 21, [NAN] * 7),
        (ARDUPILOT, Request.ARM, 400, [1, 0, 0, 0, 0, 0, 0]),
        (ARDUPILOT, Request.OFFBOARD, 176, [1, 4, 0, 0, 0, 0, 0]),
        (ARDUPILOT, Request.TAKEOFF, 22, [0] * 6 + [10.5]),
        (ARDUPILOT, Request.LAND, 21, [0] * 7),
    ],
)
def test_requests_are_the_makes_commands(make: Make, request_: Request, command: int, parameters: list[float]) -> None:
    codec = Codec(1, FRAME)
    codec.home(home((0.0, 0.0, 2.5)))  # below the origin
    number, values = make.command(request_, codec.altitude(8.0))
    m = codec.command(number, *values)
    assert number == command
    sent = [m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7]
    assert sent == pytest.approx(parameters, nan_ok=True)
    assert REQUESTS[number] is request_


def test_altitude_above_home_is_above_the_vehicle_while_home_is_unknown() -> None:
    codec = Codec(1, FRAME)
    assert codec.altitude(8.0).above_home_m == 8.0
    codec.origin(dialect.MAVLink_gps_global_origin_message(470_000_000, 80_000_000, 403_000, 0))
    codec.position(local_position((0.0, 0.0, 1.0)))
    assert codec.altitude(8.0).above_home_m == pytest.approx(6.0)


# --- beacons ---


def test_no_beacon_is_sent_or_understood_before_the_own_position_is_known() -> None:
    codec = Codec(1, FRAME)
    assert codec.encode_beacon(beacon()) is None
    assert heard(codec, 2, wire_beacon()) is None
    assert codec.dropped == 0


FULL = Beacon(
    sender=2,
    time_ms=4_294_967_295,
    vel_ned_mps=(1.5, -2.25, 0.125),
    ref_ned_mps=(3.0, 0.5, -0.75),
    dest_ned_m=(130.5, -20.25, 1.0),
    route_cost=21.5,
    governor=0.625,
    lease=lease(250, 4_294_967_295, priority=250, score=10, established=True, heir=249, ends=4_294_967_295),
    hop=250,
    agreed=True,
    candidate=Candidate(248, 3, 9),
    parent=250,
    phase=SwarmPhase.COVERAGE,
    state=FlightState.RELEASED,
    airborne=True,
    start=True,
    abort=True,
    done=1 << 249 | 5,
    range_m=55.0,
    present=1 << 249 | 7,
    flown=(1 << 250) - 1,
    sighting=Sighting(247, (20.5, -10.25, 0.0), 12.5, silent=True),
)


def test_beacon_survives_the_wire_with_its_position_relative_to_the_receiver() -> None:
    me, other = codec_at((3.0, 4.0, -8.0)), codec_at((23.0, -6.0, -10.0), vehicle_id=2)
    found = heard(me, *on_wire(other.encode_beacon(FULL)))
    assert found is not None
    assert found.rel_ned_m == pytest.approx((20.0, -10.0, -2.0), abs=0.02)
    for field in fields(Beacon):
        assert getattr(found.said, field.name) == getattr(FULL, field.name), field.name


def test_age_of_a_sighting_is_bounded_on_the_wire() -> None:
    other = codec_at((0.0, 0.0, -8.0), vehicle_id=2)
    ages = {}
    for age_s in (6553.4, 1e9):
        said = replace(FULL, sighting=Sighting(3, (0.0, 0.0, 0.0), age_s, silent=True))
        ages[age_s] = on_wire(other.encode_beacon(said))[1].seen_age
    assert ages == {6553.4: 65534, 1e9: 65535}


def test_flags_are_carried_one_by_one() -> None:
    me, other = codec_at((0.0, 0.0, -8.0)), codec_at((5.0, 0.0, -8.0))
    for name in ("airborne", "start", "abort", "agreed"):
        found = heard(me, *on_wire(other.encode_beacon(beacon(2, **{name: True}))))
        assert found is not None
        names = ("airborne", "start", "abort", "agreed")
        assert [getattr(found.said, n) for n in names] == [name == n for n in names]
        assert found.said.dest_ned_m is None
        assert found.said.lease is None
    established = heard(me, *on_wire(other.encode_beacon(beacon(2, lease=lease(4, established=True)))))
    claimed = heard(me, *on_wire(other.encode_beacon(beacon(2, lease=lease(4)))))
    assert established is not None
    assert established.said.lease == lease(4, established=True)
    assert claimed is not None
    assert claimed.said.lease == lease(4)


def test_destination_at_the_senders_own_place_is_not_taken_for_none() -> None:
    me, other = codec_at((0.0, 0.0, -8.0)), codec_at((5.0, 0.0, -8.0))
    found = heard(me, *on_wire(other.encode_beacon(beacon(2, dest_ned_m=(0.0, 0.0, 0.0)))))
    assert found is not None
    assert found.said.dest_ned_m == (0.0, 0.0, 0.0)


def test_time_wraps_instead_of_failing() -> None:
    other = codec_at((5.0, 0.0, -8.0))
    assert on_wire(other.encode_beacon(beacon(2, time_ms=2**32 + 17)))[1].time_boot_ms == 17


POSITIONS = ["dest_x", "dest_y", "dest_z"]
SPEEDS = ["vx", "vy", "vz", "ref_vx", "ref_vy", "ref_vz"]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *[(field, value) for field in POSITIONS for value in [*BAD_FLOATS, 1.01 * FURTHEST_M, -1.01 * FURTHEST_M]],
        *[(field, value) for field in SPEEDS for value in [*BAD_FLOATS, 1.01 * FASTEST_MPS, -1.01 * FASTEST_MPS]],
        *[("route_cost", value) for value in (NAN, -INF, -1.0, -1e-9)],
        *[("governor", value) for value in (*BAD_FLOATS, -0.01, 1.01)],
        *[("phase", value) for value in (len(SwarmPhase), 7, 8 + len(SwarmPhase), (MAX_STOPS + 1) * 8, 255)],
        *[("flight_state", value) for value in (len(FlightState), 128, 255)],
        *[("seen_" + axis, value) for axis in "xyz" for value in [*BAD_FLOATS, 1.01 * FURTHEST_M, -1.01 * FURTHEST_M]],
        *[("lat", value) for value in (2**31 - 1, -(2**31), 0)],
        *[("lon", value) for value in (2**31 - 1, -(2**31), 0)],
        *[("alt", value) for value in (2**31 - 1, -(2**31))],
    ],
)
def test_beacon_with_a_field_that_makes_no_sense_is_refused_and_counted(field: str, value: float) -> None:
    me = codec_at((0.0, 0.0, -8.0))
    assert heard(me, 2, wire_beacon()) is not None
    assert me.dropped == 0
    assert heard(me, 2, wire_beacon(**{field: value})) is None
    assert me.dropped == 1


def test_infinite_route_cost_is_no_route_but_no_nonsense_either() -> None:
    found = heard(codec_at((0.0, 0.0, -8.0)), 2, wire_beacon(route_cost=INF))
    assert found is not None
    assert found.said.route_cost == INF


@pytest.mark.parametrize("version", [0, 2, 255])
def test_beacon_of_another_version_is_dropped_and_counted(version: int) -> None:
    me = codec_at((0.0, 0.0, -8.0))
    assert heard(me, 2, wire_beacon(version=version)) is None
    assert (me.other_versions, me.dropped) == (1, 0)


def test_bounds_of_the_table_are_believed_and_what_lies_beyond_them_is_not() -> None:
    me = codec_at((0.0, 0.0, -8.0))
    for field in swarm_beacon.FIELDS:
        for bound, step in ((field.least, -1), (field.most, 1)):
            if math.isfinite(bound):
                assert heard(me, 2, wire_beacon(**{field.name: bound})) is not None, field.name
                if field.type == "float" or bound + step >= 0:
                    assert heard(me, 2, wire_beacon(**{field.name: bound + step})) is None, field.name
