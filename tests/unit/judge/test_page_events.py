"""Events of a page: who came close to whom, as the figures have it."""

from __future__ import annotations

from typing import Any

from mission.document.model import Mission
from sim_bridge.judge.metrics import measure
from sim_bridge.judge.metrics.pairs import look_at_pairs
from sim_bridge.judge.page.events import Event, events
from tests.unit.judge.metrics_kit import a_mission, a_recording


def close(enu_m: Any, mission: Mission) -> list[Event]:
    recording = a_recording(enu_m)
    found = events(
        recording,
        (),
        {},
        connected=recording.on_ground[:, 0],
        pairs=look_at_pairs(recording, mission),
        ended=None,
    )
    kinds = [event for event in found if event.kind in ("contact", "closest")]
    assert len([event for event in kinds if event.kind == "contact"]) == measure(recording, mission).contacts
    return kinds


def test_the_closest_pair_is_the_one_whose_distance_is_told() -> None:
    """3 and 4 are nearer to each other, but on their way up."""
    places = [[[0.0, 0.0, 10.0], [6.0, 0.0, 10.0], [50.0, 0.0, 1.0], [53.0, 0.0, 1.0]]] * 3
    [event] = close(places, a_mission(n=4))
    assert (event.vehicles, event.text) == ((1, 2), "closest of the flight: 1 and 2, 6.0 m apart")


def test_one_above_another_in_layers_of_height_does_not_touch_it() -> None:
    layers = a_mission(
        n=2,
        separation={"height_layers": True},
        sensing={"range_m": 8.0, "rate_hz": 10.0, "stale_s": 0.3},
        sim={"range_finder": True},
        fence={"altitude_min_m": 2.0, "altitude_max_m": 20.0},
    )
    places = [[[0.0, 0.0, 10.0], [0.3 + east_m, 0.0, 11.4]] for east_m in (8.0, 0.0, 8.0)]
    [event] = close(places, layers)
    assert (event.kind, event.vehicles, event.time_s) == ("closest", (1, 2), 1.0)


def test_each_contact_is_told_with_its_pair() -> None:
    apart, touching = [[0.0, 0.0, 10.0], [6.0, 0.0, 10.0]], [[0.0, 0.0, 10.0], [0.5, 0.0, 10.0]]
    found = close([apart, touching, touching, apart, touching], a_mission(n=2))
    assert [(event.time_s, event.text) for event in found if event.kind == "contact"] == [
        (1.0, "vehicles 1 and 2 touch"),
        (4.0, "vehicles 1 and 2 touch"),
    ]
