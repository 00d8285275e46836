"""Flocking with a gamma-agent: algorithm 2 of R. Olfati-Saber, "Flocking for Multi-Agent Dynamic Systems: Algorithms
and Theory", IEEE Transactions on Automatic Control 51(3), 2006.

Checked against public notes that retell the paper with its equations numbered (8, 10, 11, 15 and 24 to 27, which may be
a preprint's numbers) and against others' implementations; the paper itself was not at hand. All equations here agree.
The values of `Params` are those of a university's implementation of the paper's algorithm 3; see laws.md.

The gamma-agent is the leader itself, which flies its route whatever the others do. Every vehicle knows where it is and
how fast, one beacon late, as the paper assumes: ours must do without. The law is an acceleration; a velocity is
commanded that the plant, a first-order lag, answers with just that acceleration. For c1 and c2 no published value was
found (implementations differ): c1 = 1, critically damped, c2 = 2 sqrt(c1).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from mission.document.model import Mission
from sim_bridge.lab.laws.route import limit, with_leader
from sim_bridge.lab.study import law
from sim_bridge.lab.study.law import Floats, Law, View
from sim_bridge.lab.study.point_mass import LAG_S


class Params(law.Params):
    """The paper's simulations, by others' account: d = 7, r = 1.2 d, epsilon = 0.1, a = b = 5, h = 0.2."""

    d_m: Annotated[float, Field(gt=0.0, description="Distance wanted between neighbours.")] = 7.0
    r_over_d: Annotated[float, Field(gt=1.0, description="Interaction range, over that distance.")] = 1.2
    epsilon: Annotated[float, Field(gt=0.0, description="Of the sigma-norm, eq. 8.")] = 0.1
    h: Annotated[float, Field(gt=0.0, lt=1.0, description="Where the bump function leaves 1, eq. 10.")] = 0.2
    a: Annotated[float, Field(gt=0.0, description="Attraction, eq. 15.")] = 5.0
    b_over_a: Annotated[float, Field(ge=1.0, description="Repulsion over attraction, eq. 15: 0 < a <= b.")] = 1.0
    consensus: Annotated[float, Field(ge=0.0, description="Weight of velocity consensus, 1 in eq. 24.")] = 1.0
    c1: Annotated[float, Field(gt=0.0, description="Pull to the gamma-agent's place, eq. 27, 1/s2.")] = 1.0
    c2: Annotated[float, Field(gt=0.0, description="Pull to its velocity, eq. 27, 1/s.")] = 2.0


def make(mission: Mission, flights: int, params: Params) -> Law:  # noqa: ARG001
    """The law."""
    return OlfatiSaber(mission, params)


class OlfatiSaber:
    """Keeps no state."""

    def __init__(self, mission: Mission, params: Params) -> None:
        self._mission = mission
        self._p = params

    def velocity(self, view: View) -> Floats:
        """(B, n, 3) commands."""
        p = self._p
        leader = view.leads.argmax(axis=1)
        flights = np.arange(len(leader))
        gamma_vel = view.vel_heard_enu_mps[flights, leader]
        acceleration = self._gradient_and_consensus(view)
        acceleration += p.c1 * view.rel_enu_m[flights, :, leader]  # eq. 27
        acceleration += p.c2 * (gamma_vel[:, None, :] - view.vel_enu_mps)
        command = limit(view.vel_enu_mps + LAG_S * acceleration, self._mission.limits.speed_max_mps)
        return with_leader(command, view)

    def _gradient_and_consensus(self, view: View) -> Floats:
        """The two sums of eq. 24, the same in algorithm 2, eq. 26."""
        p = self._p
        near = view.heard & (view.distance_m < p.r_over_d * p.d_m)
        distance_m = np.where(near, view.distance_m, 0.0)
        root = np.sqrt(1.0 + p.epsilon * distance_m**2)
        sigma = (root - 1.0) / p.epsilon  # eq. 8
        d_sigma, r_sigma = ((np.sqrt(1.0 + p.epsilon * x * x) - 1.0) / p.epsilon for x in (p.d_m, p.r_over_d * p.d_m))
        z = sigma / r_sigma
        bump = np.where(z < p.h, 1.0, 0.5 * (1.0 + np.cos(np.pi * (z - p.h) / (1.0 - p.h))))  # eq. 10
        bump = np.where(near & (z < 1.0), bump, 0.0)  # a_ij, eq. 11
        b = p.a * p.b_over_a
        c = abs(p.a - b) / np.sqrt(4.0 * p.a * b)
        s = sigma - d_sigma + c
        phi = 0.5 * ((p.a + b) * s / np.sqrt(1.0 + s * s) + (p.a - b))  # eq. 15
        gradient = (view.rel_enu_m * (bump * phi / root)[:, :, :, None]).sum(axis=2)  # n_ij of eq. 25
        relative = view.vel_heard_enu_mps[:, None, :, :] - view.vel_enu_mps[:, :, None, :]
        total: Floats = gradient + p.consensus * (relative * bump[:, :, :, None]).sum(axis=2)
        return total
