"""Names of figures for people, with units: one for pages, the terminal and docs/reference/metrics.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from sim_bridge.judge.metrics import FIGURES
from sim_bridge.judge.metrics.figures import SHARE

BY_NAME: Final = {figure.name: figure for figure in FIGURES}
UNITS: Final = {"_mps": "m/s", "_deg": "°", "_pct": "%", "_s": "s", "_m": "m"}
# Of figures that studies do not put together, so that `Figure.title` is empty, and of other keys of metrics.json
TITLES: Final = {
    "n": "vehicles",
    "lost": "vehicles lost",
    "armed": "vehicles armed at the end",
    "aloft": "vehicles in the air at the end",
    "strayed": "vehicles that landed elsewhere",
    "landed_early": "vehicles that landed early",
    "sim_time_s": "simulated time, s",
    "visited": "places visited",
    "absent": "vehicles that never came to d2",
    "straight_time_s": "straight flight by the leader alone, s",
    "closest": "the two that came closest",
    "closest_at_s": "they came closest at, s",
    "splits": "times that the swarm was split",
    "lambda2_mean_transit": "algebraic connectivity λ₂, mean in transit",
    "vertex_connectivity_coverage": "vertex connectivity in coverage",
    "coverage_gap_ideal_deg": "smallest coverage gap possible, °",
    "uncovering": "vehicles that did not cover",
    "acting_leaders_overlap_s": "time with several acting leaders, s",
    "beacons_lost": "beacons lost, of each vehicle, %",
    "end_s": "the mission was over at, s",
    "trace_hash": "hash of the flight",
    "mission_sha256": "SHA-256 of the mission as flown",
    "wall_time_s": "took on this machine, s",
    "real_time_factor": "times real time",
}


def name_of(key: str) -> str:
    """The figure's name, after a comma its unit."""
    figure = BY_NAME.get(key)
    if figure is not None and figure.title:
        return figure.heading
    if key in TITLES:
        return TITLES[key]
    for suffix, unit in UNITS.items():
        if key.endswith(suffix):
            return f"{key.removesuffix(suffix).replace('_', ' ')}, {unit}"
    return key.replace("_", " ")


def named(figures: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Figures by their names, in the units of these: shares are percent."""
    return [(name_of(key), _in_percent(value) if _is_share(key) else value) for key, value in figures.items()]


def _is_share(key: str) -> bool:
    return key == "beacons_lost" or (key in BY_NAME and BY_NAME[key].unit == SHARE)


def _in_percent(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_in_percent(one) for one in value]
    return None if value is None else round(100.0 * value, 2)
