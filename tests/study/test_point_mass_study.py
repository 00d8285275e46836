"""The point-mass harness: flights in batches, and our law in it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.core.swarm import phases
from mission.common.frames import enu_to_ned
from mission.document.model import Mission
from sim_bridge.lab.study import ours, point_mass
from sim_bridge.lab.study.law import View
from sim_bridge.world.airframe.point_mass import PointMass


def mission(n: int, **tables: dict[str, object]) -> Mission:
    values: dict[str, dict[str, object]] = {
        "route": {"d1_enu_m": (0, 0, 20), "d2_enu_m": (60, 0, 20), "vel_leader_mps": 3.0},
        "coverage": {"shape": "sphere"},
        "fence": {"altitude_max_m": 60.0},
        "swarm": {"size": n},
    }
    for name, changes in tables.items():
        values[name] = {**values.get(name, {}), **changes}
    return Mission.model_validate({"schema": 1, **values})


def fly(flown: Mission, seeds: list[int]) -> list[point_mass.Figures]:
    return point_mass.fly(flown, seeds, ours.make(flown, len(seeds), ours.Params()))


@pytest.mark.parametrize("cruise_mps", [0.7, 1.0, 3.0])
def test_leader_gathers_its_swarm_at_d1_itself_whatever_its_cruise_speed(cruise_mps: float) -> None:
    """At the speed of gathering or less, too: what the leader does must not be guessed from its speed."""
    flown = mission(4, route={"vel_leader_mps": cruise_mps})
    swarm, law = point_mass.Swarm(flown, point_mass.starts(flown, [1, 2, 3])), ours.make(flown, 3, ours.Params())
    from_d1_m: dict[int, float] = {}
    while len(from_d1_m) < 3:
        before = np.linalg.norm(swarm.pos_enu_m[:, 0] - flown.route.d1_enu_m, axis=1)
        swarm.tick(law)
        for flight in np.flatnonzero(swarm.departed_tick >= 0):
            from_d1_m.setdefault(int(flight), float(before[flight]))
    assert max(from_d1_m.values()) < 0.5


def test_effort_is_the_mean_size_of_the_acceleration_in_transit() -> None:
    flown = mission(2)
    swarm = point_mass.Swarm(flown, point_mass.starts(flown, [1, 2]))

    class Sawtooth:
        def velocity(self, view: View) -> np.ndarray:
            """One vehicle is driven to and fro with all that it has, the other hangs still; nobody arrives."""
            command = np.zeros_like(view.vel_enu_mps)
            command[:, 1, 0] = 100.0 if swarm.ticks % 2 else -100.0
            return command

    swarm.departed_tick[:] = 0
    for _ in range(200):
        swarm.tick(Sawtooth())
    for figures in swarm.figures():
        assert figures.acceleration_mean_mps2 == pytest.approx(point_mass.ACCELERATION_MAX_MPS2 / 2.0)


def test_leader_comes_to_rest_short_of_d2() -> None:
    flown = mission(1, route={"vel_leader_mps": 0.7, "d2_enu_m": (10, 0, 20)})
    swarm, law = point_mass.Swarm(flown, point_mass.starts(flown, [1])), ours.make(flown, 1, ours.Params())
    for _ in range(600):
        swarm.tick(law)
    stop_m = phases.STOP_SHARE * flown.route.arrival_distance_m
    assert np.linalg.norm(swarm.pos_enu_m[0, 0] - flown.route.d2_enu_m) == pytest.approx(stop_m, abs=0.1)


def test_point_masses_are_the_airframes() -> None:
    flown = mission(2)
    swarm = point_mass.Swarm(flown, point_mass.starts(flown, [1]))
    bodies = [PointMass(enu_to_ned(tuple(p)), 0.0) for p in swarm.pos_enu_m[0]]
    law = ours.make(flown, 1, ours.Params())
    commands = []

    class Noted:
        def velocity(self, view: View) -> np.ndarray:
            commands.append(law.velocity(view))
            return commands[-1]

    for _ in range(60):
        swarm.tick(Noted())
        for body, command in zip(bodies, commands[-1][0], strict=True):
            body.set_armed(True)
            body.command(enu_to_ned(tuple(command)), 0.0)
            body.step(swarm.dt_s)
    for body, pos in zip(bodies, swarm.pos_enu_m[0], strict=True):
        assert math.dist(body.state.pos_ned_m, enu_to_ned(tuple(pos))) < 1e-9


def test_a_flight_does_not_depend_on_its_batch_to_the_bit() -> None:
    flown = mission(5)
    together = fly(flown, list(range(1, 8)))
    assert together == [fly(flown, [seed, 100])[0] for seed in range(1, 8)]


def test_swarm_arrives_hardly_later_than_one_alone() -> None:
    alone = fly(mission(1), [1])[0].arrival_leader_s
    assert alone is not None
    for figures in fly(mission(8), [1, 2, 3]):
        assert figures.arrived
        assert figures.arrival_last_s is not None
        assert figures.arrival_last_s <= 1.01 * alone
        assert figures.min_separation_m is not None
        assert figures.min_separation_m >= 5.0
        assert figures.connected_fraction_transit == 1.0


def test_swarm_wider_than_the_range_arrives_hardly_later_than_one_alone() -> None:
    alone = fly(mission(1), [1])[0].arrival_leader_s
    assert alone is not None
    for figures in fly(mission(50), [1]):
        assert figures.arrival_last_s is not None
        assert figures.arrival_last_s <= 1.01 * alone


def test_vehicles_out_of_range_of_one_another_do_not_count_as_connected() -> None:
    apart = np.zeros((2, 3, 3), dtype=np.bool_)
    apart[0, 0, 1] = apart[0, 1, 0] = True
    apart[1, 0, 1] = apart[1, 1, 0] = apart[1, 1, 2] = apart[1, 2, 1] = True
    assert list(point_mass.is_connected(apart)) == [False, True]
