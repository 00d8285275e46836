"""True paths of a swarm's vehicles: the flights over which relative localisation is judged.

`rigid`: all fly as one, which hides the formation's rotation from ranges. `weave`: the same, each to and fro across its
way. `trees`: the flight software's own flight among trees, by the study harness of the forest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.core.agent import TICK_S
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.schema.tables import Route
from mission.stand.stand import Stand, stand_of
from sim_bridge.lab.study.forest.air import trunks_between
from sim_bridge.lab.study.forest.flight import Flight, trunks_of
from sim_bridge.lab.study.law import Bools, Floats

SPACING_M = 8.0  # at least; our law flies 8-10 m
ROOM_M = 13.5  # radius of the disc that eight fill: mean distance 17 m, as our law flies
WEAVE_PERIODS_S = (8.0, 12.0)  # each vehicle another, so that no two move as one
SPEED_MPS = 3.0
MISSION = Path(__file__).parents[4] / "mission" / "studies" / "through_trees.toml"


@dataclass(frozen=True, slots=True)
class Paths:
    """One flight, every TICK_S."""

    pos_ne_m: Floats  # (T, n, 2)
    vel_ne_mps: Floats  # (T, n, 2): it leads from each place to the next
    blocked: Bools  # (T, n, n): a trunk stands between


def in_the_open(n: int, duration_s: float, weave_mps: float, rng: np.random.Generator) -> Paths:
    """Straight on, each vehicle weaving across the way with `weave_mps` rms."""
    ticks = round(duration_s / TICK_S)
    time_s = TICK_S * np.arange(ticks + 1)
    course = rng.uniform(0.0, math.tau)
    along, across = np.array([math.cos(course), math.sin(course)]), np.array([-math.sin(course), math.cos(course)])
    periods_s = rng.permutation(np.linspace(*WEAVE_PERIODS_S, n))
    phases = rng.uniform(0.0, math.tau, n)
    swing_m = weave_mps * math.sqrt(2.0) * periods_s / math.tau
    off_m = swing_m * np.sin(math.tau * time_s[:, None] / periods_s + phases)
    pos = _draw_positions(n, rng) + SPEED_MPS * time_s[:, None, None] * along + off_m[:, :, None] * across
    return Paths(pos[:-1], np.diff(pos, axis=0) / TICK_S, np.zeros((ticks, n, n), dtype=np.bool_))


def _draw_positions(n: int, rng: np.random.Generator) -> Floats:
    """(n, 2) by chance, anew where they leave no room for the next."""
    room_m = ROOM_M * math.sqrt(n / 8.0)
    while True:
        found: list[Floats] = []
        for pos_enu_m in rng.uniform(-room_m, room_m, (50 * n, 2)):
            if np.hypot(*pos_enu_m) <= room_m and all(np.hypot(*(pos_enu_m - other)) >= SPACING_M for other in found):
                found.append(pos_enu_m)
                if len(found) == n:
                    return np.array(found)


def among_trees(n: int, duration_s: float, density_per_ha: float, seed: int) -> Paths:
    """From the departure on, as the flight software flies it (point masses, no errors but lost beacons)."""
    mission = _mission(n, duration_s, density_per_ha, seed)
    stand = stand_of(mission, MISSION.parent)
    flight = Flight(mission, stand)
    ticks = round(duration_s / TICK_S)
    pos: list[Floats] = []
    while flight.watch.departed_s is None:
        flight.tick()
    while len(pos) <= ticks:
        pos.append(flight.pos_enu_m.copy())
        flight.tick()
    enu = np.array(pos)
    ne = enu[:, :, 1::-1]
    blocked = _blocked(enu[:-1], stand)
    return Paths(ne[:-1], np.diff(ne, axis=0) / TICK_S, blocked)


def _mission(n: int, duration_s: float, density_per_ha: float, seed: int) -> Mission:
    mission = load_mission(MISSION).with_seed(seed).with_size(n)
    way_m = 1.2 * duration_s * SPEED_MPS  # farther than it flies
    route = Route(**{**mission.route.model_dump(), "d2_enu_m": (way_m, 0.0, 4.0)})
    assert mission.forest.stand is not None
    spec = mission.forest.stand.model_copy(update={"density_per_ha": density_per_ha})
    return mission.model_copy(update={"route": route, "forest": mission.forest.model_copy(update={"stand": spec})})


def _blocked(enu_m: Floats, stand: Stand) -> Bools:
    trunks = trunks_of(stand)
    return np.array([trunks_between(positions_enu_m, _near(trunks, positions_enu_m)) > 0 for positions_enu_m in enu_m])


def _near(trunks: Floats, positions_enu_m: Floats) -> Floats:
    low, high = positions_enu_m[:, :2].min(axis=0) - 1.0, positions_enu_m[:, :2].max(axis=0) + 1.0
    return np.asarray(trunks[((trunks[:, :2] > low) & (trunks[:, :2] < high)).all(axis=1)])
