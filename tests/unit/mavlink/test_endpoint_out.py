"""What an endpoint sends when its agent wants something done."""

from __future__ import annotations

import math
from typing import Any

import pytest

from companion.core.model.actions import Ask, Say, SendBeacon, SendOdometry, VelocitySetpoint
from companion.core.model.beacon import TrunkReport
from companion.core.model.states import Request, Severity
from companion.core.vehicle.flight import Flight
from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint, Outbox
from companion.mavlink.framing.texts import Reader
from companion.mavlink.relative import read_trunk_report
from mission.document.model import RANGE_MAX_M
from tests.unit.core.core_kit import beacon, mission
from tests.unit.mavlink.endpoint_kit import (
    FLOWING,
    HOME,
    ME,
    TICK_S,
    endpoint,
    heartbeat,
    packed,
    placed,
    position,
    read,
)

# --- what the agent wants done ---


class Puppet:
    """In place of the agent."""

    def __init__(self, *actions: Any) -> None:
        self.actions = list(actions)
        self.flight = Flight(8.0)

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


def test_odometry_tells_a_velocity_by_the_clock_of_our_timesync_and_nothing_else() -> None:
    """As PX4 takes it: velocity of the child frame, NaN for what is not measured."""
    (odometry,) = [m for m in read(told(SendOdometry((1.0, -0.5, 0.25))).autopilot) if m.get_type() == "ODOMETRY"]
    assert (odometry.time_usec, odometry.child_frame_id) == (10_000_000, dialect.MAV_FRAME_LOCAL_NED)
    assert (odometry.vx, odometry.vy, odometry.vz) == (1.0, -0.5, 0.25)
    assert all(math.isnan(value) for value in (odometry.x, odometry.y, odometry.z, odometry.q[0], odometry.yawspeed))
    assert math.isnan(odometry.pose_covariance[0])
    assert [odometry.velocity_covariance[k] for k in (0, 6, 11)] == pytest.approx([0.01] * 3)


def test_ardupilot_is_told_a_velocity_by_the_message_that_it_takes() -> None:
    """Of ODOMETRY it drops every frame but LOCAL_FRD and BODY_FRD, and would take the pose."""
    one = placed()
    one.from_autopilot(packed(heartbeat(4, make=3)), 10.0)
    one.agent = Puppet(SendOdometry((1.0, -0.5, 0.25)))  # type: ignore[assignment]
    sent = [m for m in read(one.tick(10.0).autopilot) if m.get_type() in ("ODOMETRY", "VISION_SPEED_ESTIMATE")]
    (estimate,) = sent
    assert (estimate.get_type(), estimate.usec) == ("VISION_SPEED_ESTIMATE", 10_000_000)
    assert (estimate.x, estimate.y, estimate.z) == (1.0, -0.5, 0.25)
    assert list(estimate.covariance) == pytest.approx([0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.01])


def test_takeoff_is_asked_for_above_mean_sea_level() -> None:
    asked = [m for m in read(told(Ask(Request.TAKEOFF, 8.0)).autopilot) if m.get_type() == "COMMAND_LONG"]
    assert [m.param7 for m in asked if m.command == 22] == [408.0]


def put_together(*messages: Any) -> list[str]:
    """Whole texts of one sender."""
    reader = Reader()
    return [text for m in messages if m.get_type() == "STATUSTEXT" and (text := reader.read_text(m)) is not None]


MISSING = "hold: no quorum, without " + ", ".join(map(str, range(9, 26)))


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


def test_trunks_go_behind_a_beacon_in_a_datagram_of_their_own() -> None:
    out = told(SendBeacon(beacon(ME), trunks=TrunkReport(ME, 7, (0.0, 0.0), ((1.0, 2.0, 0.3),))))
    assert len(swarm_beacon.beacons(out.peers)) == 1
    (aside,) = out.records
    assert read_trunk_report(aside) is not None
    assert told(SendBeacon(beacon(ME))).records == []


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
