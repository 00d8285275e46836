"""Shapes of a stand's trunks, drawn tree by tree from the mission's seed: none is the upright cylinder of its radius.

A trunk's axis leans and goes through the tree's place at breast height; there its mean diameter is the tree's. It gets
thinner by Ormerod's bole (1973, "A simple bole model", Forestry Chronicle 49, 136-138), its section is an ellipse, its
bark is rough, and some fork. About it: stubs of branches, saplings, litter. Lidars see these; what a vehicle touches
remains the upright cylinder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.document.model import Mission
from mission.schema.forest import M2_PER_HA, Shapes
from mission.schema.trees import BREAST_HEIGHT_M, StandTree
from mission.stand.stand import Stand
from sim_bridge.world.sensors.scan import Cylinder

Floats = NDArray[np.float64]
SALT: Final = 0x57E4
SEEN_TO_M: Final = 12.0  # of a trunk's height: higher up crowns hide it, and no class of lidar looks
FORK_M: Final = (1.8, 7.0)  # heights of forks: one below breast height would be two stems to a forester
FORK_LEAN: Final = (0.08, 0.18)
FORK_SHARE: Final = 0.72  # radius of each branch: both have the section that was there
BARK_LOBES: Final = 3
CLEAR_M: Final = 2.0  # of d1, stops and d2
# Columns of a trunk's row: place at `ref`, lean, radius at breast height (with the share of a branch), total height,
# exponent, ellipse and its bearing, bark and its three phases, lower and upper end, height of the ground; up, metres
NORTH, EAST, REF, LEAN_N, LEAN_E, RADIUS, HEIGHT, POWER, ELLIPSE, TURN, BARK = range(11)
PHASES, LOW, HIGH, GROUND, COLUMNS = 11, 14, 15, 16, 17


@dataclass(frozen=True, slots=True)
class StemShapes:
    """Trunks (k, COLUMNS), and the upright cylinders of all else, with the places of both for look-up."""

    trunks: Floats
    bits: tuple[Cylinder, ...]

    def trunks_near(self, north_m: float, east_m: float, within_m: float) -> Floats:
        """Rows of trunks of which some part may be so near."""
        reach_m = within_m + self.trunks[:, RADIUS] + 0.2 * SEEN_TO_M
        away = np.hypot(self.trunks[:, NORTH] - north_m, self.trunks[:, EAST] - east_m)
        return np.asarray(self.trunks[away < reach_m])

    def bits_near(self, north_m: float, east_m: float, within_m: float) -> list[Cylinder]:
        """Stubs, saplings and litter."""
        return [bit for bit in self.bits if math.hypot(bit[0] - north_m, bit[1] - east_m) < within_m + bit[2]]


def shapes_of(mission: Mission, stand: Stand) -> StemShapes | None:
    """The shapes of a stand's trees; None: the mission does not ask for them."""
    spec = mission.forest.shapes
    if spec is None:
        return None
    trunks: list[list[float]] = []
    bits: list[Cylinder] = []
    for k, tree in enumerate(stand.trees):
        rng = np.random.default_rng([mission.sim.seed, SALT, k])
        ground_m = stand.ground_up_m(tree.east_m, tree.north_m)
        drawn = _trunk(tree, spec, ground_m, rng)
        forks = rng.random() < spec.forks
        fork_m = ground_m + rng.uniform(*FORK_M)
        trunks += _forked(drawn, fork_m, rng) if forks and fork_m < drawn[HIGH] - 1.0 else [drawn]
        bits += [_stub(drawn, rng) for _ in range(rng.poisson(spec.stubs_per_tree))]
    bits += _scattered(mission, stand, spec)
    return StemShapes(np.array(trunks).reshape(-1, COLUMNS), tuple(bits))


def radius_m(rows: Floats, up_m: Floats, bearing: Floats) -> Floats:
    """Radius at a height, in a direction from the axis. `rows`: (k, COLUMNS)."""
    height = rows[:, HEIGHT]
    above = np.clip(up_m - rows[:, GROUND], 0.0, 0.95 * height)
    share = ((height - above) / np.maximum(height - BREAST_HEIGHT_M, 0.5)) ** rows[:, POWER]
    around = 1.0 + 0.5 * rows[:, ELLIPSE] * np.cos(2.0 * (bearing - rows[:, TURN]))
    first, second, third = rows[:, PHASES : PHASES + BARK_LOBES].T
    bark = (
        np.cos(5.0 * bearing + 3.0 * up_m + first)
        + np.cos(11.0 * bearing - 7.0 * up_m + second)
        + np.cos(23.0 * bearing + 17.0 * up_m + third)
    )
    # Three cosines have an rms of sqrt(3 / 2)
    return np.asarray(rows[:, RADIUS] * share * around + rows[:, BARK] * bark / math.sqrt(BARK_LOBES / 2.0))


def _trunk(tree: StandTree, spec: Shapes, ground_m: float, rng: np.random.Generator) -> list[float]:
    lean = np.tan(np.radians(spec.lean_deg)) * rng.standard_normal(2)
    return [
        tree.north_m,
        tree.east_m,
        ground_m + BREAST_HEIGHT_M,
        float(lean[0]),
        float(lean[1]),
        tree.radius_m,
        max(tree.height_m, BREAST_HEIGHT_M + 1.0),
        max(0.1, spec.taper_exponent + spec.taper_exponent_sd * rng.standard_normal()),
        spec.ellipse * abs(rng.standard_normal()),
        rng.uniform(0.0, math.pi),
        min(spec.bark_m, 0.1 * tree.radius_m),
        *rng.uniform(0.0, math.tau, BARK_LOBES).tolist(),
        ground_m - 3.0,
        ground_m + min(tree.height_m, SEEN_TO_M),
        ground_m,
    ]


def _forked(trunk: list[float], fork_m: float, rng: np.random.Generator) -> list[list[float]]:
    """The trunk up to its fork, and two branches from there."""
    below, branches = list(trunk), []
    below[HIGH] = fork_m
    away, towards = rng.uniform(*FORK_LEAN), rng.uniform(0.0, math.tau)
    for side in (-1.0, 1.0):
        branch = list(trunk)
        branch[NORTH] += trunk[LEAN_N] * (fork_m - trunk[REF])
        branch[EAST] += trunk[LEAN_E] * (fork_m - trunk[REF])
        branch[REF] = branch[LOW] = fork_m
        branch[LEAN_N] += side * away * math.cos(towards)
        branch[LEAN_E] += side * away * math.sin(towards)
        branch[RADIUS] *= FORK_SHARE
        branches.append(branch)
    return [below, *branches]


def _stub(trunk: list[float], rng: np.random.Generator) -> Cylinder:
    """The stub of a branch, which sticks out of the bark by up to 0.15 m."""
    up_m = trunk[GROUND] + rng.uniform(0.5, 6.0)
    away_m, bearing = trunk[RADIUS] + rng.uniform(0.0, 0.1), rng.uniform(0.0, math.tau)
    axis_n = trunk[NORTH] + trunk[LEAN_N] * (up_m - trunk[REF])
    axis_e = trunk[EAST] + trunk[LEAN_E] * (up_m - trunk[REF])
    thick_m = rng.uniform(0.015, 0.05)
    place = axis_n + away_m * math.cos(bearing), axis_e + away_m * math.sin(bearing)
    return (*place, thick_m, up_m - thick_m, up_m + thick_m)


def _scattered(mission: Mission, stand: Stand, spec: Shapes) -> list[Cylinder]:
    """Saplings and litter, uniform over the rectangle of the trees; nothing within 2 m of d1 and d2."""
    if not stand.trees:
        return []
    rng = np.random.default_rng([mission.sim.seed, SALT])
    norths, easts = [t.north_m for t in stand.trees], [t.east_m for t in stand.trees]
    low, high = (min(norths), min(easts)), (max(norths), max(easts))
    area_ha = (high[0] - low[0]) * (high[1] - low[1]) / M2_PER_HA
    found: list[Cylinder] = []
    for per_ha, thick_m, tall_m in (
        (spec.saplings_per_ha, (0.01, 0.035), (1.5, 3.5)),
        (spec.litter_per_ha, (0.05, 0.4), (0.05, 0.25)),
    ):
        for _ in range(rng.poisson(per_ha * area_ha)):
            north_m, east_m = rng.uniform(low, high)
            radius, height_m = rng.uniform(*thick_m), rng.uniform(*tall_m)
            ground_m = stand.ground_up_m(east_m, north_m)
            near = any(
                math.hypot(north_m - place[1], east_m - place[0]) < CLEAR_M for place in mission.route.points_enu_m
            )
            if not near:
                found.append((north_m, east_m, radius, ground_m - 3.0, ground_m + height_m))
    return found
