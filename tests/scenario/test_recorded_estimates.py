"""What `sim.estimates = "2026-11"` gives is in the recordings: told velocities against told positions."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.mavlink import dialect as mav
from mission.document.model import Personality
from sim_bridge.conformance.recording import load
from sim_bridge.world.autopilot.estimates.errors import RECORDED_2026_11, VERTICAL_SHARE
from sim_bridge.world.autopilot.estimates.noise import POSITION_MEMORY_S, VELOCITY_MEMORY_S

FOLDER = Path(__file__).parents[1] / "recordings"
FLIGHTS = {
    Personality.PX4: ("px4_pymavlink_A", "px4_pymavlink_B", "px4_pymavlink_kdv0.2", "px4_mavsdk_A"),
    Personality.ARDUPILOT: ("ap_pymavlink_A",),
}
IN_AIR_M = 1.5  # above where it booted: clear of the ground's corrections
STANDING_S = (2.0, 10.0)  # since boot: its height has settled, it has not taken off
GRID_S, MEAN_S = 0.1, 1.0


@cache
def told(name: str) -> NDArray[np.float64]:
    """Rows of LOCAL_POSITION_NED: time, position, velocity."""
    heard = load(FOLDER / f"{name}.tlog.xz").heard
    messages = [frame.message for frame in heard if frame.id == mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED]
    rows = np.array([[m.time_boot_ms / 1000.0, m.x, m.y, m.z, m.vx, m.vy, m.vz] for m in messages])
    return rows[np.unique(rows[:, 0], return_index=True)[1]]


def velocity_errors(name: str) -> NDArray[np.float64]:
    """Told velocity less the change of told position, means over a second: (T, 3), a row every 0.1 s."""
    rows = told(name)
    air = rows[(rows[:, 3] < -IN_AIR_M) & (rows[:, 0] > STANDING_S[1])]
    grid = np.arange(air[0, 0], air[-1, 0], GRID_S)
    pos, vel = (np.stack([np.interp(grid, air[:, 0], air[:, k]) for k in ks], axis=1) for ks in ((1, 2, 3), (4, 5, 6)))
    gap = np.cumsum(vel, axis=0) * GRID_S - pos
    steps = round(MEAN_S / GRID_S)
    return (gap[steps:] - gap[:-steps]) / MEAN_S


def test_velocity_noise_is_that_of_px4() -> None:
    errors = np.concatenate([velocity_errors(name) for name in FLIGHTS[Personality.PX4]])
    wanted_mps = RECORDED_2026_11[Personality.PX4].velocity_noise_mps
    assert math.sqrt(float(np.mean(errors[:, :2] ** 2))) == pytest.approx(wanted_mps, rel=0.15)


def test_velocity_bias_and_noise_are_those_of_arducopter() -> None:
    (name,) = FLIGHTS[Personality.ARDUPILOT]
    errors = velocity_errors(name)[:, :2]
    wanted = RECORDED_2026_11[Personality.ARDUPILOT]
    assert math.hypot(*np.mean(errors, axis=0)) == pytest.approx(wanted.velocity_bias_mps, rel=0.15)
    assert float(np.mean(np.std(errors, axis=0))) == pytest.approx(wanted.velocity_noise_mps, rel=0.3)


def test_vertical_noise_and_memory_are_those_of_px4() -> None:
    flights = [velocity_errors(name) for name in FLIGHTS[Personality.PX4]]
    sd_mps = math.sqrt(float(np.mean(np.concatenate([flight[:, 2] for flight in flights]) ** 2)))
    share = sd_mps / RECORDED_2026_11[Personality.PX4].velocity_noise_mps
    assert share == pytest.approx(VERTICAL_SHARE, abs=0.2)
    lag = round(VELOCITY_MEMORY_S / GRID_S)
    kept = [float(np.mean(f[lag:, k] * f[:-lag, k]) / np.mean(f[:, k] ** 2)) for f in flights for k in (0, 1)]
    assert np.mean(kept) == pytest.approx(math.exp(-1.0), abs=0.15)


def test_position_noise_is_that_of_a_px4_that_stands() -> None:
    sds = []
    for name in FLIGHTS[Personality.PX4]:
        rows = told(name)
        standing = rows[(rows[:, 0] > STANDING_S[0]) & (rows[:, 0] < STANDING_S[1]) & (np.abs(rows[:, 3]) < 0.3)]
        if len(standing):  # one was recorded from its takeoff on
            sds.append(np.std(standing[:, 1:3], axis=0))
    # Over a time as short as that, a slow wander shows less than all of itself.
    short = (STANDING_S[1] - STANDING_S[0]) / POSITION_MEMORY_S
    shown = math.sqrt(1.0 - 2.0 * (short - 1.0 + math.exp(-short)) / short**2)
    assert len(sds) >= 3
    assert float(np.mean(sds)) == pytest.approx(RECORDED_2026_11[Personality.PX4].position_noise_m * shown, rel=0.3)
