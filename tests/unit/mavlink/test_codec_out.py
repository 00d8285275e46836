"""The codec: what goes to the autopilot, and beacons."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import pytest

from companion.core.model.beacon import Beacon, Candidate, PeerReport
from companion.core.model.states import FlightState, Request, SwarmPhase
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.framing import wire
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.make import REQUESTS, Make
from companion.mavlink.makes.px4 import PX4
from companion.mavlink.own_messages import FASTEST_MPS, FURTHEST_M
from companion.mavlink.schema.tables.beacon import BEACON
from mission.schema.tables import MAX_LANES
from tests.unit.core.core_kit import beacon, lease
from tests.unit.mavlink.codec_kit import BAD_FLOATS, FRAME, INF, NAN, codec_at, heard, home, local_position, on_wire


def wire_beacon(**changes: Any) -> swarm_beacon.WireBeacon:
    """A plausible beacon from ten metres north of the origin, with these fields changed."""
    payload = codec_at((10.0, 0.0, -8.0)).encode_beacon(beacon(2, lease=lease(2), dest_ned_m=(1.0, 2.0, 3.0)))
    return on_wire(payload)[1]._replace(**changes)


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
    sighting=PeerReport(247, (20.5, -10.25, 0.0), 12.5, silent=True),
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
    for age_s in (819.0, 1e9):
        said = replace(FULL, sighting=PeerReport(3, (0.0, 0.0, 0.0), age_s, silent=True))
        ages[age_s] = on_wire(other.encode_beacon(said))[1].seen_age
    assert ages == {819.0: 8190, 1e9: 8191}


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
        *[("phase", value) for value in (len(SwarmPhase), 7, 8 + len(SwarmPhase), (2 * MAX_LANES + 1) * 8, 255)],
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
    for field in BEACON.fields:
        for bound, step in ((field.least, -1), (field.most, 1)):
            if math.isfinite(bound):
                assert heard(me, 2, wire_beacon(**{field.name: bound})) is not None, field.name
                if field.type == "float" or bound + step >= 0:
                    assert heard(me, 2, wire_beacon(**{field.name: bound + step})) is None, field.name
