"""What the panels of a picture share: the flight as they need it, colours, labels that keep out of each other's way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.transforms import Bbox

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Bools, Floats, Ints, Metrics, acting_leader, measure, swarm_phase, with_columns
from sim_bridge.judge.recording import Recording
from sim_bridge.trunk_attenuation import RangeShare, range_share

INK = "#22272b"
FAINT = "#8a9299"
RULE = "#d5dade"
ALARM = "#b2182b"
TRUNK = "#7a5230"
FEW_TRUNKS = 50
# Paul Tol's "muted" scheme: distinct with every common colour blindness, and dark enough on white (but the last)
FEW = ("#332288", "#cc6677", "#117733", "#88ccee", "#aa4499", "#999933", "#44aa99", "#882255", "#ddcc77")
PHASE_TINTS = {
    SwarmPhase.ASSEMBLE: "#f4f5f6",
    SwarmPhase.GATHER: "#e9ecee",
    SwarmPhase.TRANSIT: "#dbe8f4",
    SwarmPhase.COVERAGE: "#e0efdc",
    SwarmPhase.RETURN: "#f6ecd6",
    SwarmPhase.LAND: "#f1e4ec",
}
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
HALO: list[AbstractPathEffect] = [withStroke(linewidth=2.5, foreground="white")]
TRACK_POINTS = 1500  # about one a pixel: more would only cost time


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight, ready to be drawn. ENU metres; columns and colours by vehicle."""

    mission: Mission
    stand: Stand
    recording: Recording
    metrics: Metrics
    enu_m: Floats  # (T, n, 3)
    phase: Ints  # (T,)
    leader: Ints  # (T,) id of the acting leader; 0: none
    faults: tuple[FaultEvent, ...]  # those that hit a vehicle of the recording
    thin: Ints  # ticks to draw tracks with
    colours: tuple[Any, ...]

    @property
    def time_s(self) -> Floats:
        """(T,)"""
        return self.recording.time_s

    @property
    def n(self) -> int:
        """Vehicles."""
        return int(self.enu_m.shape[1])

    @property
    def range_share(self) -> RangeShare | None:
        """What trunks leave of a link's range."""
        return range_share(self.mission.sim, self.stand)

    def leads(self, column: int) -> Bools:
        """(T,) vehicle `column` + 1 is the acting leader."""
        return np.asarray(self.leader == column + 1)


def prepare(
    recording: Recording, mission: Mission, faults: Sequence[FaultEvent] = (), folder: Path | None = None
) -> Flight:
    """ValueError as metrics.measure. `folder`: where the mission's stem map is, if it has one."""
    recording = with_columns(recording, mission.swarm.size)
    ticks, n = recording.on_ground.shape
    stand = stand_of(mission, folder)
    return Flight(
        mission=mission,
        stand=stand,
        recording=recording,
        metrics=measure(recording, mission, stand),
        enu_m=recording.pos_ned_m[:, :, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
        phase=swarm_phase(recording).astype(np.intp),
        leader=acting_leader(recording).astype(np.intp),
        faults=tuple(event for event in faults if ticks and max(event.vehicles) <= n),
        thin=np.unique(np.linspace(0, ticks - 1, min(ticks, TRACK_POINTS)).astype(np.intp)),
        colours=colours(n),
    )


def draw_trunks(axes: Axes, stand: Stand, centre_enu_m: tuple[float, float]) -> int:
    """The trunks within the limits of `axes`, whose origin is at `centre_enu_m`: how many. One artist for all."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    trunks = [(t.east_m - centre_enu_m[0], t.north_m - centre_enu_m[1], 2.0 * t.radius_m) for t in stand.trees]
    seen = np.array([t for t in trunks if west < t[0] < east and south < t[1] < north]).reshape(-1, 3)
    if not len(seen):
        return 0
    # The edge, in points, keeps a thin trunk visible on a large map
    edge_pt = 1.6 if len(seen) <= FEW_TRUNKS else 0.6
    axes.add_collection(
        EllipseCollection(
            seen[:, 2],
            seen[:, 2],
            np.zeros(len(seen)),
            units="xy",
            offsets=seen[:, :2],
            offset_transform=axes.transData,
            facecolors=TRUNK,
            edgecolors=TRUNK,
            linewidths=edge_pt,
            zorder=2,
        )
    )
    return len(seen)


def colours(n: int) -> tuple[Any, ...]:
    """One for each of n vehicles: told apart at a glance if they are few, in order along a ramp if many."""
    if n <= len(FEW):
        return FEW[:n]
    ramp = matplotlib.colormaps["viridis"]
    return tuple(ramp(0.93 * k / (n - 1)) for k in range(n))  # its yellow end is lost on white


def link_alpha(count: int) -> float:
    """Opacity for `count` links drawn close together: many make a grey cloud, not a black one."""
    return min(0.45, max(0.035, 20.0 / max(1, count)))


def ink_on(colour: Any) -> str:
    """The colour of text that reads well on `colour`."""
    red, green, blue = to_rgb(colour)
    return "white" if 0.299 * red + 0.587 * green + 0.114 * blue < 0.6 else INK  # luma of ITU-R BT.601


class Labels:
    """Puts texts on one set of axes, each where it covers no other and as little else as possible."""

    def __init__(self, axes: Axes, renderer: RendererAgg, keep_clear: Floats) -> None:
        """`keep_clear` (K, 2): data coordinates of what should stay visible; what repeats weighs more.

        The limits of `axes` must not change any more.
        """
        self._axes = axes
        self._renderer = renderer
        self._points_px = axes.transData.transform(keep_clear) if len(keep_clear) else np.zeros((0, 2))
        self._taken: list[Bbox] = []

    def block(self, box_px: Bbox) -> None:
        """No text here."""
        self._taken.append(box_px)

    def add(self, text: str, at: Sequence[float] | Floats, *, distance_pt: float = 9.0, **style: Any) -> None:
        """`text` near the data coordinates `at`: left out if there is no room at all."""
        label = self._axes.annotate(
            text, (at[0], at[1]), xytext=(0, 0), textcoords="offset points", ha="center", va="center", zorder=9, **style
        )
        label.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8})
        size = label.get_window_extent(self._renderer)
        per_pt = self._axes.figure.dpi / 72.0
        half_w, half_h = size.width / per_pt / 2.0, size.height / per_pt / 2.0
        best: tuple[float, Bbox, tuple[float, float]] | None = None
        for rank, (east, north, far) in enumerate(
            (e, n, f)
            for f in (1.0, 2.2, 3.6, 5.2, 7.0)
            for e, n in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1))
        ):
            shift = (east * (half_w + distance_pt * far), north * (half_h + distance_pt * far))
            box = size.translated(shift[0] * per_pt, shift[1] * per_pt).padded(2.0)
            if any(box.overlaps(other) for other in self._taken) or not _inside(box, self._axes.bbox):
                continue
            covered = np.count_nonzero(
                (self._points_px > (box.x0, box.y0)).all(axis=1) & (self._points_px < (box.x1, box.y1)).all(axis=1)
            )
            cost = float(covered + rank)
            if best is None or cost < best[0]:
                best = (cost, box, shift)
        if best is None:
            label.remove()
            return
        self._taken.append(best[1])
        label.set_position(best[2])


def _inside(box: Bbox, frame: Bbox) -> bool:
    return bool(box.x0 >= frame.x0 and box.x1 <= frame.x1 and box.y0 >= frame.y0 and box.y1 <= frame.y1)
