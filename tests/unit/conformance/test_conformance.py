"""The comparison with recorded flights finds what is wrong: each test doctors one thing of a flight."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.document.model import Personality
from sim_bridge import cli
from sim_bridge.conformance import RECORDINGS, compare, conformance
from sim_bridge.conformance.check import Check
from sim_bridge.conformance.explained import Explained, judge
from sim_bridge.conformance.recording import Frame, Recording, RecordingError, load
from sim_bridge.conformance.report import Report
from sim_bridge.conformance.steps import measure, rows

FLIGHT = RECORDINGS / "px4_loss_sp_RCACT4.tlog.xz"
LOCAL = mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED


kept = cache(load)  # a recording is frozen


@pytest.fixture
def recorded() -> Recording:
    return kept(FLIGHT)


def doctored(flight: Recording, change: Callable[[Frame], Frame | None]) -> Recording:
    """`change` of every frame; None drops it."""
    return replace(flight, heard=tuple(new for frame in flight.heard if (new := change(frame)) is not None))


def with_field(frame: Frame, **fields: Any) -> Frame:
    """Another message in it."""
    message = copy(frame.message)
    for name, value in fields.items():
        setattr(message, name, value)
    return replace(frame, message=message)


def of(checks: list[Check], name: str) -> list[str]:
    return [difference.what for check in checks if check.name == name for difference in check.differences]


def test_a_flight_is_like_itself(recorded: Recording) -> None:
    assert [check.differences for check in compare(recorded, recorded)] == [()] * 9


def test_recorded_times_are_the_autopilots(recorded: Recording) -> None:
    """Its simulator ran up to 1.4 % slower than the wall clock of the log."""
    late_s = [f.at_s - f.message.time_boot_ms / 1e3 for f in recorded.heard if f.id == LOCAL]
    late_s.sort()
    assert late_s[0] > -0.05
    assert late_s[len(late_s) * 95 // 100] < 0.05


def test_another_result_is_found(recorded: Recording) -> None:
    def denied(frame: Frame) -> Frame:
        takeoff = frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK and frame.message.command == mav.MAV_CMD_NAV_TAKEOFF
        return with_field(frame, result=mav.MAV_RESULT_DENIED) if takeoff else frame

    assert of(compare(recorded, doctored(recorded, denied)), "commands") == [
        "ack 22 ACCEPTED to 245/191",
        "ack 22 DENIED to 245/191",
    ]


def test_an_ack_to_somebody_else_is_found(recorded: Recording) -> None:
    def astray(frame: Frame) -> Frame:
        land = frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK and frame.message.command == mav.MAV_CMD_NAV_LAND
        return with_field(frame, target_component=1) if land else frame

    assert "ack 21 ACCEPTED to 245/1" in of(compare(recorded, doctored(recorded, astray)), "commands")


def test_late_acks_are_found(recorded: Recording) -> None:
    def late(frame: Frame) -> Frame:
        return replace(frame, at_s=frame.at_s + 0.1) if frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK else frame

    assert "latency of an ack" in of(compare(recorded, doctored(recorded, late)), "commands")


def test_a_state_that_is_not_shown_is_found(recorded: Recording) -> None:
    def calm(frame: Frame) -> Frame:
        critical = frame.id == mav.MAVLINK_MSG_ID_HEARTBEAT and frame.message.system_status == mav.MAV_STATE_CRITICAL
        return with_field(frame, system_status=mav.MAV_STATE_ACTIVE) if critical else frame

    assert of(compare(recorded, doctored(recorded, calm)), "heartbeat") == ["0x6040000 157 5"]


def test_a_failsafe_that_comes_late_is_found(recorded: Recording) -> None:
    began_s = next(
        f.at_s for f in recorded.heard if f.id == mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE and f.message.landed_state == 4
    )

    def later(frame: Frame) -> Frame:
        early = frame.id == mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE and began_s <= frame.at_s < began_s + 1.5
        return with_field(frame, landed_state=2) if early else frame

    assert of(compare(recorded, doctored(recorded, later)), "landed_state") == ["4"]


@pytest.mark.parametrize(
    ("keep", "what"),
    [(0, "SYS_STATUS (1)"), (2, "SYS_STATUS (1) from 2 s")],
)
def test_a_stream_that_is_missing_or_slow_is_found(recorded: Recording, keep: int, what: str) -> None:
    counted = iter(range(100_000))

    def thinned(frame: Frame) -> Frame | None:
        drop = frame.id == mav.MAVLINK_MSG_ID_SYS_STATUS and (keep == 0 or next(counted) % keep)
        return None if drop else frame

    assert [name.split(" from")[0] for name in of(compare(recorded, doctored(recorded, thinned)), "streams")] == [
        what.split(" from")[0]
    ]


def test_an_unheard_of_stream_is_found(recorded: Recording) -> None:
    def more(frame: Frame) -> Frame:
        return replace(frame, id=148 + 10_000) if frame.id == mav.MAVLINK_MSG_ID_VIBRATION else frame

    assert of(compare(recorded, doctored(recorded, more)), "streams") == ["VIBRATION (241)", "message 10148"]


def test_a_wrong_parameter_and_a_missing_home_are_found() -> None:
    flight = kept(RECORDINGS / "px4_pymavlink_B.tlog.xz")

    def wrong(frame: Frame) -> Frame | None:
        if frame.id == mav.MAVLINK_MSG_ID_PARAM_VALUE and frame.message.param_id == "MPC_TKO_SPEED":
            return with_field(frame, param_value=1.0)
        return None if frame.id == mav.MAVLINK_MSG_ID_HOME_POSITION else frame

    assert set(of(compare(flight, doctored(flight, wrong)), "answers")) == {
        "PARAM_VALUE MPC_TKO_SPEED 1.5",
        "PARAM_VALUE MPC_TKO_SPEED 1",
        "HOME_POSITION when asked for",
        "HOME_POSITION not yet when asked for",
    }


def test_a_refusal_in_other_words_is_found() -> None:
    flight = kept(RECORDINGS / "ap_pymavlink_A.tlog.xz")

    def silent(frame: Frame) -> Frame | None:
        text = frame.message.text if frame.id == mav.MAVLINK_MSG_ID_STATUSTEXT else ""
        return None if text.startswith("No such mode") else frame

    assert of(compare(flight, doctored(flight, silent)), "texts") == ["No such mode 99"]


def test_another_height_descent_and_climb_are_found(recorded: Recording) -> None:
    def scaled(frame: Frame) -> Frame:
        return with_field(frame, z=2.0 * frame.message.z) if frame.id == LOCAL else frame

    checks = compare(recorded, doctored(recorded, scaled))
    assert of(checks, "takeoff") == ["height"]
    assert of(checks, "setpoint loss") == ["sink rate"]
    assert of(checks, "landing") == ["mean sink rate"]


def test_a_difference_is_explained_only_where_it_is_said_and_an_old_explanation_fails(recorded: Recording) -> None:
    def mute(frame: Frame) -> Frame | None:
        return None if frame.id == mav.MAVLINK_MSG_ID_VIBRATION else frame

    checks = compare(recorded, doctored(recorded, mute))
    name = recorded.name
    known = Explained(Personality.PX4, "streams", frozenset({"VIBRATION (241)"}), "no reason", frozenset({name}))
    assert judge(Personality.PX4, name, checks, (known,)).holds
    assert not judge(Personality.PX4, name, checks, ()).holds
    assert not judge(Personality.PX4, "another", checks, (known,)).holds
    assert not judge(Personality.ARDUPILOT, name, checks, (known,)).holds
    same = compare(recorded, recorded)
    assert judge(Personality.PX4, name, same, (known,)).stale == (known,)
    assert not judge(Personality.PX4, name, same, (known,)).holds


def test_what_is_explained_and_never_seen_is_named_when_all_were_flown() -> None:
    assert Report((), ()).holds
    assert not Report((), (), complete=True).holds


def test_a_step_is_measured_as_it_is() -> None:
    """A first-order lag of 0.5 s that ends at 90 %, put in the place of what was heard."""
    flight = kept(RECORDINGS / "ap_pymavlink_A.tlog.xz")
    setpoints = [f for f in flight.sent if f.id == mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED]
    begin_s = next(f.at_s for f in setpoints if f.message.vx == 3.0)
    end_s = next(f.at_s for f in setpoints if f.message.vx == 0.0 and f.at_s > begin_s)

    def lagging(frame: Frame) -> Frame:
        if frame.id != LOCAL or not begin_s <= frame.at_s < end_s:
            return frame
        share = 0.95 * (1.0 - 2.718281828 ** (-(frame.at_s - begin_s) / 0.5))
        return with_field(frame, vx=3.0 * share, vy=0.0, vz=0.0)

    (response,) = [found for kind, found in measure(doctored(flight, lagging)) if kind == "0 -> 3.0 level"]
    assert response == pytest.approx((0.06, 0.54, 1.47, 0.0, 0.05), abs=0.04)


def test_a_sluggish_vehicle_is_outside_the_spread() -> None:
    flight = kept(RECORDINGS / "ap_pymavlink_A.tlog.xz")
    late = doctored(flight, lambda frame: replace(frame, at_s=frame.at_s + 0.4) if frame.id == LOCAL else frame)
    assert all(row.within for row in rows([flight], [flight]))
    assert not any(row.within for row in rows([flight], [late]))


def test_a_file_that_is_no_recording_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "none.tlog"
    file.write_bytes(b"12345678\xfd\x09garbage")
    assert cli.main(["conformance", str(file)]) == 2
    assert "none.tlog: not a telemetry log" in capsys.readouterr().err
    assert cli.main(["conformance", str(tmp_path / "absent.tlog")]) == 2
    assert "absent.tlog" in capsys.readouterr().err
    with pytest.raises(RecordingError):
        conformance([file])
