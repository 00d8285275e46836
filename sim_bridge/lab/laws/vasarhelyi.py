"""Optimised flocking: G. Vasarhelyi et al., "Optimized flocking of autonomous drones in confined environments",
Science Robotics 3, eaat3536, 2018. Its walls and obstacles (eq. 8, 9) are not here.

Repulsion, alignment, braking curve and their sum agree with the authors' own simulator (csviragh/robotsim), SwarmLab,
another implementation and a public summary of the paper; the cut-off with the last three. The simulator as published
differs: it caps each repulsion at a speed, adds r0_rep to r0_frict, and commands the flocking speed always, its cut-off
switched off. The paper itself was not at hand: equation numbers are that other implementation's. See laws.md.

The flock's heading is free in the paper and walls keep it together. Here self-propulsion points to the goal, which
every vehicle knows: ours must do without. The law has no cohesion of its own. The leader flies its route whatever the
others do, so that its arrival means the same for all laws.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from mission.document.model import Mission
from sim_bridge.lab.laws.route import approach, goals, limit, with_leader
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Floats, Law, View


class Params(law.Params):
    """Table S1's optimum in simulation at 4 m/s, by others' account; not what was flown (table S4)."""

    r0_rep_m: Annotated[float, Field(gt=0.0, description="Repulsion starts here, eq. 2.")] = 25.6
    p_rep_per_s: Annotated[float, Field(gt=0.0, description="Its gain, eq. 2.")] = 0.13
    r0_frict_m: Annotated[float, Field(gt=0.0, description="Stopping point before a neighbour, eq. 5.")] = 85.3
    c_frict: Annotated[float, Field(gt=0.0, description="Coefficient of alignment, eq. 6.")] = 0.05
    v_frict_mps: Annotated[float, Field(gt=0.0, description="Velocity slack of alignment, eq. 5.")] = 0.63
    p_frict_per_s: Annotated[float, Field(gt=0.0, description="Linear gain of the braking curve, eq. 4.")] = 3.2
    a_frict_mps2: Annotated[float, Field(gt=0.0, description="Deceleration of the braking curve, eq. 4.")] = 4.16


def make(mission: Mission, flights: int, params: Params) -> Law:  # noqa: ARG001
    """The law."""
    return Vasarhelyi(mission, params)


class Vasarhelyi:
    """Keeps no state."""

    def __init__(self, mission: Mission, params: Params) -> None:
        self._mission = mission
        self._p = params

    def velocity(self, view: View) -> Floats:
        """(B, n, 3) commands, eq. 10; cut off at the vehicle's greatest speed, eq. 11."""
        propulsion = approach(goals(view)[:, None, :] - view.pos_enu_m, view)
        command = propulsion + self._repulsion(view) + self._friction(view)
        return with_leader(limit(command, self._mission.limits.speed_max_mps), view)

    def _repulsion(self, view: View) -> Floats:
        """Eq. 2 and 3."""
        near = view.heard & (view.distance_m < self._p.r0_rep_m)
        distance_m = np.where(near, np.maximum(view.distance_m, 1e-6), 1.0)
        gain = np.where(near, -self._p.p_rep_per_s * (self._p.r0_rep_m - distance_m) / distance_m, 0.0)
        total: Floats = (view.rel_enu_m * gain[:, :, :, None]).sum(axis=2)
        return total

    def _friction(self, view: View) -> Floats:
        """Eq. 5 to 7: what the velocities may differ by without being pulled together."""
        p = self._p
        slack = np.maximum(
            p.v_frict_mps, braking_curve(view.distance_m - p.r0_frict_m, p.a_frict_mps2, p.p_frict_per_s)
        )
        relative = view.vel_heard_enu_mps[:, None, :, :] - view.vel_enu_mps[:, :, None, :]
        difference = np.sqrt((relative * relative).sum(axis=3))
        pulled = view.heard & (difference > slack)
        gain = np.where(pulled, p.c_frict * (1.0 - slack / np.maximum(difference, 1e-9)), 0.0)
        total: Floats = (relative * gain[:, :, :, None]).sum(axis=2)
        return total


def braking_curve(room_m: Floats, deceleration_mps2: float, gain_per_s: float) -> Floats:
    """Eq. 4: the speed to come to rest within `room_m`, linear near the end."""
    room_m = np.where(np.isfinite(room_m), np.maximum(room_m, 0.0), 0.0)
    linear = room_m * gain_per_s
    root = np.sqrt(np.maximum(2.0 * deceleration_mps2 * room_m - (deceleration_mps2 / gain_per_s) ** 2, 0.0))
    return np.where(linear < deceleration_mps2 / gain_per_s, linear, root)
