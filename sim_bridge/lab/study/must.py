"""The figures of studies, which end of each is the worst, and what a study says that its cases must reach."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from rich.box import SIMPLE
from rich.table import Table

STATISTICS = ("mean", "worst", "p95")
# Figure -> which end is the worst.
WORST: dict[str, Callable[[Sequence[float]], float]] = {
    "arrived": min,
    "arrival_leader_s": max,
    "arrival_last_s": max,
    "overhead_leader": max,
    "overhead_last": max,
    "over_alone_leader": max,
    "over_alone_last": max,
    "min_separation_m": min,
    "trunk_clearance_min_m": min,
    "contacts": max,
    "contacts_trunks": max,
    "contacts_vehicles": max,
    "contacts_crowns": max,
    "contacts_ground": max,
    "connected_fraction_transit": min,
    "connected_fraction_coverage": min,
    "connected_disc": min,
    "connected_attenuated": min,
    "connected_cut": min,
    "longest_gap_s": max,
    "rejoin_s": max,
    "coverage_gap_deg": max,
    "coverage_gap_ratio": max,
    "coverage_radius_error_m": max,
    "coverage_settled_s": max,
    "speed_mean_transit_mps": min,
    "acceleration_mean_mps2": max,
    "acting_leaders_max": max,
    "leader_changes": max,
    "leaderless_max_s": max,
    "relative_error_m": max,
    "relative_error_sds": max,
    "leader_error_d2_m": max,
    "handover_jump_m": max,
    "handover_step_mps": max,
}
ROUNDING = 1e-9


class Group(Protocol):
    """As summary.Group."""

    @property
    def run(self) -> str:
        """The name of its runs."""

    @property
    def figures(self) -> Mapping[str, Any]:
        """What its seeds have together, by name."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether one case reaches one limit. `seen` None: no seed has the figure, and it does not."""

    run: str
    case: str
    figure: str
    statistic: str
    must: float
    seen: float | None
    reached: bool

    def as_dict(self) -> dict[str, Any]:
        """Name -> value."""
        return asdict(self)


def judge(group: Group, case: str, must: Mapping[str, Mapping[str, float]]) -> list[Verdict]:
    """Of a case, by what its run must reach."""
    found = []
    for figure, limits in must.items():
        spread = group.figures.get(figure)
        for statistic, limit in limits.items():
            seen = None if spread is None else float(getattr(spread, statistic))
            if seen is None:
                reached = False
            elif WORST[figure] is max:
                reached = seen <= limit + ROUNDING
            else:
                reached = seen >= limit - ROUNDING
            found.append(Verdict(group.run, case, figure, statistic, limit, seen, reached))
    return found


def table(verdicts: Sequence[Verdict]) -> Table:
    """For people."""
    shown = Table(title="what must be reached", title_justify="left", box=SIMPLE)
    for heading in ("run", "case", "figure", "must", "seen", ""):
        shown.add_column(heading, overflow="fold")
    for v in verdicts:
        sign = "<=" if WORST[v.figure] is max else ">="
        seen = "-" if v.seen is None else f"{v.seen:.4g}"
        shown.add_row(
            v.run,
            v.case,
            f"{v.figure}, {v.statistic}",
            f"{sign} {v.must:g}",
            seen,
            "reached" if v.reached else "MISSED",
        )
    return shown
