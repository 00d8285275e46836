"""What one flight's estimators achieved, and what many flights show together."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from sim_bridge.lab.study.law import Floats
from sim_bridge.lab.study.localise.flight import Seen
from sim_bridge.lab.study.must import Verdict
from sim_bridge.lab.study.summary import Spread, spread

# Figure -> what it is; of all the worst end is the largest.
FIGURES = {
    "rmse_m": "level error of relative positions, true north; root of the mean square over neighbours and time",
    "rmse_own_m": "the same along the north of the vehicle's own compass, by which it flies",
    "p95_m": "95 % of the errors of rmse_m are smaller",
    "rotation_deg": "by how much the formation is turned about the vehicle, rms",
    "rotation_sd_deg": "what the estimator says of that, mean",
    "nees": "normalised error squared of all positions of the first observer, by degrees of freedom, mean over time",
    "nis": "mean normalised innovation squared, each cut at 2.5 sigmas: 0.98 if all is as believed",
    "dropped": "share of measurements that the gate dropped",
    "cpu_share": "processor time of one estimator, by the time flown",
    "first_m": "rmse_m of the first observer alone, beside its bounds",
    "bound_m": "first_m of all measurements up to then, solved at once",
    "smoothed_m": "first_m of all measurements of the flight, solved at once",
}
NEES_INSIDE = "nees_inside"  # share of looks at which the mean NEES of all flights is within its 95 % bounds
CONFIDENCE = 0.95
SETTLE_LOOKS = 10  # looks at which NEES is not yet judged: odometers begin while the swarm flies
EVERY_LOOKS = 10  # between two at which it is


def of_flight(seen: Sequence[Seen]) -> dict[str, Any]:
    """All figures of several observers of one flight together; "nees_at": of the first, at every EVERY_LOOKS looks."""
    off = np.concatenate([one.off_ne_m.reshape(-1, 2) for one in seen])
    own = np.concatenate([one.off_own_m.reshape(-1, 2) for one in seen])
    size_m = np.hypot(off[:, 0], off[:, 1])
    nees = _nees(seen[0])
    return {
        "rmse_m": _rms(size_m),
        "rmse_own_m": _rms(np.hypot(own[:, 0], own[:, 1])),
        "first_m": _rms(np.hypot(seen[0].off_ne_m[..., 0], seen[0].off_ne_m[..., 1])),
        "p95_m": float(np.percentile(size_m, 95.0)),
        "rotation_deg": math.degrees(_rms(np.concatenate([one.turned_rad for one in seen]))),
        "rotation_sd_deg": math.degrees(float(np.mean([one.rotation_sd_rad.mean() for one in seen]))),
        "nees": float(nees[SETTLE_LOOKS:].mean()),
        "nis": float(np.mean([one.nis for one in seen])),
        "dropped": float(np.mean([one.dropped for one in seen])),
        "cpu_share": float(np.mean([one.cpu_share for one in seen])),
        "nees_at": nees[SETTLE_LOOKS::EVERY_LOOKS].tolist(),
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values * values)))


def _nees(seen: Seen) -> Floats:
    """(L,) by degrees of freedom."""
    off = seen.off_ne_m.reshape(len(seen.off_ne_m), -1)
    return np.asarray((off * np.linalg.solve(seen.cov_m2, off[..., None])[..., 0]).mean(axis=1))


def spreads(rows: Sequence[Mapping[str, Any]]) -> dict[str, Spread]:
    """Of one run's flights."""
    found = {name: spread([row[name] for row in rows if row.get(name) is not None]) for name in FIGURES}
    return {name: one for name, one in found.items() if one is not None}


def nees_inside(rows: Sequence[Mapping[str, Any]], freedoms: int) -> tuple[float, float, float]:
    """NEES_INSIDE of one run's flights, and the bounds; `freedoms`: of one flight's positions.

    Flights are independent of each other, moments of one flight are not: bounds are those of the flights' mean.
    """
    mean = np.mean([row["nees_at"] for row in rows], axis=0)
    half = (1.0 - CONFIDENCE) / 2.0
    many = freedoms * len(rows)
    low, high = (float(stats.chi2.ppf(p, many)) / many for p in (half, 1.0 - half))
    return float(np.mean((mean >= low) & (mean <= high))), low, high


def judge(
    run: str, must: Mapping[str, Mapping[str, float]], found: Mapping[str, Spread], inside: float
) -> Iterator[Verdict]:
    """Whether a run reaches what it must: at most, and of NEES_INSIDE at least."""
    for figure, limits in must.items():
        for statistic, limit in limits.items():
            if figure == NEES_INSIDE:
                yield Verdict(run, "", figure, statistic, limit, inside, inside >= limit)
            else:
                one = found.get(figure)
                seen = None if one is None else float(getattr(one, statistic))
                yield Verdict(run, "", figure, statistic, limit, seen, seen is not None and seen <= limit)
