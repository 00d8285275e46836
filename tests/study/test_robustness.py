"""The benchmark of robustness: what it flies is a mission, and what must not be is told."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from companion.core.model.states import SwarmPhase
from sim_bridge.judge.recording import COLUMNS, Recording
from tests.bench.robustness import ROBUSTNESS, Flown, counted, mission, off_the_line, rows

FINE = Flown(
    contacts=0,
    separation_m=5.6,
    ended="all landed but 3",
    verdict="ARRIVED without 3",
    arrived=True,
    safe=True,
    right=True,
    level_m=0.2,
    height_m=0.1,
    held_s=0.4,
    said_s=0.45,
    said="holding: positions are late",
    steered_s=0.0,
)


def failed(name: str, **changes: Any) -> list[str]:
    """Which rows are not reached when one flight of two is not fine."""
    flights = [FINE, dataclasses.replace(FINE, **changes)]
    return [row.what.split(": ")[-1] for row in rows("some", ROBUSTNESS[name], flights) if not row.reached]


@pytest.mark.parametrize("name", ROBUSTNESS)
def test_each_kind_is_a_mission_in_each_of_its_sizes(name: str) -> None:
    kind = ROBUSTNESS[name]
    for n in kind.sizes:
        flies = mission(kind, n, 3)
        assert (flies.swarm.size, flies.sim.seed, len(flies.sim.faults)) == (n, 3, len(kind.faults(n)))


@pytest.mark.parametrize("name", ROBUSTNESS)
def test_what_is_fine_is_reached(name: str) -> None:
    assert failed(name) == []


@pytest.mark.parametrize(
    ("name", "changes", "row"),
    [
        ("partition", {"contacts": 1}, "contacts"),
        ("partition", {"separation_m": 4.9}, "- separation"),
        ("partition", {"safe": False}, "- on the ground, or holding"),
        ("partition", {"right": False}, "- verdict"),
        ("kill-at-departure-return", {"verdict": "UNSAFE without 3: 1 contact"}, "- verdict"),
        ("bias", {"separation_m": 4.4}, "- separation"),
        ("bias", {"height_m": 1.1}, "- leader's height off the line"),
        ("bias", {"level_m": 1.1}, "- leader's track off the line"),
        ("bias", {"arrived": False}, "- arrive"),
        ("late-telemetry", {"held_s": 0.55}, "- holds after"),
        ("late-telemetry", {"said_s": math.inf}, "- says so after"),
        ("late-telemetry", {"steered_s": 0.05}, "- steers on meanwhile"),
    ],
)
def test_one_flight_that_is_not_fine_is_told(name: str, changes: dict[str, Any], row: str) -> None:
    assert failed(name, **changes) == [row]


def test_like_words_are_counted_together() -> None:
    assert counted(iter(["a", "b", "b"])) == "2 x b / 1 x a"


def recorded(places_ned_m: list[tuple[float, float, float]], phase: SwarmPhase) -> Recording:
    """One vehicle that leads."""
    ticks = len(places_ned_m)
    columns = {name: np.zeros((ticks, 1), dtype) for name, dtype in COLUMNS.items()}
    columns |= {"time_s": np.arange(float(ticks)), "vel_ned_mps": np.zeros((ticks, 1, 3))}
    columns["pos_ned_m"] = np.array(places_ned_m)[:, None, :]
    columns |= {name: np.ones((ticks, 1), bool) for name in ("agent_alive", "acting")}
    columns["phase"] = np.full((ticks, 1), phase, np.int8)
    return Recording(**columns)


def test_the_leaders_way_is_compared_with_the_line_once_it_is_under_way() -> None:
    """d1 to d2 goes 60 m east at 8 m."""
    flies = mission(ROBUSTNESS["bias"], 8, 1)
    places = [(3.0, 5.0, -8.0), (0.0, 20.0, -8.0), (-0.4, 30.0, -8.0), (0.3, 40.0, -7.3)]

    assert off_the_line(recorded(places, SwarmPhase.TRANSIT), flies) == pytest.approx((0.4, 0.7))
    assert off_the_line(recorded(places, SwarmPhase.COVERAGE), flies) == (math.inf, math.inf)
