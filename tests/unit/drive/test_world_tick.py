"""What a world's tick tells of the compasses that vehicles go by."""

from __future__ import annotations

from typing import Any

import pytest

from sim_bridge.drive.links.insider import Insiders
from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.drive.ticks import world_tick
from sim_bridge.world.airframe.point_mass import point_mass_airframes
from sim_bridge.world.autopilot import Link, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, TICK_S, World
from tests.unit.core.ranging_kit import ranging_mission

ASTRAY = {"kind": "position-jump", "vehicles": [3], "jump_m": [3.0, 0.0], "at_s": 60.0, "for_s": 5.0}
OUTAGE = {"kind": "gnss-outage", "vehicles": [1], "at_s": 60.0, "for_s": 5.0}  # its vehicle has odometry, too


def test_norths_are_told_of_all_that_go_by_odometry_whatever_faults_there_are() -> None:
    told = [norths_rad(faults) for faults in ([], [ASTRAY], [OUTAGE])]
    assert told[0][0] == 0.0
    assert all(told[0][1:])
    assert told[1][1:] == told[2][1:] == told[0][1:]
    assert told[2][0] != 0.0


def norths_rad(faults: list[dict[str, Any]]) -> tuple[float, ...]:
    """Of each vehicle by how much its yaw is off, as told in the first tick."""
    mission = ranging_mission(sim={"faults": faults}).with_origin(DEFAULT_ORIGIN)
    world = World(mission, point_mass_airframes(mission), links={Link.ONBOARD: StreamProfile.ONBOARD})
    world.step(TICK_S)
    tick = world_tick(world, Transmitter(world.radio, Insiders(mission)), alive=(), answered=())
    yaws = [(v.airframe.state.attitude_rad[2], v.believed.state.attitude_rad[2]) for v in world.vehicles.values()]
    assert tick.north_off_rad == pytest.approx([true - told for true, told in yaws])
    return tick.north_off_rad
