"""What a re-election in flight costs: eight vehicles on JSBSim, of which the first to lead has a small battery."""

from __future__ import annotations

import io
import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from companion.core.model.states import SwarmPhase
from mission.common.frames import enu_to_ned
from mission.document.load import load_mission
from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.judge.progress import Progress
from sim_bridge.world.world import DEFAULT_ORIGIN

LONE_TREE = Path("mission/examples/lone_tree.toml")
TERM_S = 10.0
SMALL_MAH = {1: 500.0}  # vehicle 1 leads first; two steps of 10 % below the others in mid-transit


@dataclass
class Watched:
    """One flight."""

    figures: dict[str, Any] = field(default_factory=dict)
    leaders: list[int] = field(default_factory=list)  # one after the other
    phases: list[SwarmPhase] = field(default_factory=list)  # at each change
    farther_m: float = 0.0  # that the new leaders had to go than the old ones, at the changes
    not_one_ticks: int = 0  # since somebody first acted: ticks in which not exactly one does, by the beacons

    def __call__(self, flight: fly.Flight) -> None:
        """Each tick."""
        heard = flight.last.said
        acting = [k for k in flight.world.vehicles if k in heard and heard[k].acting_leader == k]
        if self.leaders:
            self.not_one_ticks += len(acting) != 1
        if len(acting) != 1 or acting == self.leaders[-1:]:
            return
        if self.leaders:
            places, d2_ned_m = flight.world.positions(), enu_to_ned(flight.mission.route.d2_enu_m)
            before_m, after_m = (math.dist(places[k], d2_ned_m) for k in (self.leaders[-1], acting[0]))
            self.farther_m += after_m - before_m
            self.phases.append(flight.phase())
        self.leaders += acting


def watched(seed: int, *, term_s: float, battery_mah: dict[int, float]) -> Watched:
    """The flight to the lone tree."""
    plain = load_mission(LONE_TREE).with_size(8).with_seed(seed).with_origin(DEFAULT_ORIGIN)
    values = plain.model_dump(by_alias=True)
    values["swarm"]["reelection_period_s"] = term_s
    values["sim"]["battery_mah"] = battery_mah
    found = Watched()
    with tempfile.TemporaryDirectory() as folder, Progress(io.StringIO()) as progress:
        mission = Mission.model_validate(values)
        found.figures = fly.fly(mission, Path(folder), progress, in_process=True, watch=found).summary
    return found
