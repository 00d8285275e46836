"""How the vehicles stand around d2 at the end of coverage."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Circle, Wedge

from companion.core.model.states import SwarmPhase
from mission.document.model import CoverageShape
from sim_bridge.judge.metrics import Floats, covers, links
from sim_bridge.judge.report.style import ALARM, FAINT, HALO, INK, RULE, Flight, draw_trunks, ink_on, link_alpha

VIEW = 1.5  # times the coverage radius, to each side of d2
TAIL_S = 8.0
FIELD_STEPS = (144, 72)  # cells of 2.5 degrees
NUMBERED_MAX = 30  # more than that would hide one another


def coverage_tick(flight: Flight) -> int | None:
    """The last tick of coverage, or of the flight if there was none; None without a tick."""
    ticks = np.flatnonzero(flight.phase == SwarmPhase.COVERAGE)
    if ticks.size:
        return int(ticks[-1])
    return len(flight.time_s) - 1 if len(flight.time_s) else None


def caption(flight: Flight) -> str:
    """What the panel shows."""
    if flight.metrics.coverage_gap_deg is None:
        return "Around d2 at the end: no coverage"
    return "Around d2 at the end of coverage"


def told_gap(flight: Flight) -> str:
    """The gap as all of a report tells it, the metric's mean over the last seconds; "" without coverage."""
    gap_deg = flight.metrics.coverage_gap_deg
    return "" if gap_deg is None else f"{gap_deg:.0f}°"


def draw_plan(axes: Axes, flight: Flight) -> None:
    """Vehicles around d2 from above, with the largest gap if they form a ring."""
    ring = flight.mission.coverage.shape is CoverageShape.RING
    radius_m = flight.mission.coverage.radius_m
    axes.set_title(caption(flight) if ring else "From above")
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-VIEW * radius_m, VIEW * radius_m)
    axes.set_ylim(-VIEW * radius_m, VIEW * radius_m)
    axes.set_xlabel("east of d2, m")
    axes.set_ylabel("north of d2, m", labelpad=1)
    axes.add_patch(Circle((0, 0), radius_m, fill=False, edgecolor=FAINT, linestyle=(0, (4, 3)), linewidth=1.0))
    d2 = np.array(flight.mission.route.d2_enu_m)
    draw_trunks(axes, flight.stand, (d2[0], d2[1]))
    axes.plot(0, 0, marker="+", markersize=9, color=INK, markeredgewidth=1.4, zorder=3)
    tick = coverage_tick(flight)
    if tick is None:
        return
    from_d2_m = flight.enu_m - d2
    if ring and flight.metrics.coverage_gap_deg is not None:
        _gap(axes, flight, from_d2_m[tick, covers(flight.recording, flight.mission)[tick]])
    tail = flight.time_s >= flight.time_s[tick] - TAIL_S
    tail[tick + 1 :] = False
    for column, colour in enumerate(flight.colours):
        axes.plot(*from_d2_m[tail, column, :2].T, color=colour, linewidth=1.2, alpha=0.7, zorder=4)
    ends = from_d2_m[tick, :, :2][links(flight.recording, tick, flight.range_share)]
    axes.add_collection(LineCollection(list(ends), colors=INK, linewidths=0.5, alpha=link_alpha(len(ends)), zorder=2))
    _vehicles(axes, flight, from_d2_m[tick, :, 0], from_d2_m[tick, :, 1], tick)


def draw_sphere(axes: Axes, flight: Flight) -> None:
    """Vehicles as seen from d2 in every direction (Mollweide: equal areas), shaded by the angle to the nearest."""
    axes.set_title(caption(flight), pad=14)
    azimuth = np.linspace(-np.pi, np.pi, FIELD_STEPS[0] + 1)
    elevation = np.linspace(-np.pi / 2.0, np.pi / 2.0, FIELD_STEPS[1] + 1)
    axes.set_xticks(np.radians([-90, 0, 90]), [])
    axes.set_yticks(np.radians([-60, -30, 0, 30, 60]), ["-60°", "-30°", "level", "30°", "60°"])
    axes.grid(color="white", linewidth=0.5, alpha=0.6)
    for name, degrees in (("west", -90), ("north", 0), ("east", 90)):
        label = axes.text(np.radians(degrees), 0.0, name, ha="center", va="center", fontsize=8, zorder=2)
        label.set_path_effects(HALO)
    tick = coverage_tick(flight)
    if tick is None:
        return
    from_d2_m = flight.enu_m[tick] - np.array(flight.mission.route.d2_enu_m)
    covering = covers(flight.recording, flight.mission)[tick]
    length_m = np.linalg.norm(from_d2_m, axis=1)
    shown = covering & (length_m > 0.0)
    if not shown.any():
        return
    middle_az, middle_el = (azimuth[1:] + azimuth[:-1]) / 2.0, (elevation[1:] + elevation[:-1]) / 2.0
    field_deg = _angle_to_nearest_deg(middle_az, middle_el, from_d2_m[shown] / length_m[shown, None])
    shade = axes.pcolormesh(azimuth, elevation, field_deg, cmap="Greys", vmin=0.0, vmax=1.6 * field_deg.max(), zorder=0)
    shade.set_rasterized(True)
    row, column = np.unravel_index(int(field_deg.argmax()), field_deg.shape)
    axes.plot(middle_az[column], middle_el[row], "X", markersize=9, color=ALARM, markeredgecolor="white", zorder=5)
    explanation = f"darker: farther from the nearest vehicle, farthest at the cross {told_gap(flight)}".rstrip()
    axes.text(0.5, -0.04, explanation, transform=axes.transAxes, ha="center", va="top", fontsize=8.5)
    east, north, up = (from_d2_m / np.maximum(length_m, 1e-9)[:, None]).T
    _vehicles(axes, flight, np.arctan2(east, north), np.arcsin(np.clip(up, -1.0, 1.0)), tick, clip=False)


def _angle_to_nearest_deg(azimuth: Floats, elevation: Floats, units: Floats) -> Floats:
    """(len(elevation), len(azimuth)) from each direction to the nearest of `units` (k, 3) ENU."""
    az, el = np.meshgrid(azimuth, elevation)
    directions = np.stack((np.cos(el) * np.sin(az), np.cos(el) * np.cos(az), np.sin(el)), axis=2)
    nearest: Floats = (directions @ units.T).max(axis=2)
    return np.degrees(np.arccos(np.clip(nearest, -1.0, 1.0)))


def _vehicles(axes: Axes, flight: Flight, x: Floats, y: Floats, tick: int, *, clip: bool = True) -> None:
    """A numbered dot for each; hollow if its companion is dead; ringed if it leads."""
    alive = flight.recording.agent_alive[tick]
    large = flight.n <= NUMBERED_MAX
    for column, colour in enumerate(flight.colours):
        leads = flight.leader[tick] == column + 1
        axes.plot(
            x[column],
            y[column],
            marker="o",
            markersize=(13.5 if large else 7.0) + (2.0 if leads else 0.0),
            color=colour if alive[column] else "white",
            markeredgecolor=INK if leads else "white" if alive[column] else colour,
            markeredgewidth=2.0 if leads else 1.0,
            clip_on=clip,
            zorder=6,
        )
        if large:
            ink = ink_on(colour) if alive[column] else INK
            name = f"{column + 1}"
            axes.text(
                x[column],
                y[column],
                name,
                ha="center",
                va="center_baseline",
                color=ink,
                fontsize=8,
                zorder=7,
                clip_on=True,
            )


def _gap(axes: Axes, flight: Flight, from_d2_m: Floats) -> None:
    """Shade the largest gap in azimuth of the last tick, and say how large it was."""
    if not len(from_d2_m):
        return
    # Wedges turn from east to north: the gap is the same
    turn_deg = np.sort(np.degrees(np.arctan2(from_d2_m[:, 1], from_d2_m[:, 0])))
    gaps_deg = np.diff(turn_deg, append=turn_deg[0] + 360.0)
    widest = int(gaps_deg.argmax())
    start_deg, gap_deg = float(turn_deg[widest]), float(gaps_deg[widest])
    reach_m = 1.22 * flight.mission.coverage.radius_m
    axes.add_patch(
        Wedge((0, 0), reach_m, start_deg, start_deg + gap_deg, color=RULE, alpha=0.6, linewidth=0.0, zorder=1)
    )
    middle = np.radians(start_deg + gap_deg / 2.0)
    at = 0.62 * flight.mission.coverage.radius_m * np.array([np.cos(middle), np.sin(middle)])
    label = axes.text(at[0], at[1], f"gap\n{told_gap(flight)}", ha="center", va="center", fontweight="bold", zorder=8)
    label.set_path_effects(HALO)
