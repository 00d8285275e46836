"""The four stages of a flight in space, as Fig. 4 of the paper: deployment, departure, navigation, coverage."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from mission.stand.stand import stand_of
from sim_bridge.judge.metrics import Floats, Ints, acting_leader, departure, links, swarm_phase
from sim_bridge.judge.recording import Recording
from sim_bridge.lab.plot_style import ALARM, FAINT, INK, RC, colours
from sim_bridge.trunk_attenuation import range_share

BEFORE_S = 1.0  # the first picture shows the swarm this long after the election
ON_THE_WAY_S = 12.0  # the second picture, this long after departure
MARGIN_M = 3.0
TAIL_S = 10.0


class Flight(NamedTuple):
    """A flight, ready to be drawn. ENU metres; columns and colours by vehicle."""

    mission: Mission
    recording: Recording
    time_s: Floats  # (T,)
    enu_m: Floats  # (T, n, 3)
    phase: Ints  # (T,)
    leader: Ints  # (T,) id of the acting leader; 0: none
    colours: tuple[Any, ...]


def prepare(recording: Recording, mission: Mission) -> Flight:
    """Derives what is drawn of a flight."""
    return Flight(
        mission,
        recording,
        recording.time_s,
        enu_m=recording.pos_ned_m[:, :, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
        phase=swarm_phase(recording).astype(np.intp),
        leader=acting_leader(recording).astype(np.intp),
        colours=colours(recording.on_ground.shape[1]),
    )


def draw(recording: Recording, mission: Mission, file: Path) -> None:
    """ValueError for a flight that never came to coverage."""
    flight = prepare(recording, mission)
    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(10.0, 9.0), dpi=110)
        for index, (title, tick) in enumerate(stages(flight)):
            axes = figure.add_subplot(2, 2, index + 1, projection="3d", computed_zorder=False)
            axes.set_title(f"({'abcd'[index]}) {title}, {flight.time_s[tick]:.0f} s", fontsize=10)
            _stage(axes, flight, tick)
        figure.subplots_adjust(left=0.0, right=0.95, bottom=0.04, top=0.95, wspace=0.05, hspace=0.12)
        figure.savefig(file, metadata={"Software": None})


def stages(flight: Flight) -> list[tuple[str, int]]:
    """Title and tick of each picture."""
    started = departure(flight.recording)
    covering = np.flatnonzero(flight.phase == SwarmPhase.COVERAGE)
    if started is None or not covering.size:
        raise ValueError("the flight has no departure or no coverage: nothing to draw its stages from")
    elected = int(np.flatnonzero(flight.leader > 0)[0])
    start, arrival = started[0], int(covering[0])
    return [
        ("Initial deployment and leader election", _later(flight, elected, BEFORE_S)),
        ("Communication network, departure", _later(flight, start, ON_THE_WAY_S)),
        ("Navigation, half-way", (start + arrival) // 2),
        ("Coverage around d2", int(covering[-1])),
    ]


def _later(flight: Flight, tick: int, seconds: float) -> int:
    return min(
        int(np.searchsorted(flight.time_s, flight.time_s[tick] + seconds)),
        len(flight.time_s) - 1,
    )


def _stage(axes: Any, flight: Flight, tick: int) -> None:
    where = flight.enu_m[tick]
    ends = where[_grounded_links(flight, tick)]
    axes.add_collection3d(Line3DCollection(list(ends), colors=INK, linewidths=0.9, alpha=0.55))
    tail = (flight.time_s >= flight.time_s[tick] - TAIL_S) & (flight.time_s <= flight.time_s[tick])
    for column, colour in enumerate(flight.colours):
        axes.plot(*flight.enu_m[tail, column].T, color=colour, linewidth=0.9, alpha=0.8)
        leads = flight.leader[tick] == column + 1
        axes.plot(
            *where[column][:, None],
            marker="o",
            linestyle="",
            markersize=9 if leads else 6.5,
            color=INK if leads else colour,
            markeredgecolor="white",
        )
    route = flight.mission.route
    low, high = where.min(axis=0), where.max(axis=0)
    for name, point in (("d1", route.d1_enu_m), ("d2", route.d2_enu_m)):
        at = np.array(point)
        if (at > low - 12.0).all() and (at < high + 12.0).all():
            axes.plot(*at[:, None], marker="+", linestyle="", markersize=11, color=ALARM, markeredgewidth=1.8)
            axes.text(*(at + 1.0), name, color=ALARM, fontsize=10)
            low, high = np.minimum(low, at), np.maximum(high, at)
    half = (high - low).max() / 2.0 + MARGIN_M
    centre = (low + high) / 2.0
    centre[2] = max(centre[2], half)
    for name, middle in zip("xyz", centre, strict=True):
        getattr(axes, f"set_{name}lim")(middle - half, middle + half)
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.set_zlabel("up, m")
    axes.tick_params(labelsize=7, colors=FAINT)
    axes.set_box_aspect((1, 1, 1))


def _grounded_links(flight: Flight, tick: int) -> Any:
    """The links of G; before take-off, when G has none, which vehicles are in range of one another."""
    found = links(flight.recording, tick, range_share(flight.mission.sim, stand_of(flight.mission)))
    if len(found) or not flight.recording.on_ground[tick].any():
        return found
    first, second = np.triu_indices(len(flight.colours), k=1)
    apart = np.linalg.norm(flight.enu_m[tick, first] - flight.enu_m[tick, second], axis=1)
    in_range = apart <= flight.recording.range_m[tick, first]
    return np.stack((first[in_range], second[in_range]), axis=1)
