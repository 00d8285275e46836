"""Our fits beside circles by `circle-fit`, if installed, on the same clouds: `python -m tests.bench survey-fits`.

Clouds: rays of a hanging multi-layer lidar that passes four stems of 24 cm at 1.5 to 6 m, from poses that are wrong by
2 cm and 0.7 degrees from scan to scan. Single scans: the mean of the diameters of circles through each scan's own rays.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence

import numpy as np

from companion.survey.stem_rays import COLUMNS
from tests.unit.survey.survey_kit import fitted
from tests.unit.survey.test_stem_fit import blurred, stems_about

TRUE_M = 0.24
LEAST_RAYS = 6  # of a scan, for a circle of its own


def main(_argv: Sequence[str]) -> int:
    """Prints RMSE and bias of each."""
    try:
        import circle_fit
    except ModuleNotFoundError:
        print("survey-fits: circle-fit is not installed: pip install circle-fit")
        return 3
    off: dict[str, list[float]] = {}
    for seed in range(20):
        clouds = blurred(stems_about(seed), seed)
        off.setdefault("ours, scans and stems together", []).extend(_diameters(clouds))
        off.setdefault("ours, each stem by itself", []).extend(d for cloud in clouds for d in _diameters([cloud]))
        for name in ("taubinSVD", "prattSVD", "hyperLSQ", "standardLSQ"):
            fit = getattr(circle_fit, name)
            pooled, single = (off.setdefault(f"circle-fit {name}, {how}", []) for how in ("pooled", "mean of scans"))
            for cloud in clouds:
                rows = np.array(cloud).reshape(-1, COLUMNS)
                pooled.append(2.0 * fit(rows[:, :2])[2] - TRUE_M)
                scans = [rows[rows[:, 7] == scan, :2] for scan in np.unique(rows[:, 7])]
                radii = [fit(points)[2] for points in scans if len(points) >= LEAST_RAYS]
                single.append(2.0 * float(np.mean(radii)) - TRUE_M)
    print("fit | DBH RMSE, cm | bias, cm | median |error|, cm")
    for name, errors in off.items():
        cm = 100.0 * np.array(errors)
        print(f"{name} | {math.sqrt(float(np.mean(cm**2))):.2f} | {cm.mean():+.2f} | {np.median(np.abs(cm)):.2f}")
    return 0


def _diameters(clouds: list[array[float]]) -> list[float]:
    return [fit.diameter_m - TRUE_M for fit in fitted(*clouds) if fit is not None]
