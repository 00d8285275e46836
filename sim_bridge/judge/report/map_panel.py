"""The map from above: tracks, links at three moments, trees, fence, ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon
from matplotlib.transforms import Bbox

from mission.document.model import CoverageShape
from mission.schema.faults import FaultKind
from sim_bridge.judge.metrics import Bools, Floats, departure, links
from sim_bridge.judge.report.fault_marks import mark_places
from sim_bridge.judge.report.style import ALARM, FAINT, INK, RULE, TRUNK, Flight, Labels, draw_trunks, link_alpha
from sim_bridge.judge.tick import OBSTACLES, TOUCHED

STRIP = 0.13  # of the map's height, below everything: for the scales and the legend
MARGIN = 0.05
FENCE_SHARE = 0.3  # of the flight's extent: how far beyond it the map follows a wide fence
TRACK_STRIDE = 8  # every 8th point of a track keeps labels away,
DOT_WEIGHT = 6  # a vehicle at one of the moments as much as six of these
SCALE_MAX = 0.45  # of the map's width: a longer range is no help as a scale


def draw_map(axes: Axes, renderer: RendererAgg, flight: Flight) -> None:
    """Fill `axes`, whose box is final, with the flight seen from above."""
    axes.set_title("From above")
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m", labelpad=1)
    _set_view(axes, flight)
    moments = _moments(flight)
    ticks = [tick for tick, _ in moments]
    tracks = flight.enu_m[flight.thin[::TRACK_STRIDE], :, :2].reshape(-1, 2)
    dots = flight.enu_m[ticks * DOT_WEIGHT, :, :2].reshape(-1, 2)
    labels = Labels(axes, renderer, np.concatenate((tracks, dots)))
    labels.block(Bbox.from_extents(0.0, 0.0, 1.0, STRIP).transformed(axes.transAxes))
    legend = [*_tracks(axes, flight), *_links(axes, flight, ticks)]
    legend += [*_scenery(axes, flight), *_events(axes, flight, labels)]
    for name, point in (("d1", flight.mission.route.d1_enu_m), ("d2", flight.mission.route.d2_enu_m)):
        axes.plot(*point[:2], marker="+", markersize=9, color=INK, markeredgewidth=1.4, zorder=7)
        labels.add(name, point[:2], color=INK, fontsize=11, fontweight="bold", distance_pt=5.0)
    for tick, name in moments:
        where = flight.enu_m[tick]
        at = (float(where[:, 0].mean()), float(where[:, 1].max()))
        labels.add(f"{name}, {flight.time_s[tick]:.0f} s", at)
    _scales(axes, flight)
    box = axes.legend(handles=legend, loc="lower right", ncol=4, handlelength=1.8, columnspacing=1.4, borderaxespad=0.3)
    box.set_zorder(8)


def _set_view(axes: Axes, flight: Flight) -> None:
    """Limits that hold the flight and, as far as it is near, the fence: undistorted, the strip left free."""
    route, radius_m = flight.mission.route, flight.mission.coverage.radius_m
    d2 = np.array(route.d2_enu_m[:2])
    points = np.vstack((flight.enu_m[:, :, :2].reshape(-1, 2), route.d1_enu_m[:2], d2 - radius_m, d2 + radius_m))
    low, high = points.min(axis=0), points.max(axis=0)
    if flight.mission.fence.polygon_enu_m:
        fence = np.array(flight.mission.fence.polygon_enu_m)
        slack = FENCE_SHARE * (high - low).max()
        low = np.minimum(low, np.maximum(fence.min(axis=0), low - slack))
        high = np.maximum(high, np.minimum(fence.max(axis=0), high + slack))
    box = axes.bbox
    metre_px = min(box.width / (high[0] - low[0]), box.height * (1.0 - STRIP) / (high[1] - low[1])) * (1.0 - MARGIN)
    half = np.array([box.width, box.height * (1.0 - STRIP)]) / metre_px / 2.0
    centre = (low + high) / 2.0
    axes.set_xlim(centre[0] - half[0], centre[0] + half[0])
    axes.set_ylim(centre[1] + half[1] - 2.0 * half[1] / (1.0 - STRIP), centre[1] + half[1])


def _moments(flight: Flight) -> list[tuple[int, str]]:
    """Ticks at which the map shows the links, and what they are called."""
    last = len(flight.time_s) - 1
    started = departure(flight.recording)
    if last < 0:
        return []
    if started is None:
        return [(last, "end")]
    start = started[0]
    arrival_s = flight.metrics.arrival_last_s
    end, name = (last, "end") if arrival_s is None else (_tick_after(flight, start, arrival_s), "arrival")
    middle = _tick_after(flight, start, (flight.time_s[end] - flight.time_s[start]) / 2.0)
    return [(start, "departure"), (middle, "half-way" if name == "arrival" else "mid-flight"), (end, name)]


def _tick_after(flight: Flight, start: int, delay_s: float) -> int:
    tick = int(np.searchsorted(flight.time_s, flight.time_s[start] + delay_s - 1e-9))
    return min(tick, len(flight.time_s) - 1)


def _tracks(axes: Axes, flight: Flight) -> list[Artist]:
    for column, colour in enumerate(flight.colours):
        track = flight.enu_m[flight.thin, column, :2]
        alive = flight.recording.agent_alive[flight.thin, column]
        axes.plot(*_only(track, alive).T, color=colour, linewidth=0.9, alpha=0.85, zorder=3)
        axes.plot(*_only(track, ~alive).T, color=colour, linewidth=0.9, linestyle=":", zorder=3)
        bold = _only(track, flight.leads(column)[flight.thin])
        axes.plot(*bold.T, color=colour, linewidth=3.2, zorder=4, solid_capstyle="round")
    return [
        Line2D([], [], color=INK, linewidth=3.2, label="leader"),
        Line2D([], [], color=INK, linewidth=0.9, label="follower"),
    ]


def _only(track: Floats, flag: Bools) -> Floats:
    """`track` (K, 2) interrupted where `flag` (K,) is false."""
    return np.where(flag[:, None], track, np.nan)


def _links(axes: Axes, flight: Flight, ticks: list[int]) -> list[Artist]:
    for tick in ticks:
        where = flight.enu_m[tick, :, :2]
        ends = where[links(flight.recording, tick, flight.range_share)]
        axes.add_collection(
            LineCollection(list(ends), colors=INK, linewidths=0.6, alpha=link_alpha(len(ends)), zorder=5)
        )
        axes.scatter(where[:, 0], where[:, 1], 30, flight.colours, edgecolors="white", linewidths=0.9, zorder=6)
    dots: dict[str, Any] = {"marker": "o", "markersize": 5.0, "markerfacecolor": FAINT, "markeredgecolor": "white"}
    return [Line2D([], [], color=INK, linewidth=0.6, alpha=0.6, label="links", **dots)] if ticks else []


def _scenery(axes: Axes, flight: Flight) -> list[Artist]:
    mission = flight.mission
    legend: list[Artist] = []
    trunks = draw_trunks(axes, flight.stand, (0.0, 0.0))
    if trunks:
        dot: dict[str, Any] = {"marker": "o", "markersize": 4.0, "color": TRUNK}
        legend.append(Line2D([], [], linestyle="", label="trunk" if trunks == 1 else "trunks", **dot))
    shape: dict[str, Any] = {"fill": False, "linewidth": 1.0, "zorder": 2.0}
    axes.add_patch(
        Circle(mission.route.d2_enu_m[:2], mission.coverage.radius_m, linestyle=(0, (4, 3)), edgecolor=FAINT, **shape)
    )
    name = "ring" if mission.coverage.shape is CoverageShape.RING else "sphere"
    legend.append(Line2D([], [], color=FAINT, linestyle=(0, (4, 3)), linewidth=1.0, label=f"coverage {name}"))
    if mission.fence.polygon_enu_m:
        axes.add_patch(Polygon(mission.fence.polygon_enu_m, linestyle=(0, (1, 2)), edgecolor=ALARM, **shape))
        legend.append(Line2D([], [], color=ALARM, linestyle=(0, (1, 2)), linewidth=1.0, label="fence"))
    return legend


def _events(axes: Axes, flight: Flight, labels: Labels) -> list[Artist]:
    """Where another vehicle took the lead, where companions fell silent, and where simulated faults event."""
    legend: list[Artist] = []
    acting = np.flatnonzero(flight.leader > 0)
    changes = acting[1:][np.diff(flight.leader[acting]) != 0]
    style: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.8, "linestyle": ""}
    for tick in changes:
        leader = flight.leader[tick]
        at = flight.enu_m[tick, leader - 1, :2]
        axes.plot(*at, marker="*", markersize=15, color=flight.colours[leader - 1], zorder=8, **style)
        labels.add(f"{leader} leads, {flight.time_s[tick]:.0f} s", at, fontsize=8.5)
    if len(changes):
        legend.append(Line2D([], [], marker="*", markersize=12, color=INK, label="change of leader", **style))
    killed = {k for event in flight.faults if event.kind is FaultKind.KILL for k in event.vehicles}
    lost = [vehicle for vehicle in flight.metrics.lost if vehicle not in killed]
    for vehicle in lost:
        answered = np.flatnonzero(flight.recording.agent_alive[:, vehicle - 1])
        tick = int(answered[-1]) if answered.size else 0
        at = flight.enu_m[tick, vehicle - 1, :2]
        axes.plot(*at, marker="X", markersize=9, color=ALARM, zorder=8, **style)
        what = OBSTACLES.get(TOUCHED[flight.recording.touched[-1, vehicle - 1]])
        how = "lost" if what is None else f"ran into {what}"
        labels.add(f"{vehicle} {how}, {flight.time_s[tick]:.0f} s", at, fontsize=8.5, color=ALARM)
    if lost:
        legend.append(Line2D([], [], marker="X", markersize=8, color=ALARM, label="lost", **style))
    return legend + mark_places(axes, flight, labels)


def _scales(axes: Axes, flight: Flight) -> None:
    """The two radio ranges as bars, in the lower left corner."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    axes.axhspan(south, south + STRIP * (north - south), color="white", alpha=0.85, linewidth=0.0, zorder=6.5)
    axes.axhline(south + STRIP * (north - south), color=RULE, linewidth=0.8, zorder=6.5)
    radio = flight.mission.radio
    for height, name, range_m in (
        (0.7, "radio range in transit", radio.transit_range_m),
        (0.28, "full radio range", radio.full_range_m),
    ):
        y = south + height * STRIP * (north - south)
        x = west + 0.012 * (east - west)
        text_x = x
        if range_m < SCALE_MAX * (east - west):
            axes.plot([x, x + range_m], [y, y], marker="|", markersize=6, color=INK, linewidth=1.4, zorder=7)
            text_x += range_m + 0.01 * (east - west)
        axes.text(text_x, y, f"{name}, {range_m:g} m", va="center", fontsize=8.5, zorder=7)
