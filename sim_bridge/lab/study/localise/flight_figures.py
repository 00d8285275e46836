"""Figures of one flight's estimators: see `results.figures`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from sim_bridge.lab.study.law import Floats
from sim_bridge.lab.study.localise.flight import Seen

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
