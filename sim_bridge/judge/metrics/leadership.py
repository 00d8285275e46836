"""Leader and phase of a recorded flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from companion.core.model.states import SwarmPhase
from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.recording import Recording


def acting_leader(recording: Recording) -> NDArray[np.int16]:
    """(T,) id of the acting leader, the lowest if several act; 0: none."""
    acting = recording.acting & recording.agent_alive
    return np.where(acting.any(axis=1), acting.argmax(axis=1) + 1, 0).astype(np.int16)


def swarm_phase(recording: Recording) -> NDArray[np.int8]:
    """(T,) SwarmPhase as the acting leader announces it, else the highest of those alive; -1: none."""
    leader = acting_leader(recording)
    heard = np.where(recording.agent_alive, recording.phase, -1)
    announced = heard[np.arange(len(leader)), np.maximum(leader - 1, 0)]
    return np.where(leader > 0, announced, heard.max(axis=1, initial=-1)).astype(np.int8)


def departure(recording: Recording) -> tuple[int, int] | None:
    """Tick of the departure, and the column of the vehicle that leads it; None if the swarm never departed."""
    # LAND and RETURN without a TRANSIT before are an abort on the spot
    leaving = (recording.phase == SwarmPhase.TRANSIT) | (recording.phase == SwarmPhase.COVERAGE)
    leaving &= recording.acting & recording.agent_alive
    ticks = np.flatnonzero(leaving.any(axis=1))
    return (int(ticks[0]), int(leaving[ticks[0]].argmax())) if ticks.size else None


def visits_of(recording: Recording) -> NDArray[np.intp]:
    """(T,) which of the mission's visits the swarm is bound for, or at: it goes on when an acting leader leaves one."""
    phase = swarm_phase(recording)
    led = np.flatnonzero(acting_leader(recording) > 0)
    leaves = np.zeros(len(phase), dtype=np.intp)
    covered, goes_on = phase[led[:-1]] == SwarmPhase.COVERAGE, phase[led[1:]] == SwarmPhase.TRANSIT
    leaves[led[1:][covered & goes_on]] = 1
    return np.cumsum(leaves)


def longest_s(time_s: Floats, flag: Bools) -> float:
    """Length of the longest run of ticks with `flag` (T,): a tick lasts until the next one."""
    edges = np.diff(np.concatenate(([False], flag, [False])).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths_s = time_s[np.minimum(ends, len(time_s) - 1)] - time_s[starts] if starts.size else np.zeros(0)
    return float(lengths_s.max(initial=0.0))


def tick_lengths_s(time_s: Floats) -> Floats:
    """(T,) time from each tick to the next; the last has none."""
    return np.append(np.diff(time_s), 0.0)[: len(time_s)]
