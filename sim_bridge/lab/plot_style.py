"""The look of plots that are kept for print: colours, and matplotlib's settings."""

from __future__ import annotations

import json
from typing import Any

from sim_bridge.judge.page import BUNDLE

INK = "#22272b"
FAINT = "#8a9299"
ALARM = "#b2182b"
# As pages draw vehicles on a light ground: sim_bridge/judge/page/web/palette.mjs makes and measures them
PALETTE: tuple[str, ...] = tuple(json.loads((BUNDLE / "palette.json").read_text(encoding="utf-8"))["light"])
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


def colours(n: int) -> tuple[str, ...]:
    """One for each of n vehicles: told apart by whoever looks; of more than there are they come again."""
    return tuple(PALETTE[k % len(PALETTE)] for k in range(n))
