"""Limits of the mission beside what was flown: a line for each limit that the verdict looks at."""

from __future__ import annotations

from typing import Any, NamedTuple

from mission.common.forming import FORMED_RATIO
from mission.document.model import Mission
from sim_bridge.judge.metrics import Metrics, tolerance_m
from sim_bridge.judge.verdict import separation_limit_m


class Limit(NamedTuple):
    """One of them. `kept` None: the mission sets none."""

    name: str
    flown: str
    allowed: str
    kept: bool | None

    def as_dict(self) -> dict[str, Any]:
        """As a replay holds it."""
        return self._asdict()


def limits(metrics: Metrics, mission: Mission) -> list[Limit]:
    """In the order in which a reader asks."""
    found = [
        Limit(
            "departure to arrival of all",
            "never" if metrics.arrival_last_s is None else f"{metrics.arrival_last_s:.1f} s",
            "all vehicles at d2",
            metrics.arrived,
        )
    ]
    least_m, limit_m = metrics.min_separation_m, separation_limit_m(mission)
    if least_m is not None:
        found.append(Limit("least separation", f"{least_m:.2f} m", f"at least {limit_m:g} m", least_m >= limit_m))
    found.append(Limit("contacts", str(metrics.contacts), "none", metrics.contacts == 0))
    if metrics.trunk_clearance_min_m is not None:
        found.append(Limit("nearest to a trunk", f"{metrics.trunk_clearance_min_m:.2f} m", "", None))
    if metrics.box_clearance_min_m is not None:
        found.append(Limit("nearest to a box", f"{metrics.box_clearance_min_m:.2f} m", "", None))
    share = metrics.connected_fraction_transit
    if share is not None and metrics.n > 1:
        found.append(Limit("connected in transit", f"{share if share == 1.0 else min(share, 0.999):.1%}", "", None))
    gap_deg, ideal_deg = metrics.coverage_gap_deg, metrics.coverage_gap_ideal_deg
    if mission.coverage.duration_s > 0.0 and gap_deg is not None and ideal_deg is not None:
        most_deg = FORMED_RATIO * ideal_deg
        allowed = f"at most {most_deg:.0f}° (ideal {ideal_deg:.0f}°)"
        found.append(Limit("coverage gap", f"{gap_deg:.0f}°", allowed, gap_deg <= most_deg))
        error_m, within_m = metrics.coverage_radius_error_m, tolerance_m(mission)
        if error_m is not None:
            name = f"off the {mission.coverage.shape.value}"
            found.append(Limit(name, f"{error_m:.1f} m", f"at most {within_m:g} m", error_m <= within_m))
    if metrics.lost:
        found.append(Limit("lost", ", ".join(map(str, metrics.lost)), "", None))
    return found
