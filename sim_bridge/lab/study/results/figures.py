"""The figures of studies, declared once: those of a flight, those that studies add, those of the estimator.

Limits, summary, table, plots, page and docs/reference/study.md read this.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from sim_bridge.judge import estimate_recorder, metrics
from sim_bridge.judge.metrics import stems
from sim_bridge.judge.metrics.figures import LESS, MORE, SHARE, Figure, Row

CONFIDENCE: Final = 0.95
# A flight that has none of these has not failed: it was never in parts, met no trunk, and its lead was not passed on
NOTHING_TO_TELL: Final = frozenset(
    {"rejoin_s", "trunk_clearance_min_m", "box_clearance_min_m", "handover_jump_m", "handover_step_mps"}
)


def _coverage_gap_ratio(row: Row) -> float | None:
    gap, ideal = row.get("coverage_gap_deg"), row.get("coverage_gap_ideal_deg")
    return gap / ideal if gap is not None and ideal else None


def nees_bounds(flights: int, n: int) -> tuple[float, float]:
    """The 95 % bounds of the mean NEES, by degrees of freedom, of so many flights with n vehicles each."""
    from scipy import stats  # a second to import

    many = 2 * (n - 1) * flights
    half = (1.0 - CONFIDENCE) / 2.0
    low, high = (float(stats.chi2.ppf(p, many)) / many for p in (half, 1.0 - half))
    return low, high


def _nees_inside(rows: Sequence[Row]) -> float | None:
    """Flights are independent of each other, moments of one flight are not: bounds are those of the flights' mean."""
    if not rows:
        return None
    mean = np.mean([row["nees_at"] for row in rows], axis=0)
    low, high = nees_bounds(len(rows), rows[0]["n"])
    return float(np.mean((mean >= low) & (mean <= high)))


_OF_STUDIES: Final = (
    Figure(
        "over_alone_leader",
        SHARE,
        "arrival_leader_s over that of one vehicle alone, less 1: without trees, wind and errors where the mission has "
        "[sensing]; else of the run's flights with swarm.size = 1, if it crosses it.",
        better=LESS,
        title="leader, over one alone",
    ),
    Figure(
        "over_alone_last",
        SHARE,
        "The same of arrival_last_s.",
        better=LESS,
        title="last, over one alone",
        in_table=True,
        on_page=True,
    ),
    *(
        Figure(
            f"connected_{model}",
            SHARE,
            f'Point masses among trees: connected_fraction_transit as sim.radio_trunks = "{model}" would have it.',
            better=MORE,
            title=f"connected, trunks {told}",
        )
        for model, told in (("disc", "left out"), ("attenuated", "attenuating"), ("cut", "cutting"))
    ),
    Figure(
        "coverage_gap_ratio",
        "",
        "coverage_gap_deg / coverage_gap_ideal_deg.",
        better=LESS,
        title="coverage gap over the ideal",
        on_page=True,
        of_flight=_coverage_gap_ratio,
    ),
    Figure(
        "acceleration_mean_mps2",
        "m/s²",
        "Point masses: size of the acceleration, mean over vehicles and transit: what the flight costs in effort.",
        better=LESS,
        title="mean acceleration",
        in_table=True,
    ),
)
_RECORDED: Final = tuple(
    Figure(
        name,
        "m/s" if name.endswith("_mps") else "m" if name.endswith("_m") else "",
        text,
        better=LESS,
        title=estimate_recorder.TITLES[name],
    )
    for name, text in estimate_recorder.definitions().items()
)
_BETTER_OF_SURVEYS: Final = {  # a bias and counts have no better end
    "stems_found_share": MORE,
    "stems_false_share": LESS,
    "stems_dbh_rmse_m": LESS,
    "stems_dbh_within_share": MORE,
    "stems_position_rmse_m": LESS,
    "stems_relative_rmse_m": LESS,
}
_SURVEYED: Final = tuple(  # in missions with [survey]
    Figure(name, "m" if name.endswith("_m") else "", stems.definitions()[name], better=better, title=stems.TITLES[name])
    for name, better in _BETTER_OF_SURVEYS.items()
)
FLIGHT: Final = (
    *(figure for figure in metrics.FIGURES if figure.better is not None),
    *_OF_STUDIES,
    *_RECORDED,
    *_SURVEYED,
)
ESTIMATOR: Final = (
    Figure(
        "rmse_m",
        "m",
        "Level error of relative positions, true north; root of the mean square over neighbours and time.",
        better=LESS,
        title="error of relative positions",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "rmse_own_m",
        "m",
        "The same along the north of the vehicle's own compass, by which it flies.",
        better=LESS,
        title="error along the own north",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "p95_m",
        "m",
        "95 % of the errors of rmse_m are smaller.",
        better=LESS,
        title="95 % of the errors",
        in_table=True,
    ),
    Figure(
        "first_m",
        "m",
        "rmse_m of the first observer alone, beside its bounds.",
        better=LESS,
        title="error of the first observer",
        in_table=True,
    ),
    Figure(
        "bound_m",
        "m",
        "first_m of all measurements up to then, solved at once.",
        better=LESS,
        title="least error up to then",
        in_table=True,
    ),
    Figure(
        "smoothed_m",
        "m",
        "first_m of all measurements of the flight, solved at once.",
        better=LESS,
        title="least error of the flight",
        in_table=True,
    ),
    Figure(
        "rotation_deg",
        "°",
        "By how much the formation is turned about the vehicle, rms.",
        better=LESS,
        title="turn of the formation",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "rotation_sd_deg",
        "°",
        "What the estimator says of that, mean.",
        better=LESS,
        title="sd of the turn",
        in_table=True,
    ),
    Figure(
        "nees",
        "",
        "Normalised error squared of all positions of the first observer, by degrees of freedom, mean over time.",
        better=LESS,
        title="NEES",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "nis",
        "",
        "Mean normalised innovation squared, each cut at 2.5 sigmas: 0.98 if all is as believed.",
        better=LESS,
        title="NIS",
        in_table=True,
    ),
    Figure(
        "dropped",
        SHARE,
        "Measurements that the gate dropped.",
        better=LESS,
        title="dropped by the gate",
    ),
    Figure(
        "nees_inside",
        SHARE,
        "Looks at which the mean NEES of all flights of a case is within its 95 % bounds, by chi-squared.",
        better=MORE,
        title="NEES within its bounds",
        in_table=True,
        of_case=_nees_inside,
    ),
    Figure(
        "cpu_share",
        SHARE,
        "Processor time of one estimator, by the time flown.",
        better=LESS,
        title="share of a core",
        in_table=True,
    ),
)
BY_NAME: Final = {figure.name: figure for figure in (*FLIGHT, *ESTIMATOR)}


def figures_of(backend: str) -> tuple[Figure, ...]:
    """Figures that flights of a backend may have."""
    return ESTIMATOR if backend == "estimator" else FLIGHT


def value_of(row: dict[str, Any], name: str) -> float | None:
    """A figure of a row; None: it has none."""
    return BY_NAME[name].of(row)
