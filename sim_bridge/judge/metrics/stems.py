"""Stems as vehicles measured them against the trees that stand there: completeness, false ones, diameters, places."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from companion.survey.observation import STEM_KIND, Grade, StemObservation, decode
from mission.document.model import Mission
from mission.schema.trees import StandTree
from mission.stand.stand import Stand
from sim_bridge.judge.recording import Recording

Floats = NDArray[np.float64]
Place = tuple[float, float]  # north, east, m
DBH_LEAST_M: Final = 0.10  # thinner trees are not counted, as inventories do
PASSED_SHARE: Final = 0.85  # of the reach: what stays farther off is seen on a few scans only
NEAR_M: Final = 1.2  # from a measured stem to the tree that it is: wrong by its frame, at most
THIN_M: Final = 0.07  # and that tree's least diameter: a stem that is taken for one of 10 cm is not false
LOOKS_HZ: Final = 4.0  # at the way flown
BESIDE_S: Final = 15.0  # stems measured within so much of each other share the error of their frame

TITLES: Final = {  # of those that studies compare
    "stems_found_share": "stems found, of those passed",
    "stems_false_share": "stems measured that are none",
    "stems_dbh_rmse_m": "error of the DBH, rms",
    "stems_dbh_within_share": "DBH within two of its stated sds",
    "stems_position_rmse_m": "error of a stem's place, rms",
    "stems_relative_rmse_m": "the same among stems seen together",
}


@dataclass(frozen=True, slots=True)
class StemFigures:
    """Figures of one flight with [survey]. None: there was nothing to tell them by."""

    stems_passed: Annotated[
        int,
        "Trees of 10 cm DBH or more whose axis came within 85 % of the survey's reach of a vehicle in the air whose "
        "companion answered: by true places, whatever was recorded.",
    ]
    stems_found: Annotated[int, "Of these, trees of which a vehicle has a measurement that is GOOD or FAIR."]
    stems_found_share: Annotated[float | None, "`stems_found` over `stems_passed`."]
    stems_measured: Annotated[int, "Measurements that are GOOD or FAIR, and measured 10 cm DBH or more."]
    stems_false_share: Annotated[
        float | None, "Of these, the share that is no tree: none of 7 cm or more stands within 1.2 m."
    ]
    stems_dbh_rmse_m: Annotated[
        float | None,
        "Error of the DBH, root of the mean square over measurements, GOOD or FAIR, of trees of 10 cm or more.",
    ]
    stems_dbh_bias_m: Annotated[float | None, "Mean of that error: measured less true."]
    stems_dbh_within_share: Annotated[float | None, "Share of these errors within two of their stated sds."]
    stems_breast_share: Annotated[float | None, "Share that was cut at breast height, and came by no taper."]
    stems_position_rmse_m: Annotated[
        float | None, "Level distance of these stems from their trees at breast height, root of the mean square."
    ]
    stems_relative_rmse_m: Annotated[
        float | None,
        "The same once the median error of the stems that the same vehicle measured within 15 s is taken off.",
    ]

    def as_dict(self) -> dict[str, Any]:
        """Name -> value in the order of declaration, ready for JSON."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, slots=True)
class MeasuredStem:
    """A measurement and the tree that it is of; None: no tree."""

    observation: StemObservation
    tree: StandTree | None
    off_ne_m: tuple[float, float]  # measured less true
    away_m: float  # least distance of a vehicle from the tree


def definitions() -> dict[str, str]:
    """Name -> definition of every figure in `StemFigures`, for the documentation."""
    hints = get_type_hints(StemFigures, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in dataclasses.fields(StemFigures)}


def measure_stems(
    records: Mapping[int, Sequence[tuple[int, bytes]]], recording: Recording, mission: Mission, stand: Stand
) -> StemFigures | None:
    """Figures of the records of vehicles, by id; None for a mission without [survey]. `recording`: their flight."""
    if mission.survey is None:
        return None
    found, passed = match_stems(records, recording, mission, stand)
    thick = [stem for stem in found if stem.observation.dbh_m >= DBH_LEAST_M]
    seen = {(tree.north_m, tree.east_m) for tree, _ in passed}
    real = [stem for stem in found if stem.tree is not None and 2.0 * stem.tree.radius_m >= DBH_LEAST_M]
    places = {(stem.tree.north_m, stem.tree.east_m) for stem in real if stem.tree is not None}
    off_m = np.array([stem.observation.dbh_m - 2.0 * stem.tree.radius_m for stem in real if stem.tree is not None])
    sd_m = np.array([stem.observation.dbh_sd_m for stem in real])
    off_ne = np.array([stem.off_ne_m for stem in real]).reshape(-1, 2)
    return StemFigures(
        stems_passed=len(seen),
        stems_found=len(seen & places),
        stems_found_share=len(seen & places) / len(seen) if seen else None,
        stems_measured=len(thick),
        stems_false_share=sum(stem.tree is None for stem in thick) / len(thick) if thick else None,
        stems_dbh_rmse_m=_rms(off_m),
        stems_dbh_bias_m=float(off_m.mean()) if real else None,
        stems_dbh_within_share=float((np.abs(off_m) <= 2.0 * sd_m).mean()) if real else None,
        stems_breast_share=float(np.mean([stem.observation.is_dbh_measured for stem in real])) if real else None,
        stems_position_rmse_m=_rms(np.hypot(*off_ne.T)),
        stems_relative_rmse_m=_rms(np.hypot(*(off_ne - _beside(real, off_ne)).T)),
    )


def match_stems(
    records: Mapping[int, Sequence[tuple[int, bytes]]], recording: Recording, mission: Mission, stand: Stand
) -> tuple[list[MeasuredStem], list[tuple[StandTree, float]]]:
    """GOOD and FAIR stems with their trees; and trees of 10 cm or more that were passed, how far off."""
    stems: list[StemObservation] = []
    for vehicle_id, kept in records.items():
        for kind, body in kept:
            stem = decode(body, vehicle_id) if kind == STEM_KIND else None
            if stem is not None and stem.grade is not Grade.POOR:
                stems.append(stem)
    away = _passed_m(recording, mission, stand)
    found = [_matched(stem, stand, away) for stem in stems]
    thick = [tree for tree in stand.trees if 2.0 * tree.radius_m >= DBH_LEAST_M]
    return found, [(tree, away[place]) for tree in thick if (place := (tree.north_m, tree.east_m)) in away]


def _matched(stem: StemObservation, stand: Stand, away_m: Mapping[Place, float]) -> MeasuredStem:
    """The nearest tree that is thick enough."""
    near = [
        tree
        for tree in stand.near(stem.east_m, stem.north_m, NEAR_M)
        if 2.0 * tree.radius_m >= THIN_M and math.hypot(tree.north_m - stem.north_m, tree.east_m - stem.east_m) < NEAR_M
    ]
    if not near:
        return MeasuredStem(stem, None, (0.0, 0.0), math.inf)
    tree = min(near, key=lambda one: math.hypot(one.north_m - stem.north_m, one.east_m - stem.east_m))
    off_ne_m = (stem.north_m - tree.north_m, stem.east_m - tree.east_m)
    return MeasuredStem(stem, tree, off_ne_m, away_m.get((tree.north_m, tree.east_m), math.inf))


def _passed_m(recording: Recording, mission: Mission, stand: Stand) -> dict[Place, float]:
    """By a tree's place how near a vehicle came that could measure it; without those that all stayed too far from."""
    assert mission.survey is not None
    assert mission.sensing is not None
    reach_m = PASSED_SHARE * min(mission.survey.reach_m, mission.sensing.range_m)
    least_m: dict[Place, float] = {}
    rows = np.flatnonzero(np.diff(np.floor(recording.time_s * LOOKS_HZ), prepend=-1.0))
    surveys = (recording.agent_alive & ~recording.on_ground)[rows]
    for north_m, east_m in recording.pos_ned_m[rows][surveys][:, :2].tolist():
        for tree in stand.near(east_m, north_m, reach_m):
            place, away_m = (tree.north_m, tree.east_m), math.hypot(tree.north_m - north_m, tree.east_m - east_m)
            if away_m <= min(reach_m, least_m.get(place, math.inf)):
                least_m[place] = away_m
    return least_m


def _beside(stems: Sequence[MeasuredStem], off_ne: Floats) -> Floats:
    """Median error of the stems that the same vehicle measured about the same time; (stems, 2)."""
    ids = np.array([stem.observation.vehicle_id for stem in stems])
    times = np.array([stem.observation.last_s for stem in stems])
    means = np.zeros_like(off_ne)
    for k in range(len(stems)):
        near = (ids == ids[k]) & (np.abs(times - times[k]) <= BESIDE_S)
        means[k] = np.median(off_ne[near], axis=0)
    return means


def _rms(values: Floats) -> float | None:
    return math.sqrt(float(np.mean(values**2))) if len(values) else None
