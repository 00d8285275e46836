"""The point-mass harness: flights in batches, and our law in it against the flight software's own functions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_kit import beacon

from companion.core import formation, phases, safety
from companion.core.peers import Neighbour
from companion.core.types import Position
from companion.core.vec import add, scale, sub
from mission.frames import Vec3, enu_to_ned
from mission.model import Mission
from sim_bridge.airframe.point_mass import PointMass
from sim_bridge.study import ours, point_mass
from sim_bridge.study.law import View


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


class Scalar:
    """One flight of our law, vehicle by vehicle, with the flight software's functions."""

    def __init__(self, flown: Mission) -> None:
        n = flown.swarm.size
        self.mission = flown
        self.envelope = safety.Envelope.of(flown)
        self.said = [(formation.NOWHERE, 1.0, (0.0, 0.0, 0.0)) for _ in range(n)]
        self.setpoint: list[Vec3] = [(0.0, 0.0, 0.0)] * n

    def tick(self, view: View) -> list[Vec3]:
        """NED m/s, of every vehicle."""
        said = [self.vehicle(view, i) for i in range(len(self.said))]
        self.said = said
        return self.setpoint

    def vehicle(self, view: View, i: int) -> tuple[formation.Route, float, Vec3]:
        range_m = self.mission.radio.transit_range_m
        ned = lambda v: enu_to_ned(tuple(float(x) for x in v))  # type: ignore[arg-type]  # noqa: E731
        neighbours = []
        for j in np.flatnonzero(view.heard[0, i]):
            route, governor, ref = self.said[j]
            heard = beacon(
                int(j) + 1,
                vel_ned_mps=ned(view.vel_heard_enu_mps[0, j]),
                ref_ned_mps=ref,
                route_cost=route.cost,
                governor=governor,
                parent=route.parent,
            )
            neighbours.append(Neighbour(heard, ned(view.rel_enu_m[0, i, j]), None, 0.0))
        leads = i == 0
        own = formation.LEADER_ROUTE if leads else formation.route(neighbours, range_m=range_m)
        behind = formation.children(i + 1, own, neighbours)
        governor = formation.governor(own, behind, range_m=range_m)
        position = Position(ned(view.pos_enu_m[0, i]), ned(view.vel_enu_mps[0, i]))
        if leads:
            stop_m = phases.STOP_SHARE * self.mission.route.arrival_distance_m if view.cruise_mps[0] == 3.0 else 0.0
            to_goal = ned(view.to_goal_enu_m[0])
            ref = formation.approach(to_goal, cruise_mps=float(view.cruise_mps[0]), stop_m=stop_m)
            ref = wanted = scale(ref, governor)
        else:
            ref = formation.alignment(own)
            push = formation.separation(neighbours, [], soft_m=self.mission.separation.soft_m)
            pull = add(formation.cohesion(own, range_m=range_m), formation.level(own))
            wanted = add(add(ref, push), pull)
        last = self.setpoint[i]
        self.setpoint = [*self.setpoint[:i], (0.0, 0.0, 0.0), *self.setpoint[i + 1 :]]
        self.setpoint[i] = self.envelope.admit(wanted, last, position, neighbours, [], None, dt_s=view.dt_s)
        return own, governor, ref


@pytest.mark.parametrize(("n", "spacing_m"), [(2, 6.0), (5, 6.0), (9, 5.5), (7, 17.0)])
def test_our_law_over_arrays_is_the_flight_softwares(n: int, spacing_m: float) -> None:
    flown = mission(n, sim={"placement_spacing_m": spacing_m})
    law, scalar = ours.make(flown, 1, ours.Params()), Scalar(flown)
    compared: list[float] = []

    class Both:
        def velocity(self, view: View) -> np.ndarray:
            ours_ned = [enu_to_ned(tuple(v)) for v in law.velocity(view)[0]]
            compared.extend(math.hypot(*sub(a, b)) for a, b in zip(ours_ned, scalar.tick(view), strict=True))
            return np.array([[enu_to_ned(v) for v in ours_ned]])

    swarm = point_mass.Swarm(flown, point_mass.starts(flown, [3]))
    for _ in range(150):
        swarm.tick(Both())
    assert swarm.departed_tick[0] > 0 or spacing_m > 10
    assert max(compared) < 1e-9


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
    for figures in fly(mission(50), [1, 2]):
        assert figures.arrival_last_s is not None
        assert figures.arrival_last_s <= 1.01 * alone


def test_vehicles_out_of_range_of_one_another_do_not_count_as_connected() -> None:
    apart = np.zeros((2, 3, 3), dtype=np.bool_)
    apart[0, 0, 1] = apart[0, 1, 0] = True
    apart[1, 0, 1] = apart[1, 1, 0] = apart[1, 1, 2] = apart[1, 2, 1] = True
    assert list(point_mass.is_connected(apart)) == [False, True]
