"""Surveys of a stand that never flew: records as vehicles would leave them, with what is true beside.

Not how the estimators model it: detection falls logistically with distance and by diameter, frame errors have a start
error and wander with another correlation time, single diameters have heavy tails, taper errs for a whole stand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.stand.records import StoredRecord
from companion.survey.observation import STEM_KIND, Grade, StemObservation, encode
from companion.survey.track import TRACK_KIND, TrackPoint, encode_track
from mission.document.model import Mission
from mission.stand.generate import generate_stand

Floats = npt.NDArray[np.float64]
STEP_S = 2.0


@dataclass(frozen=True)
class Trees:
    """East, north, diameter; m."""

    east_m: Floats
    north_m: Floats
    dbh_m: Floats

    def __len__(self) -> int:
        return len(self.dbh_m)


@dataclass(frozen=True)
class Survey:
    """How a stand is surveyed."""

    seed: int = 1
    vehicles: int = 6
    lane_m: float = 5.0  # between the lanes
    speed_mps: float = 2.0
    sight_m: float = 10.0
    frame_sd_m: float = 0.6
    position_sd_m: float = 0.08
    diameter_sd_m: float = 0.01
    found_in_step: float = 0.6  # near, of a stem of 25 cm
    cut_up_m: float = 4.0
    bias_m: float = 0.0  # of all diameters


def said(vehicle_id: int, *, north_m: float, east_m: float, dbh_m: float = 0.3, at_s: float = 10.0) -> StemObservation:
    """A good observation, cut at 4 m."""
    return StemObservation(
        vehicle_id=vehicle_id,
        first_s=at_s,
        last_s=at_s + 4.0,
        north_m=north_m,
        east_m=east_m,
        position_sd_m=0.05,
        frame_sd_m=0.6,
        cut_up_m=4.0,
        diameter_m=0.9 * dbh_m,
        diameter_sd_m=0.01,
        dbh_m=dbh_m,
        dbh_sd_m=0.012,
        is_dbh_measured=False,
        lean_rad=0.02,
        arc_share=0.5,
        rays=150,
        grade=Grade.GOOD,
        reason="",
    )


def tree_of(told: StemObservation) -> int:
    """The tree that a simulated observation is of."""
    return told.rays // 100


def rows_of(low: tuple[float, float], high: tuple[float, float], survey: Survey) -> list[Floats]:
    """True places (east, north) of each vehicle every STEP_S: lanes along east, the vehicles abreast, to and fro."""
    (west, south), (east, north) = low, high
    lanes = np.arange(south + survey.lane_m / 2.0, north, survey.lane_m)
    ways: list[list[tuple[float, float]]] = [[] for _ in range(survey.vehicles)]
    step_m = survey.speed_mps * STEP_S
    for k, lane in enumerate(lanes):
        xs = np.arange(west, east + step_m / 2.0, step_m)
        swath = k // survey.vehicles
        xs = xs if swath % 2 == 0 else xs[::-1]
        ways[k % survey.vehicles] += [(float(x), float(lane)) for x in xs]
    return [np.asarray(way) for way in ways if way]


def records_of(trees: Trees, ways: Sequence[Floats], survey: Survey) -> list[StoredRecord]:
    """What the vehicles, 1, 2 ..., would have written."""
    rng = np.random.default_rng(survey.seed)
    taper = rng.normal(0.0, 0.01), rng.normal(0.0, 0.02, len(trees))  # of the stand, of each tree; shares of diameters
    records = []
    for k, way in enumerate(ways):
        records += _of_vehicle(k + 1, trees, way, survey, taper, rng)
    return records


def _of_vehicle(
    vehicle_id: int, trees: Trees, way: Floats, survey: Survey, taper: tuple[float, Floats], rng: np.random.Generator
) -> list[StoredRecord]:
    error_m = _wander(len(way), survey.frame_sd_m, rng)
    open_passes: dict[int, list[tuple[float, bool]]] = {}  # of each tree in sight: time, and was it hit
    done: list[tuple[float, bytes, int]] = []
    for step, (east, north) in enumerate(way):
        now_s = 10.0 + step * STEP_S
        told = (north + error_m[step, 0], east + error_m[step, 1], survey.frame_sd_m, survey.sight_m)
        point = TrackPoint(vehicle_id, now_s, *told)
        done.append((now_s, encode_track(point), TRACK_KIND))
        seen = _in_sight(trees, east, north, survey)
        for tree in sorted(set(open_passes) - set(seen)):
            done += _ended(vehicle_id, tree, open_passes.pop(tree), trees, survey, taper, error_m, now_s, rng)
        for tree, chance in seen.items():
            open_passes.setdefault(tree, []).append((now_s, bool(rng.random() < chance)))
    for tree in sorted(open_passes):
        done += _ended(vehicle_id, tree, open_passes[tree], trees, survey, taper, error_m, now_s, rng)
    return [StoredRecord(vehicle_id, 7, k, kind, at_s, body) for k, (at_s, body, kind) in enumerate(done, start=1)]


def _in_sight(trees: Trees, east: float, north: float, survey: Survey) -> dict[int, float]:
    """Trees that a step may measure, and the chance of it: in sight, and not behind another."""
    de, dn = trees.east_m - east, trees.north_m - north
    r = np.hypot(de, dn)
    near = np.flatnonzero((r < survey.sight_m) & (r > trees.dbh_m))
    chances = {}
    for j in near.tolist():
        along = (de[near] * de[j] + dn[near] * dn[j]) / r[j]
        across = np.abs(de[near] * dn[j] - dn[near] * de[j]) / r[j]
        hides = (along > 0.0) & (along < r[j] - 0.01) & (across < trees.dbh_m[near] / 2.0) & (near != j)
        if not hides.any():
            falls = 1.0 / (1.0 + math.exp((r[j] / survey.sight_m - 0.8) / 0.07))
            chances[j] = min(0.98, survey.found_in_step * falls * (trees.dbh_m[j] / 0.25) ** 0.3)
    return chances


def _ended(
    vehicle_id: int,
    tree: int,
    steps: list[tuple[float, bool]],
    trees: Trees,
    survey: Survey,
    taper: tuple[float, Floats],
    error_m: Floats,
    now_s: float,
    rng: np.random.Generator,
) -> list[tuple[float, bytes, int]]:
    """The record of a pass, if it hit."""
    hits = [at_s for at_s, hit in steps if hit]
    if not hits:
        return []
    sd_m = survey.diameter_sd_m * (1.5 if len(hits) == 1 else 1.0)
    tail = 3.0 if rng.random() < 0.03 else 1.0
    taken = 0.9 * trees.dbh_m[tree]  # at the cut, by the taper that it has
    diameter_m = taken * (1.0 + taper[0] + taper[1][tree]) + survey.bias_m + rng.normal(0.0, sd_m * tail)
    diameter_m = max(0.02, diameter_m)
    offset = error_m[round((float(np.mean(hits)) - 10.0) / STEP_S)] + rng.normal(0.0, survey.position_sd_m, 2)
    dbh_m = diameter_m / 0.9
    told = StemObservation(
        vehicle_id=vehicle_id,
        first_s=hits[0],
        last_s=hits[-1],
        north_m=trees.north_m[tree] + offset[0],
        east_m=trees.east_m[tree] + offset[1],
        position_sd_m=survey.position_sd_m,
        frame_sd_m=survey.frame_sd_m,
        cut_up_m=survey.cut_up_m,
        diameter_m=diameter_m,
        diameter_sd_m=sd_m,
        dbh_m=dbh_m,
        dbh_sd_m=math.hypot(sd_m / 0.9, 0.0224 * dbh_m),
        is_dbh_measured=False,
        lean_rad=None,
        arc_share=0.4,
        rays=100 * tree + min(99, len(hits)),  # tests know by it which tree it is
        grade=Grade.GOOD if len(hits) > 2 else Grade.FAIR,
        reason="" if len(hits) > 2 else "few scans",
    )
    return [(now_s, encode(told), STEM_KIND)]


def _wander(n: int, sd_m: float, rng: np.random.Generator) -> Floats:
    """Frame error of every step: half of the variance from the start on, half wandering within 90 s."""
    decay = math.exp(-STEP_S / 90.0)
    error_m = np.empty((n, 2))
    error_m[0] = rng.normal(0.0, sd_m / math.sqrt(2.0), 2)
    for k in range(1, n):
        error_m[k] = decay * error_m[k - 1] + rng.normal(0.0, sd_m / math.sqrt(2.0) * math.sqrt(1.0 - decay**2), 2)
    return error_m + rng.normal(0.0, sd_m / math.sqrt(2.0), 2)


def regular_stand(seed: int, density_per_ha: float, *, east_m: float = 80.0, north_m: float = 60.0) -> Trees:
    """A stand as `[forest.stand]` grows it, diameters from 7 cm."""
    (west, south), (east, north) = (-20.0, -20.0), (east_m + 20.0, north_m + 20.0)
    area = [(west, south), (east, south), (east, north), (west, north)]
    mission = Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": (-500.0, 0.0, 3.0), "d2_enu_m": (500.0, 0.0, 3.0), "vel_leader_mps": 1.0},
            "swarm": {"size": 2},
            "forest": {
                "stand": {
                    "seed": seed,
                    "density_per_ha": density_per_ha,
                    "area_enu_m": area,
                    "dbh_min_m": 0.07,
                    "dbh_mean_m": 0.28,
                    "dbh_max_m": 0.6,
                    "dbh_shape": 2.0,
                }
            },
        }
    )
    spec = mission.forest.stand
    assert spec is not None
    grown = generate_stand(mission, spec, ()).trees
    rows = np.asarray([(t.east_m, t.north_m, 2.0 * t.radius_m) for t in grown])
    return Trees(rows[:, 0], rows[:, 1], rows[:, 2])


def clustered_stand(seed: int, density_per_ha: float, *, east_m: float = 80.0, north_m: float = 60.0) -> Trees:
    """Groups of about four within 4 m, none nearer than 0.8 m to another (Thomas 1949, thinned)."""
    rng = np.random.default_rng(seed)
    area_m2 = (east_m + 40.0) * (north_m + 40.0)
    wanted = int(rng.poisson(density_per_ha * area_m2 / 10_000.0))
    places: list[tuple[float, float]] = []
    while len(places) < wanted:
        middle = rng.uniform((-20.0, -20.0), (east_m + 20.0, north_m + 20.0))
        for _ in range(1 + int(rng.poisson(3.0))):
            place = middle + rng.normal(0.0, 4.0, 2)
            if all(math.dist(place, other) > 0.8 for other in places):
                places.append((float(place[0]), float(place[1])))
    rows = np.asarray(places[:wanted])
    dbh_m = np.minimum(0.07 + 0.22 * rng.weibull(1.8, len(rows)), 0.7)
    return Trees(rows[:, 0], rows[:, 1], dbh_m)
