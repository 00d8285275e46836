"""The look of plots that are kept for print: colours, and matplotlib's settings."""

from __future__ import annotations

from typing import Any

import matplotlib

INK = "#22272b"
FAINT = "#8a9299"
ALARM = "#b2182b"
# Paul Tol's "muted" scheme: distinct with every common colour blindness, and dark enough on white (but the last)
FEW = ("#332288", "#cc6677", "#117733", "#88ccee", "#aa4499", "#999933", "#44aa99", "#882255", "#ddcc77")
RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 9.5,
    "text.usetex": False,
    "text.parse_math": False,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.facecolor": "white",
    "axes.grid": False,
    "axes.labelcolor": INK,
    "axes.labelsize": 9.5,
    "axes.linewidth": 0.8,
    "axes.titlelocation": "left",
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlecolor": INK,
    "xtick.color": FAINT,
    "ytick.color": FAINT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
}


def colours(n: int) -> tuple[Any, ...]:
    """One for each of n vehicles: told apart at a glance if they are few, in order along a ramp if many."""
    if n <= len(FEW):
        return FEW[:n]
    ramp = matplotlib.colormaps["viridis"]
    return tuple(ramp(0.93 * k / (n - 1)) for k in range(n))  # its yellow end is lost on white
