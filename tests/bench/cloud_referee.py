"""dendromatics, the library under 3DFin, on a run's point cloud: what stems and diameters it finds, beside ours.

`python -m tests.bench cloud RUN --dendromatics` where it is installed (`pip install dendromatics`; not in our locks).
Its pipeline is that of 3DFin: vertical clusters in a stripe, trees by the axes of these, circles at breast height.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# Tried on one flight for a band of 1.6 m with a thousand points a stem, 2 cm off the bark: its own defaults, for
# terrestrial scans of ten times as many, find no circle there
STRIPE_M: Final = (0.5, 2.1)
CLUSTER_LEAST: Final = 100
HEIGHT_LEAST_M: Final = 0.3
SECTION_M: Final = 0.25  # to both sides of breast height
SECTION_LEAST: Final = 40
APART_M: Final = 0.05  # of points in one cluster


def measured(points_m: Floats) -> Floats:
    """East, north and diameter, m, of the stems in `points_m` (n, 3): east, north, height above the ground."""
    import dendromatics as dm

    stripe = points_m[(points_m[:, 2] >= STRIPE_M[0]) & (points_m[:, 2] <= STRIPE_M[1])]
    clusters = dm.verticality_clustering(stripe, 0.1, 0.6, CLUSTER_LEAST, 2, 0.02, 0.02)
    cloud = np.column_stack((points_m, points_m[:, 2]))
    trees = dm.individualize_trees(cloud, clusters, 0.035, 0.035, *STRIPE_M, h_range=HEIGHT_LEAST_M, d_max=0.8)[0]
    sections = {"R_min": 0.03, "R_max": 0.5, "n_points_section": SECTION_LEAST, "max_dist": APART_M, "width": 5}
    east_m, north_m, radius_m = dm.compute_sections(trees, np.array([1.3]), SECTION_M, **sections)[:3]
    found = np.column_stack((east_m[:, 0], north_m[:, 0], 2.0 * radius_m[:, 0]))
    return np.asarray(found[radius_m[:, 0] > 0.0])
