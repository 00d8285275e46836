"""A flight in one picture: where it went, how close it got, how high, and how it stood around d2."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from mission.document.model import CoverageShape, Mission
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import tolerance_m
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.report import run_folder
from sim_bridge.judge.report.coverage_panel import draw_plan, draw_sphere, told_gap
from sim_bridge.judge.report.map_panel import draw_map
from sim_bridge.judge.report.style import FAINT, INK, RC, Flight, prepare
from sim_bridge.judge.report.time_panels import draw_altitude, draw_separation

SIZE_IN = (16.0, 9.0)
DPI = 100
MANY = 50  # vehicles whose links and tracks make a file that packs badly


def draw(recording: Recording, mission: Mission, path: Path, *, title: str, faults: Sequence[FaultEvent] = ()) -> None:
    """Write the picture of a flight to `path` as a PNG of 1600 x 900 pixels. `faults`: what happened to it.

    OSError as run_folder.write; ValueError as metrics.measure.
    """
    flight = prepare(recording, mission, faults, path.parent)
    with matplotlib.rc_context(RC):  # whatever the user's own style
        figure = Figure(figsize=SIZE_IN, dpi=DPI, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        figure.text(0.045, 0.955, title, fontsize=19, fontweight="bold", va="center")
        figure.text(0.045, 0.915, summary(flight), fontsize=11.5, color=INK, va="center")
        renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
        draw_map(figure.add_axes((0.045, 0.385, 0.605, 0.475)), renderer, flight)
        draw_separation(figure.add_axes((0.045, 0.065, 0.435, 0.235)), flight)
        draw_altitude(figure.add_axes((0.535, 0.065, 0.435, 0.235)), flight)
        if mission.coverage.shape is CoverageShape.RING:
            draw_plan(figure.add_axes((0.7, 0.385, 0.27, 0.475)), flight)
        else:
            draw_sphere(figure.add_axes((0.69, 0.65, 0.28, 0.2), projection="mollweide"), flight)
            draw_plan(figure.add_axes((0.69, 0.385, 0.28, 0.19)), flight)
        for axes in figure.axes:
            if axes.name == "rectilinear":
                axes.spines[["top", "right"]].set_visible(False)
                axes.tick_params(color=FAINT, length=3)
        canvas.draw()  # type: ignore[no-untyped-call]
        pixels = np.asarray(canvas.buffer_rgba())[:, :, :3]  # type: ignore[no-untyped-call]
    # Six bits a channel, or five: hardly anybody sees the difference, and the file is much smaller
    step = 255.0 / (63.0 if flight.n <= MANY else 31.0)
    packed = io.BytesIO()
    Image.fromarray(np.round(np.round(pixels / step) * step).astype(np.uint8)).save(packed, format="PNG", optimize=True)
    run_folder.write(path, packed.getbuffer())


def summary(flight: Flight) -> str:
    """The flight in a line."""
    metrics = flight.metrics
    parts = [f"{metrics.n} vehicle{'s' * (metrics.n != 1)} over {flight.mission.route.length_m:.0f} m"]
    if metrics.arrival_last_s is not None and metrics.overhead_last is not None:
        parts.append(
            f"all arrived after {metrics.arrival_last_s:.0f} s ({metrics.overhead_last:+.1%} against a straight flight)"
        )
    elif metrics.arrival_leader_s is not None:
        parts.append("the leader arrived, not all others")
    else:
        parts.append("not arrived")
    if metrics.connected_fraction_transit is not None and metrics.n > 1:
        parts.append(f"connected {_share(metrics.connected_fraction_transit)} of transit")
    if metrics.coverage_gap_deg is not None:
        parts.append(f"coverage gap {told_gap(flight)} (ideal {metrics.coverage_gap_ideal_deg:.0f}°)")
    error_m = metrics.coverage_radius_error_m
    if error_m is not None and error_m > tolerance_m(flight.mission):
        parts.append(f"{error_m:.1f} m off the {flight.mission.coverage.shape.value}")
    parts.append(f"{metrics.contacts or 'no'} contact{'s' * (metrics.contacts != 1)}")
    return "   ·   ".join(parts)


def _share(of_one: float) -> str:
    """In percent; 100 only where it is all."""
    return f"{of_one:.0%}" if of_one in (0.0, 1.0) else f"{min(of_one, 0.999):.1%}"
