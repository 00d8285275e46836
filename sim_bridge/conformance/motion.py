"""Compares what the vehicle does: the states that a client sees, takeoff, loss of setpoints, landing.

One function a check, each with the tolerance that it allows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from statistics import median

from companion.mavlink import dialect as mav
from sim_bridge.conformance.check import Check, Difference, moved
from sim_bridge.conformance.recording import Frame, Recording

ASKED_WITHIN_S = 1.1  # what the client or a failsafe brings about; a heartbeat can show it up to 1 s late
CLIMB_WITHIN_S = 2.0
LANDING_WITHIN = 0.45  # of the landing's time: the recorded ones sank at 0.27 to 0.55 m/s for one and the same 0.7
HEIGHT_WITHIN_M = 0.7  # PX4's estimate wanders by as much before the first setpoint
SINK_WITHIN_MPS = 0.25
DRIFT_WITHIN_M = 3.0  # PX4's hover wanders by up to 0.9 m, its emergency descent by more
GAP_S = 1.5  # without setpoints for so long: they were meant to stop


@dataclass(frozen=True, slots=True)
class Change:
    """A state that a client sees from `at_s` on."""

    at_s: float
    state: tuple[int, ...]


def heartbeats(recorded: Recording, ours: Recording) -> Check:
    """HEARTBEAT: custom_mode, base_mode, system_status: the same sequence, each within its tolerance."""
    return _states("heartbeat", recorded, ours, modes, lambda state: f"{state[0]:#x} {state[1]} {state[2]}")


def landed_states(recorded: Recording, ours: Recording) -> Check:
    """EXTENDED_SYS_STATE.landed_state: the same sequence, each within its tolerance."""
    return _states("landed_state", recorded, ours, landed, lambda state: f"{state[0]}")


def modes(flight: Recording) -> list[Change]:
    """As HEARTBEAT shows them."""
    return _changes(
        (frame.at_s, (frame.message.custom_mode, frame.message.base_mode, frame.message.system_status))
        for frame in flight.heard
        if frame.id == mav.MAVLINK_MSG_ID_HEARTBEAT
    )


def landed(flight: Recording) -> list[Change]:
    """As EXTENDED_SYS_STATE shows them."""
    return _changes(
        (frame.at_s, (frame.message.landed_state,))
        for frame in flight.heard
        if frame.id == mav.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
    )


def _changes(seen: Iterable[tuple[float, tuple[int, ...]]]) -> list[Change]:
    changes: list[Change] = []
    for at_s, state in seen:
        if not changes or changes[-1].state != state:
            changes.append(Change(at_s, state))
    return changes


def _states(
    name: str,
    recorded: Recording,
    ours: Recording,
    states: Callable[[Recording], list[Change]],
    shown: Callable[[tuple[int, ...]], str],
) -> Check:
    want, have = states(recorded), states(ours)
    while len(have) > len(want) and have[-1].at_s > recorded.end_s:
        have.pop()  # after the recording's end
    found = moved([shown(change.state) for change in want], [shown(change.state) for change in have])
    worst_s = 0.0
    if not found:
        for one, other in zip(want, have, strict=True):
            late_s = other.at_s - one.at_s
            allowed_s = _allowed_s(recorded, one.at_s)
            if abs(late_s) > abs(worst_s):
                worst_s = late_s
            if abs(late_s) > allowed_s:
                found.append(Difference(shown(one.state), f"{one.at_s:.2f} s", f"{other.at_s:.2f} s"))
    return Check(name, f"{len(want)}, {worst_s:+.2f} s", tuple(found))


def _allowed_s(recorded: Recording, at_s: float) -> float:
    """Tolerance of a change's time: those that end a climb or a landing depend on how fast the vehicle is."""
    sequence = landed(recorded)
    for before, change in pairwise(sequence):
        if abs(at_s - change.at_s) > 3.5:  # a heartbeat, and the 2 s from landed to disarmed
            continue
        if change.state == (mav.MAV_LANDED_STATE_ON_GROUND,) and at_s >= change.at_s - 1.0:
            began_s = before.at_s
            lost = [gap_s for gap_s in losses(recorded) if gap_s > before.at_s]
            return max(ASKED_WITHIN_S, LANDING_WITHIN * (change.at_s - (lost[0] if lost else began_s)))
        if before.state == (mav.MAV_LANDED_STATE_TAKEOFF,) and change.state == (mav.MAV_LANDED_STATE_IN_AIR,):
            return CLIMB_WITHIN_S
    return ASKED_WITHIN_S


def takeoff(recorded: Recording, ours: Recording) -> Check:
    """Height reached, and the time from the takeoff's begin to 80 % of it."""
    want, have = _takeoff(recorded), _takeoff(ours)
    if want is None or have is None:
        return Check("takeoff", "-", () if want is have else (Difference("takeoff", str(want), str(have)),))
    found = []
    if abs(want[0] - have[0]) > HEIGHT_WITHIN_M:
        found.append(Difference("height", f"{want[0]:.1f} m", f"{have[0]:.1f} m"))
    if abs(want[1] - have[1]) > CLIMB_WITHIN_S:
        found.append(Difference("climb time", f"{want[1]:.1f} s", f"{have[1]:.1f} s"))
    return Check("takeoff", f"{want[0]:.1f} / {have[0]:.1f} m, {want[1]:.1f} / {have[1]:.1f} s", tuple(found))


def _takeoff(flight: Recording) -> tuple[float, float] | None:
    """Height in m before the first setpoint or landing; seconds from the last takeoff command to 80 % of it."""
    begins = _accepted(flight, mav.MAV_CMD_NAV_TAKEOFF)
    if not begins:
        return None
    begin_s = begins[-1]
    later = [f.at_s for f in flight.sent if f.at_s > begin_s and _steers(f)]
    end_s = min(later, default=flight.end_s)
    track = heights(flight)
    ground_m = [height_m for at_s, height_m in track if at_s <= begin_s][-1]
    climb = [(at_s, height_m - ground_m) for at_s, height_m in track if begin_s < at_s < end_s]
    reached_m = median(height_m for at_s, height_m in climb if at_s > end_s - 1.0)
    there_s = next(at_s for at_s, height_m in climb if height_m >= 0.8 * reached_m)
    return reached_m, there_s - begin_s


def _accepted(flight: Recording, command: int) -> list[float]:
    return [
        frame.at_s
        for frame in flight.heard
        if frame.id == mav.MAVLINK_MSG_ID_COMMAND_ACK
        and (frame.message.command, frame.message.result) == (command, mav.MAV_RESULT_ACCEPTED)
    ]


def _steers(frame: Frame) -> bool:
    if frame.id == mav.MAVLINK_MSG_ID_COMMAND_LONG:
        return bool(frame.message.command in (mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_COMPONENT_ARM_DISARM))
    return bool(frame.id == mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED)


def heights(flight: Recording) -> list[tuple[float, float]]:
    """(s, m above the local origin)"""
    return [
        (frame.at_s, -frame.message.z) for frame in flight.heard if frame.id == mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    ]


def losses(flight: Recording) -> list[float]:
    """Times at which setpoints stopped for longer than GAP_S, other than for a landing or another mode."""
    times = [f.at_s for f in flight.sent if f.id == mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED]
    asked = [
        f.at_s
        for f in flight.sent
        if f.id == mav.MAVLINK_MSG_ID_COMMAND_LONG
        and f.message.command in (mav.MAV_CMD_NAV_LAND, mav.MAV_CMD_DO_SET_MODE)
    ]
    found = []
    for at_s, next_s in pairwise([*times, math.inf]):
        if next_s - at_s > GAP_S and not any(-1.0 < other_s - at_s < GAP_S for other_s in asked):
            found.append(at_s)
    return found


def setpoint_loss(recorded: Recording, ours: Recording) -> Check:
    """Motion of the vehicle from 2.5 to 6.5 s after the last setpoint: sink rate; and how far it has come."""
    found: list[Difference] = []
    parts = []
    for at_s in losses(recorded):
        want, have = _after_loss(recorded, at_s), _after_loss(ours, at_s)
        parts.append(f"{want[0]:.2f} / {have[0]:.2f} m/s, {want[1]:.1f} / {have[1]:.1f} m")
        if abs(want[0] - have[0]) > SINK_WITHIN_MPS:
            found.append(Difference("sink rate", f"{want[0]:.2f} m/s", f"{have[0]:.2f} m/s"))
        if abs(want[1] - have[1]) > DRIFT_WITHIN_M:
            found.append(Difference("way", f"{want[1]:.1f} m", f"{have[1]:.1f} m"))
    return Check("setpoint loss", "; ".join(parts) or "-", tuple(found))


def _after_loss(flight: Recording, at_s: float) -> tuple[float, float]:
    track = [
        (f.at_s, (f.message.x, f.message.y, f.message.z))
        for f in flight.heard
        if f.id == mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    ]

    def position_at(when_s: float) -> tuple[float, float, float]:
        return min(track, key=lambda sample: abs(sample[0] - when_s))[1]

    begin, early, late = position_at(at_s), position_at(at_s + 2.5), position_at(at_s + 6.5)
    return (late[2] - early[2]) / 4.0, math.hypot(late[0] - begin[0], late[1] - begin[1])


def landing(recorded: Recording, ours: Recording) -> Check:
    """From the landing's begin (landed_state 4) to the ground (1): height over time."""
    want, have = _sink_mps(recorded), _sink_mps(ours)
    if want is None or have is None:
        return Check("landing", "-", () if want is have else (Difference("landing", str(want), str(have)),))
    found = []
    if abs(want - have) > SINK_WITHIN_MPS:
        found.append(Difference("mean sink rate", f"{want:.2f} m/s", f"{have:.2f} m/s"))
    return Check("landing", f"{want:.2f} / {have:.2f} m/s", tuple(found))


def _sink_mps(flight: Recording) -> float | None:
    sequence = landed(flight)
    for before, change in pairwise(sequence):
        if (before.state, change.state) == ((mav.MAV_LANDED_STATE_LANDING,), (mav.MAV_LANDED_STATE_ON_GROUND,)):
            track = [height_m for at_s, height_m in heights(flight) if before.at_s <= at_s <= change.at_s]
            return (track[0] - track[-1]) / (change.at_s - before.at_s)
    return None
