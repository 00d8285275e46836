"""What happened when: the smallest separation and the altitudes, on the phases' background."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from companion.core.model.states import SwarmPhase
from sim_bridge.judge.metrics import separation_m
from sim_bridge.judge.report.fault_marks import mark_times
from sim_bridge.judge.report.style import ALARM, FAINT, HALO, INK, PHASE_TINTS, Flight, ink_on

BAND = 0.1  # of the panel's height, at the top: the phases' names and, below them, the leader
LEADER_BAND = 0.085
CHAR_SHARE = 0.0135  # of the panel's width that a letter of a phase's name takes
SEPARATION_SHOWN = 3.0  # times the soft separation: vehicles further apart are of no concern


def draw_separation(axes: Axes, flight: Flight) -> None:
    """Smallest distance between vehicles in flight, over time."""
    axes.set_title("Smallest separation")
    _set_time(axes, flight, "m, centre to centre")
    separation = flight.mission.separation
    apart_m = separation_m(flight.recording, flight.mission)
    shown_m = np.where(np.isfinite(apart_m), apart_m, np.nan)
    top_m = 1.4 * separation.soft_m
    if np.isfinite(apart_m).any():
        top_m = max(top_m, min(1.15 * float(np.nanmax(shown_m)), SEPARATION_SHOWN * separation.soft_m))
    axes.set_ylim(0.0, top_m / (1.0 - BAND - LEADER_BAND))
    _phases(axes, flight)
    mark_times(axes, flight, top=1.0 - BAND - LEADER_BAND, named=False)
    axes.plot(flight.time_s[flight.thin], np.minimum(shown_m, top_m)[flight.thin], color=INK, linewidth=1.2, zorder=4)
    _level(axes, separation.hard_m, f"hard limit {separation.hard_m:g} m", ALARM)
    _level(axes, separation.soft_m, f"repulsion starts {separation.soft_m:g} m", FAINT)
    least_m = flight.metrics.min_separation_m
    if least_m is not None:
        when_s = flight.time_s[int(apart_m.argmin())]
        axes.plot(when_s, least_m, marker="o", markersize=6, color=INK, markeredgecolor="white", zorder=6)
        _name_least(axes, float(when_s), least_m)
    else:
        axes.text(0.5, 0.45, "never two in flight", transform=axes.transAxes, ha="center", color=FAINT)


def _name_least(axes: Axes, when_s: float, least_m: float) -> None:
    """Below the curve's lowest point, where it cannot be in the way; beside it if there is no room below."""
    x, y = axes.transAxes.inverted().transform(axes.transData.transform((when_s, least_m)))
    room_below = y > 0.11
    ha = "left" if x < 0.08 or not room_below else "right" if x > 0.92 else "center"
    if x > 0.8 and not room_below:
        ha = "right"
    aside = 0 if room_below else -8 if ha == "right" else 8
    label = axes.annotate(
        f"least {least_m:.1f} m",
        (when_s, least_m),
        xytext=(aside, -6 if room_below else 3),
        textcoords="offset points",
        ha=ha,
        va="top" if room_below else "bottom",
        fontweight="bold",
        fontsize=9,
        zorder=7,
    )
    label.set_path_effects(HALO)


def draw_altitude(axes: Axes, flight: Flight) -> None:
    """Height of every vehicle above the origin's ground, over time."""
    axes.set_title("Altitude")
    _set_time(axes, flight, "m above ground")
    fence = flight.mission.fence
    up_m = flight.enu_m[:, :, 2]
    top_m = 1.1 * max(float(up_m.max(initial=0.0)), flight.mission.route.d1_enu_m[2], flight.mission.route.d2_enu_m[2])
    top_m = fence.altitude_max_m * 1.05 if fence.altitude_max_m < 2.0 * top_m else top_m
    bottom_m = min(0.0, 1.1 * float(up_m.min(initial=0.0)))
    axes.set_ylim(bottom_m, bottom_m + (top_m - bottom_m) / (1.0 - BAND - LEADER_BAND))
    _phases(axes, flight)
    mark_times(axes, flight, top=1.0 - BAND - LEADER_BAND, named=True)
    thin_s = flight.time_s[flight.thin]
    for column, colour in enumerate(flight.colours):
        height_m = up_m[flight.thin, column]
        axes.plot(thin_s, height_m, color=colour, linewidth=1.0, alpha=0.9, zorder=4)
        leads = flight.leads(column)[flight.thin]
        axes.plot(thin_s, np.where(leads, height_m, np.nan), color=colour, linewidth=3.2, zorder=3.5)
    _level(axes, fence.altitude_min_m, f"fence {fence.altitude_min_m:g} m", ALARM)
    if fence.altitude_max_m <= top_m:
        _level(axes, fence.altitude_max_m, f"fence {fence.altitude_max_m:g} m", ALARM)


def _set_time(axes: Axes, flight: Flight, unit: str) -> None:
    axes.set_xlabel("time, s")
    axes.set_ylabel(unit)
    end_s = float(flight.time_s[-1]) if flight.time_s.size else 0.0
    start_s = float(flight.time_s[0]) if flight.time_s.size else 0.0
    axes.set_xlim(start_s, max(end_s, start_s + 1.0))


def _level(axes: Axes, height_m: float, name: str, colour: str) -> None:
    axes.axhline(height_m, color=colour, linewidth=0.9, linestyle=(0, (4, 3)), zorder=3)
    low, high = axes.get_ylim()
    below = height_m > low + 0.7 * (high - low)
    label = axes.annotate(
        name,
        (1.0, height_m),
        xycoords=axes.get_yaxis_transform(),
        xytext=(-4, -2 if below else 2),
        textcoords="offset points",
        ha="right",
        va="top" if below else "bottom",
        fontsize=8,
        color=ALARM if colour == ALARM else INK,
        zorder=7,
    )
    label.set_path_effects(HALO)


def _phases(axes: Axes, flight: Flight) -> None:
    """Tint the phases; name them, and colour the leader, along the top."""
    frame = axes.get_xaxis_transform()
    left_s, right_s = axes.get_xlim()
    for start_s, end_s, value in _runs(flight, flight.phase):
        if value < 0:
            continue
        phase = SwarmPhase(value)
        axes.axvspan(start_s, end_s, color=PHASE_TINTS[phase], linewidth=0.0, zorder=1)
        name = phase.name.lower()
        if (end_s - start_s) / (right_s - left_s) > CHAR_SHARE * len(name):
            middle_s = (start_s + end_s) / 2.0
            axes.text(middle_s, 1.0 - BAND / 2.0, name, transform=frame, ha="center", va="center", fontsize=8.5)
    for start_s, end_s, leader in _runs(flight, flight.leader):
        if leader > 0:
            corner = (start_s, 1.0 - BAND - LEADER_BAND)
            colour = flight.colours[leader - 1]
            axes.add_patch(
                Rectangle(corner, end_s - start_s, LEADER_BAND, transform=frame, color=colour, linewidth=0.0, zorder=3)
            )
            name = f"{leader} leads"
            if (end_s - start_s) / (right_s - left_s) > CHAR_SHARE * len(name):
                centre = ((start_s + end_s) / 2.0, 1.0 - BAND - LEADER_BAND / 2.0)
                style: dict[str, Any] = {
                    "ha": "center",
                    "va": "center_baseline",
                    "fontsize": 8,
                    "color": ink_on(colour),
                }
                axes.text(*centre, name, transform=frame, zorder=4, **style)


def _runs(flight: Flight, value: np.ndarray[tuple[int], np.dtype[np.intp]]) -> list[tuple[float, float, int]]:
    """Start, end and value of the stretches in which `value` (T,) stays the same."""
    if not len(value):
        return []
    starts = np.concatenate(([0], np.flatnonzero(np.diff(value)) + 1))
    ends = np.append(starts[1:], len(value) - 1)
    return [
        (float(flight.time_s[a]), float(flight.time_s[b]), int(value[a])) for a, b in zip(starts, ends, strict=True)
    ]
