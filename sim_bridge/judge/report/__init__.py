"""A flight's run folder, its figures in words, and its picture."""

from __future__ import annotations

from typing import Any

MISSION_NAME = "mission.toml"  # as it was flown
PICTURE_NAME = "flight.png"


def print_figures(figures: dict[str, Any]) -> None:
    """One a line, with the digits that mean something; metrics.json has them all."""
    for key, value in figures.items():
        shown = "-" if value is None else f"{value:.4g}" if isinstance(value, float) else value
        print(f"  {key:<30} {shown}")
