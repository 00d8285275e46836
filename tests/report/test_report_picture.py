"""The picture of a flight: always there, always the same size, with no text over another."""

from __future__ import annotations

import dataclasses
import itertools
import math
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox
from PIL import Image

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from mission.schema.faults import FaultKind
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.recording import Recorder, Recording
from sim_bridge.judge.report import picture, style
from sim_bridge.judge.report.coverage_panel import coverage_tick, draw_plan, draw_sphere
from sim_bridge.judge.report.map_panel import draw_map
from sim_bridge.judge.report.time_panels import draw_altitude

MAX_BYTES = 300_000
D1, D2 = np.array([0.0, 0.0, 8.0]), np.array([130.0, 0.0, 8.0])


def a_mission(n: int, *, shape: str = "ring", **tables: Any) -> Mission:
    fence = {"altitude_max_m": 60.0, "polygon_enu_m": ((-40.0, -60.0), (180.0, -60.0), (180.0, 60.0), (-40.0, 60.0))}
    d2 = (130.0, 0.0, 30.0) if shape == "sphere" else tuple(D2)
    return Mission.model_validate(
        {
            "schema": 1,
            "route": {"d1_enu_m": tuple(D1), "d2_enu_m": d2, "vel_leader_mps": 3.0},
            "swarm": {"size": n},
            "coverage": {"shape": shape, "radius_m": max(15.0, 1.0 * n if shape == "ring" else 0.45 * n)},
            "fence": fence,
            **tables,
        }
    )


def a_flight(mission: Mission, *, lost_s: float | None = None, dt_s: float = 0.2) -> Recording:
    """Up, across, and around d2; vehicle 1 leads until its companion falls silent, then vehicle 2."""
    n = mission.swarm.size
    d2 = np.array(mission.route.d2_enu_m)
    time_s = np.arange(0.0, 100.0, dt_s)
    turn = 2.0 * math.pi * np.arange(n) / n
    circle = np.stack((np.cos(turn), np.sin(turn), np.zeros(n)), axis=1)
    way = np.clip((time_s - 12.0) / 46.0, 0.0, 1.0)[:, None, None]
    spread = np.clip((time_s - 62.0) / 10.0, 0.0, 1.0)[:, None, None]
    radius_m = mission.coverage.radius_m
    enu = D1 + way * (d2 - D1) + circle * ((1.0 - spread) * 1.1 * max(n, 4) / 4.0 + spread * radius_m)
    if n > 1:
        enu[:, 0] += (1.0 - spread[:, 0]) * -circle[0] * 1.1 * max(n, 4) / 4.0
    enu[:, :, 2] *= np.clip((time_s[:, None] - 1.0) / 5.0, 0.0, 1.0)
    phase = np.select([time_s < 6.0, time_s < 12.0, time_s < 62.0], [0, 1, 2], SwarmPhase.COVERAGE)
    alive = np.ones((len(time_s), n), dtype=np.bool_)
    if lost_s is not None:
        alive[time_s > lost_s, 0] = False
    acting = np.zeros_like(alive)
    acting[time_s > 2.0, 0] = True
    if lost_s is not None:
        acting[time_s > lost_s + 2.0, 1] = True
    full = np.ones_like(alive)
    ground = enu[:, :, 2] <= 0.0
    return Recording(
        time_s=time_s,
        pos_ned_m=enu[:, :, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
        vel_ned_mps=np.zeros_like(enu),
        on_ground=ground,
        armed=full,
        agent_alive=alive,
        touched=np.zeros(alive.shape, np.int8),
        range_m=np.where(full, 55.0, 30.0),
        phase=np.repeat(phase[:, None], n, axis=1).astype(np.int8),
        acting=acting,
        leader=full.astype(np.int16),
    )


def until(recording: Recording, ticks: int) -> Recording:
    return Recording(**{f.name: getattr(recording, f.name)[:ticks] for f in dataclasses.fields(recording)})


def forest() -> dict[str, Any]:
    rng = np.random.default_rng(2)
    trees = [
        {"base_enu_m": (float(e), float(n)), "trunk_radius_m": 0.3, "height_m": 20.0}
        for e, n in zip(rng.uniform(30.0, 100.0, 100), rng.uniform(-50.0, 50.0, 100), strict=True)
    ]
    return {"trees": tuple(trees)}


def looks_right(path: Path) -> None:
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert image.size == (1600, 900)
        levels = np.asarray(image.convert("L"))
    assert levels.min() < 50  # ink
    assert levels.max() == 255  # on white
    assert path.stat().st_size < MAX_BYTES


@pytest.mark.parametrize(("n", "shape"), [(1, "ring"), (12, "ring"), (1, "sphere"), (50, "sphere")])
def test_a_flight_of_any_size_becomes_a_picture(tmp_path: Path, n: int, shape: str) -> None:
    mission = a_mission(n, shape=shape)
    picture.draw(a_flight(mission), mission, tmp_path / "flight.png", title="a flight")
    looks_right(tmp_path / "flight.png")


def test_a_flight_that_lost_its_leader_in_a_forest(tmp_path: Path) -> None:
    mission = a_mission(8, forest=forest())
    picture.draw(a_flight(mission, lost_s=30.0), mission, tmp_path / "flight.png", title="lost")
    looks_right(tmp_path / "flight.png")


def test_a_stand_of_many_trees_is_one_artist_and_what_was_run_into_is_named() -> None:
    route = {"d1_enu_m": (0.0, 0.0, 4.0), "d2_enu_m": (130.0, 0.0, 4.0), "vel_leader_mps": 3.0}
    mission = a_mission(4, route=route, forest={"stand": {"density_per_ha": 400.0}}, sensing={})
    whole = a_flight(mission, lost_s=30.0)
    touched = np.zeros_like(whole.touched)
    touched[whole.time_s > 30.0, 0] = 1
    flight = style.prepare(dataclasses.replace(whole, touched=touched), mission)
    assert len(flight.stand.trees) > 500
    figure = Figure(figsize=(16, 9))
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    draw_map(axes, FigureCanvasAgg(figure).get_renderer(), flight)
    assert len(axes.patches) + len(axes.collections) < 20
    (trunks,) = [artist for artist in axes.collections if isinstance(artist, EllipseCollection)]
    assert len(trunks.get_offsets()) > 500
    assert any(text.get_text().startswith("1 ran into a trunk, 30 s") for text in axes.texts)


@pytest.mark.parametrize(("ticks", "shape"), [(1, "sphere"), (20, "ring")])
def test_a_flight_cut_short(tmp_path: Path, ticks: int, shape: str) -> None:
    mission = a_mission(4, shape=shape)
    picture.draw(until(a_flight(mission), ticks), mission, tmp_path / "flight.png", title="short")
    looks_right(tmp_path / "flight.png")


@pytest.mark.parametrize("shape", ["ring", "sphere"])
def test_a_flight_without_a_tick(tmp_path: Path, shape: str) -> None:
    picture.draw(Recorder().recording(), a_mission(4, shape=shape), tmp_path / "flight.png", title="nothing")
    looks_right(tmp_path / "flight.png")


def test_nobody_left_at_the_end(tmp_path: Path) -> None:
    for shape in ("ring", "sphere"):
        mission = a_mission(3, shape=shape)
        flight = a_flight(mission)
        silent = flight.agent_alive.copy()
        silent[-50:] = False
        picture.draw(dataclasses.replace(flight, agent_alive=silent), mission, tmp_path / "flight.png", title="silent")
        looks_right(tmp_path / "flight.png")


def test_a_title_is_text_and_no_formula(tmp_path: Path) -> None:
    mission = a_mission(1)
    picture.draw(until(a_flight(mission), 3), mission, tmp_path / "flight.png", title="5 $ and 3 $ { a_1^2")
    looks_right(tmp_path / "flight.png")


def test_the_same_flight_makes_the_same_picture_and_leaves_the_style_alone(tmp_path: Path) -> None:
    mission = a_mission(4)
    before = dict(matplotlib.rcParams)
    for name in ("a", "b"):
        picture.draw(a_flight(mission), mission, tmp_path / name, title="a flight")
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert dict(matplotlib.rcParams) == before


def test_a_folder_that_is_not_there_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        picture.draw(Recorder().recording(), a_mission(1), tmp_path / "absent" / "flight.png", title="")


FAULTS = (
    FaultEvent(FaultKind.KILL, (1,), 30.0, asked="kill leader@30"),
    FaultEvent(FaultKind.STOP, (2,), 30.5, 33.5),
    FaultEvent(FaultKind.PARTITION, (2, 1), 60.0, 400.0),
    FaultEvent(FaultKind.LATE, (1,), 0.0, None, 1.5),
)


def test_simulated_faults_are_drawn_on_the_map_and_over_time(tmp_path: Path) -> None:
    mission = a_mission(4)
    recording = a_flight(mission, lost_s=30.0)
    for name, faults in (("with", FAULTS), ("without", ())):
        picture.draw(recording, mission, tmp_path / name, title="faults", faults=faults)
        looks_right(tmp_path / name)
    assert (tmp_path / "with").read_bytes() != (tmp_path / "without").read_bytes()
    flight = style.prepare(recording, mission, FAULTS)
    texts = on_the_map(flight)
    assert {"1 killed, 30 s", "2 stopped, 30 s"} <= set(texts)
    assert "1 lost, 30 s" not in texts
    figure = Figure(figsize=picture.SIZE_IN, dpi=picture.DPI)
    axes = figure.add_axes((0.5, 0.065, 0.435, 0.235))
    draw_altitude(axes, flight)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    names = ("1 late", "1 killed", "2 stopped", "2, 1 cut off")
    boxes = [text.get_window_extent() for text in axes.texts if text.get_text() in names]
    assert len(boxes) == len(names)
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))


@pytest.mark.parametrize("ticks", [0, 1])
def test_faults_of_a_flight_that_has_not_got_there(ticks: int, tmp_path: Path) -> None:
    mission = a_mission(4)
    stranger = FaultEvent(FaultKind.KILL, (5,), 1.0)
    recording = until(a_flight(mission), ticks)
    picture.draw(recording, mission, tmp_path / "flight.png", title="short", faults=(*FAULTS, stranger))
    looks_right(tmp_path / "flight.png")


def on_the_map(flight: style.Flight) -> dict[str, Bbox]:
    """The labels, and where they are."""
    with matplotlib.rc_context(style.RC):
        figure = Figure(figsize=picture.SIZE_IN, dpi=picture.DPI)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.045, 0.385, 0.605, 0.475))
        renderer = canvas.get_renderer()  # type: ignore[no-untyped-call]
        draw_map(axes, renderer, flight)
        canvas.draw()  # type: ignore[no-untyped-call]
        return {text.get_text(): text.get_window_extent(renderer) for text in axes.texts}


@pytest.mark.parametrize("faults", [(), FAULTS], ids=["", "faults"])
@pytest.mark.parametrize("lost_s", [None, 13.0, 57.0])
@pytest.mark.parametrize("n", [2, 12])
def test_labels_on_the_map_do_not_cover_one_another(
    n: int, lost_s: float | None, faults: tuple[FaultEvent, ...]
) -> None:
    mission = a_mission(n, forest=forest())
    boxes = on_the_map(style.prepare(a_flight(mission, lost_s=lost_s), mission, faults))
    assert {"d1", "d2"} <= set(boxes)
    for (one, box), (other, other_box) in itertools.combinations(boxes.items(), 2):
        assert not box.overlaps(other_box), f"{one} over {other}"


def test_the_line_under_the_title_says_how_it_went() -> None:
    mission = a_mission(4)
    whole = style.prepare(a_flight(mission), mission)
    assert "4 vehicles over 130 m" in picture.summary(whole)
    assert "all arrived after" in picture.summary(whole)
    assert "no contacts" in picture.summary(whole)
    assert "coverage gap 90° (ideal 90°)" in picture.summary(whole)
    short = style.prepare(until(a_flight(mission), 100), mission)
    assert "not arrived" in picture.summary(short)
    assert "coverage" not in picture.summary(short)


def test_the_panel_shows_the_end_of_coverage_not_of_the_flight() -> None:
    mission = a_mission(3)
    flight = a_flight(mission)
    phase = flight.phase.copy()
    phase[-100:] = SwarmPhase.LAND
    assert coverage_tick(style.prepare(dataclasses.replace(flight, phase=phase), mission)) == len(flight.time_s) - 101
    assert coverage_tick(style.prepare(until(flight, 10), mission)) == 9
    assert coverage_tick(style.prepare(Recorder().recording(), mission)) is None


@pytest.mark.parametrize("shape", ["ring", "sphere"])
def test_the_panel_tells_the_same_gap_as_the_line_under_the_title(shape: str) -> None:
    """Not that of the last tick, which a vehicle that left its place has changed."""
    mission = a_mission(2, shape=shape)
    whole = a_flight(mission)
    pos_ned_m = whole.pos_ned_m.copy()
    pos_ned_m[-10:, 0, 0] += 40.0
    flight = style.prepare(dataclasses.replace(whole, pos_ned_m=pos_ned_m), mission)
    axes = Figure().add_axes((0.1, 0.1, 0.8, 0.8), projection=None if shape == "ring" else "mollweide")
    (draw_plan if shape == "ring" else draw_sphere)(axes, flight)

    told = f"{flight.metrics.coverage_gap_deg:.0f}°"
    assert f"coverage gap {told} (" in picture.summary(flight)
    (shown,) = [text.get_text() for text in axes.texts if text.get_text().startswith(("gap", "darker"))]
    assert shown.split()[-1] == told


def test_every_vehicle_has_its_own_colour() -> None:
    for n in (1, 9, 10, 100):
        assert len(set(style.colours(n))) == n
    assert style.ink_on("#332288") == "white"
    assert style.ink_on("#88ccee") != "white"
