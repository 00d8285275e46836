"""Velocity steps: how fast a vehicle follows, measured in the recordings and in our flights by the same code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, median
from typing import NamedTuple

from companion.mavlink import dialect as mav
from mission.common.frames import Vec3
from mission.document.model import Personality
from sim_bridge.conformance.recording import Recording

STEP_MIN_MPS = 0.5  # smaller changes drown in PX4's noise
WINDOW_MIN_S = 3.0  # from one setpoint to the next, else the end is not seen
SETTLED_S = 1.5  # the end of the window
SMOOTH_SAMPLES = 5
STEADY_S = 1.0  # before a step
ALIVE_S = 0.4  # setpoints further apart are a loss, not a step
# What one recording of one flight cannot tell: 20 Hz sampling and smoothing; PX4's hover noise of 0.03-0.17 m/s.
TIME_SLACK_S = 0.15
SHARE_SLACK = 0.10

RULE = (
    f"t10, t63 and t90 lie between the least and the largest of the two recorded autopilots' (all flights), with"
    f" {TIME_SLACK_S} s for sampling; overshoot and settled error are at most the largest recorded + {SHARE_SLACK:.0%}."
)


class Response(NamedTuple):
    """To one step. Times from the setpoint, in seconds; the rest as a share of the step."""

    t10_s: float
    t63_s: float
    t90_s: float
    overshoot: float
    settled_error: float


def measure(flight: Recording) -> list[tuple[str, Response]]:
    """Every step of the flight by its kind, such as "0 -> 3.0 north"."""
    times = [*_setpoint_times(flight), math.inf]
    lost = [(at_s, next_s - at_s) for at_s, next_s in pairwise(times) if next_s - at_s > ALIVE_S]
    track = [
        (frame.at_s, (frame.message.vx, frame.message.vy, frame.message.vz))
        for frame in flight.heard
        if frame.id == mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED
    ]
    found = []
    changes = _changes(flight)
    for (_, before), (at_s, desired), (end_s, _) in zip(changes, changes[1:], changes[2:], strict=False):
        end_s = min([end_s, *(lost_s for lost_s, _ in lost if lost_s > at_s)])
        size = math.dist(before, desired)
        steady = not any(-STEADY_S < at_s - lost_s < STEADY_S + gap_s for lost_s, gap_s in lost)
        to_or_from_rest = not any(before) or not any(desired)
        if not size >= STEP_MIN_MPS or end_s - at_s < WINDOW_MIN_S or not steady or not to_or_from_rest:
            continue
        response = _response(track, at_s, end_s, before, desired)
        if response is not None:
            found.append((f"{_shown(before)} -> {_shown(desired)}", response))
    return found


def _setpoint_times(flight: Recording) -> list[float]:
    return [frame.at_s for frame in flight.sent if frame.id == mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED]


def _changes(flight: Recording) -> list[tuple[float, Vec3]]:
    """Times at which the commanded velocity changed, and to what; NaN: no velocity."""
    changes: list[tuple[float, Vec3]] = []
    for frame in flight.sent:
        if frame.id != mav.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED:
            continue
        message = frame.message
        desired = (round(message.vx, 2), round(message.vy, 2), round(message.vz, 2))
        if message.type_mask & 0x38:
            desired = (math.nan,) * 3
        if not changes or str(changes[-1][1]) != str(desired):  # NaN is like NaN here
            changes.append((frame.at_s, desired))
    times = _setpoint_times(flight)
    return [*changes, (times[-1], (math.nan,) * 3)] if times else []


def _shown(desired: Vec3) -> str:
    north, east, down = desired
    if not any(desired):
        return "0"
    speed = math.hypot(*desired)
    flat = math.hypot(north, east)
    way = "up" if flat < 0.05 else "level" if abs(down) < 0.05 else "climbing"
    return f"{speed:.1f} {way}"


def _response(
    track: Sequence[tuple[float, Vec3]], at_s: float, end_s: float, before: Vec3, desired: Vec3
) -> Response | None:
    change = tuple(b - a for a, b in zip(before, desired, strict=True))
    square = sum(c * c for c in change)
    times = [t for t, _ in track if at_s - 0.1 <= t <= end_s]
    shares = [
        sum((v - b) * c for v, b, c in zip(velocity, before, change, strict=True)) / square
        for t, velocity in track
        if at_s - 0.1 <= t <= end_s
    ]
    half = SMOOTH_SAMPLES // 2
    smooth = [median(shares[max(0, index - half) : index + half + 1]) for index in range(len(shares))]
    reached = []
    for share in (0.1, 0.63, 0.9):
        there = next((t - at_s for t, y in zip(times, smooth, strict=True) if t >= at_s and y >= share), None)
        if there is None:
            return None  # it never came so far: another failing of the flight, not a response
        reached.append(there)
    settled = [y for t, y in zip(times, smooth, strict=True) if t >= end_s - SETTLED_S]
    t10_s, t63_s, t90_s = reached
    return Response(t10_s, t63_s, t90_s, max(0.0, max(smooth) - 1.0), abs(fmean(settled) - 1.0))


@dataclass(frozen=True, slots=True)
class StepRow:
    """One kind of step of one personality of ours, beside what was recorded."""

    kind: str
    personality: Personality
    recorded: tuple[tuple[float, float], ...]  # least and largest of each figure
    ours: tuple[float, ...]  # median of each figure
    within: bool


def rows(recorded: Sequence[Recording], ours: Sequence[Recording]) -> list[StepRow]:
    """Kinds of steps that both have."""
    real: dict[str, list[Response]] = {}
    for flight in recorded:
        for kind, response in measure(flight):
            real.setdefault(kind, []).append(response)
    found = []
    for personality in Personality:
        mine: dict[str, list[Response]] = {}
        for flight in ours:
            if flight.personality is personality:
                for kind, response in measure(flight):
                    mine.setdefault(kind, []).append(response)
        for kind in sorted(mine.keys() & real.keys()):
            spread = tuple((min(values), max(values)) for values in zip(*real[kind], strict=True))
            figures = tuple(median(values) for values in zip(*mine[kind], strict=True))
            found.append(StepRow(kind, personality, spread, figures, _within(spread, figures)))
    return found


def _within(spread: Sequence[tuple[float, float]], figures: Sequence[float]) -> bool:
    times = zip(spread[:3], figures[:3], strict=True)
    shares = zip(spread[3:], figures[3:], strict=True)
    return all(low - TIME_SLACK_S <= value <= high + TIME_SLACK_S for (low, high), value in times) and all(
        value <= high + SHARE_SLACK for (_, high), value in shares
    )
