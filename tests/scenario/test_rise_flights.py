"""Whole flights behind a wall that cuts the radio: what a leader that rises delivers, and what stays without it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from companion.core.agent import TICK_S
from companion.core.model.states import SwarmPhase
from companion.records.record import RecordKind
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.drive.lockstep.lockstep import InProcess
from sim_bridge.judge import run_folder
from tests.bench.forged_records import log_of
from tests.flights import flown, short_mission
from tests.scenario.test_record_flights import bodies_at_base

CEILING_M, TOP_M = 6.0, 24.0


def behind_a_wall(rise_to_m: float | None, **sim: Any) -> Mission:
    """The base station is at d1, 2 m up; the wall, 6 m high, hides all that is low about d2 from it."""
    tables: dict[str, dict[str, Any]] = {
        "route": {"d1_enu_m": (0, 0, 4), "d2_enu_m": (45, 0, 4), "vel_leader_mps": 2.0, "at_end": "land"},
        "coverage": {"radius_m": 8.0, "duration_s": 20.0},
        "swarm": {"size": 2},
        "radio": {"full_range_m": 100.0},
        "fence": {"altitude_max_m": CEILING_M},
        "sensing": {"sensor": "multi-layer", "range_m": 32.0, "rate_hz": 4.0, "stale_s": 0.8},
        "survey": {} if rise_to_m is None else {"rise_to_m": rise_to_m},
        "forest": {
            "boxes": [{"centre_enu_m": (16.0, 0.0), "length_m": 1.0, "width_m": 14.0, "height_m": 6.0}],
        },
        "sim": {"seed": 1, "radio_trunks": "cut", **sim},
    }
    return short_mission(**tables)


class Measures:
    """Each vehicle makes a record a second behind the wall, until it covers the tree."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self, flight: Flight) -> None:
        now_s = flight.world.now_s
        if round(now_s / TICK_S) % 20:
            return
        for companion in flight.lockstep.companions.values():
            assert isinstance(companion, InProcess)
            if companion.endpoint.agent.swarm.phases.phase is SwarmPhase.TRANSIT:
                self.made += 1
                log_of(companion).append(RecordKind.STEM, b"%d" % self.made, now_s)


def count_at_base(folder: Path) -> int:
    return sum(body.isdigit() for body in bodies_at_base(folder))


def test_a_leader_that_rises_delivers_what_stays_behind_the_wall_without_it(tmp_path: Path) -> None:
    delivered, highest_m = {}, {}
    for rise_to_m in (None, TOP_M):
        measures, folder = Measures(), tmp_path / str(rise_to_m)
        outcome, shown = flown(behind_a_wall(rise_to_m), folder, watch=measures)
        delivered[rise_to_m] = count_at_base(folder) / measures.made
        flight = run_folder.load(folder)
        highest_m[rise_to_m] = np.sort((-flight.pos_ned_m[..., 2]).max(axis=0))
        assert outcome.summary["fence_exceeded_m"] == 0.0
        assert ("rise ends: all records delivered" in shown) is (rise_to_m is not None), shown
    assert delivered[None] < 0.8
    assert delivered[TOP_M] == 1.0
    assert highest_m[None][-1] < CEILING_M
    assert 20.0 < highest_m[TOP_M][-1] <= TOP_M
    assert highest_m[TOP_M][-2] < CEILING_M
