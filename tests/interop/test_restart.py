"""Companions that are killed or stopped in flight, on the wall clock: the autopilot holds, and they come back."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from companion.core.model.states import FlightState
from tests.bench.restarts import kills, served_swarm, swarm_mission

pytestmark = pytest.mark.interop

FURTHER_M = 3.0
STOPPED = 2


def test_killed_companions_come_back_and_the_swarm_arrives(tmp_path: Path) -> None:
    done, arrived = kills(1, tmp_path)
    assert len(done) == 2
    for kill in done:
        assert kill.held_s < kill.rejoined_s  # the benchmark (agent-killed) measures the times
    assert arrived


def test_stopped_companion_lets_its_autopilot_hold_and_listens_before_it_steers_again(tmp_path: Path) -> None:
    with served_swarm(swarm_mission(2), tmp_path) as swarm:
        others = [k for k in swarm.agents if k != STOPPED]
        swarm.signal(STOPPED, signal.SIGSTOP)
        swarm.until(lambda: swarm.mode(STOPPED) == "HOLD", "the stopped one's autopilot holds")
        setpoints, ahead_m = swarm.setpoints(STOPPED), swarm.ahead_m()
        swarm.until(lambda: swarm.ahead_m() > ahead_m + FURTHER_M, "the others go on")
        assert swarm.setpoints(STOPPED) == setpoints
        assert swarm.mode(STOPPED) == "HOLD"
        assert all(swarm.mode(k) == "OFFBOARD" for k in others)
        before = swarm.server.hub.transmitter.said[STOPPED].time_boot_ms
        swarm.signal(STOPPED, signal.SIGCONT)
        states: list[FlightState | None] = []

        def steers() -> bool:
            if swarm.server.hub.transmitter.said[STOPPED].time_boot_ms != before:
                states.append(swarm.state(STOPPED))
            return swarm.setpoints(STOPPED) > setpoints

        swarm.until(steers, "it steers again")
        assert states
        assert states[0] is FlightState.WAITING
        assert "companion stalled: resynchronising" in (tmp_path / f"companion-{STOPPED}.log").read_text()
        assert swarm.arrive()
