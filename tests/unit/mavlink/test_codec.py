"""The codec: the frame's tie and the autopilot's word."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.events import Answer, AutopilotMode, Landed, Position
from companion.core.model.states import FlightMode, LandedState, Request, Result
from companion.mavlink import dialect
from companion.mavlink.codec import Codec
from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.px4 import PX4
from companion.mavlink.own_messages import FURTHEST_M
from mission.common.frames import LocalFrame, Vec3, Wgs84
from tests.unit.core.core_kit import beacon
from tests.unit.mavlink.codec_kit import BAD_FLOATS, FRAME, codec_at, heard, home, local_position, on_wire

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


def test_a_beacon_tells_the_position_that_is_flown_by_where_another_is_reported() -> None:
    me, other = codec_at((0.0, 0.0, -8.0), vehicle_id=1), codec_at((10.0, 3.0, -9.0), vehicle_id=2)
    found = heard(me, *on_wire(other.encode_beacon(beacon(2), None, (-6.0, 0.0, 4.0))))
    assert found is not None
    assert found.rel_ned_m == pytest.approx((4.0, 3.0, 3.0), abs=0.02)


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
    assert Codec(1, FRAME).mode(message) == AutopilotMode(mode, armed, name, traits=PX4.traits)


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
    assert found == AutopilotMode(mode, True, name, failsafe, ARDUPILOT.traits)


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
