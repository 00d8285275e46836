"""Simulated faults in the picture: when, on the panels over time, and where, on the map."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from mission.schema.faults import FaultKind
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.report.style import ALARM, HALO, Flight, Labels

IDS_SHOWN = 4
WORDS = {
    FaultKind.KILL: "killed",
    FaultKind.STOP: "stopped",
    FaultKind.PARTITION: "cut off",
    FaultKind.LATE: "late",
    FaultKind.BLIND: "blind",
    FaultKind.WIND: "in wind",
}
LABEL_SHARE = 0.017  # of a panel's width, that a name takes
BAR_Y, BAR_STEP, BARS = 0.015, 0.025, 3  # of the panel's height: bars of faults at the same time lie above one another
MARK: dict[str, Any] = {"color": ALARM, "markeredgecolor": "white", "markeredgewidth": 0.8, "linestyle": ""}


def mark_times(axes: Axes, flight: Flight, *, top: float, named: bool) -> None:
    """A line where a fault begins, up to `top` of the height, and a bar along the bottom for as long as it lasts.

    `named`: with its name, where that does not cover another's.
    """
    frame = axes.get_xaxis_transform()
    left_s, right_s = axes.get_xlim()
    label_s = LABEL_SHARE * (right_s - left_s)
    free_s = left_s  # from here on there is no name
    for index, event in enumerate(sorted(flight.faults, key=lambda event: event.at_s)):
        axes.axvline(event.at_s, ymax=top, color=ALARM, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=3.2)
        if event.kind is not FaultKind.KILL:
            end_s = right_s if event.until_s is None else min(event.until_s, right_s)
            y = BAR_Y + BAR_STEP * (index % BARS)
            axes.plot([event.at_s, end_s], [y, y], transform=frame, color=ALARM, linewidth=2.0, alpha=0.7, zorder=4.5)
        if named and event.at_s >= free_s:
            before = event.at_s - label_s >= free_s
            free_s = event.at_s + (0.0 if before else label_s)
            label = axes.annotate(
                words(event),
                (event.at_s, BAR_Y + BAR_STEP * BARS),
                xycoords=frame,
                xytext=(-1.5 if before else 1.5, 0),
                textcoords="offset points",
                ha="right" if before else "left",
                va="bottom",
                rotation=90,
                fontsize=7.5,
                color=ALARM,
                zorder=7,
            )
            label.set_path_effects(HALO)


def mark_places(axes: Axes, flight: Flight, labels: Labels) -> list[Artist]:
    """Where the vehicles were when it happened to them; for the legend."""
    for event in flight.faults:
        tick = min(int(np.searchsorted(flight.time_s, event.at_s)), len(flight.time_s) - 1)
        at = flight.enu_m[tick, [k - 1 for k in event.vehicles], :2]
        axes.plot(*at.T, marker="X" if event.kind is FaultKind.KILL else "s", markersize=8, zorder=8, **MARK)
        labels.add(f"{words(event)}, {event.at_s:.0f} s", at[0], fontsize=8.5, color=ALARM)
    return [Line2D([], [], marker="X", markersize=8, label="simulated fault", **MARK)] if flight.faults else []


def words(event: FaultEvent) -> str:
    """ "2 stopped"."""
    ids = event.vehicles
    who = ", ".join(map(str, ids)) if len(ids) <= IDS_SHOWN else f"{len(ids)} vehicles"
    return f"{who} {WORDS[event.kind]}"
