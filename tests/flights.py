"""Short missions and flights for the scenario tests."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mission.document.model import Mission
from sim_bridge.drive import fly
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.drive.lockstep.fleet_keys import FleetKeys
from sim_bridge.judge.progress import Progress
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.world import DEFAULT_ORIGIN


def short_mission(**tables: dict[str, Any]) -> Mission:
    """40 m at 2 m/s, low and close to the ground, so that a flight takes about a minute; tables override."""
    values: dict[str, dict[str, Any]] = {
        "route": {"d1_enu_m": (0, 0, 4), "d2_enu_m": (40, 0, 4), "vel_leader_mps": 2.0},
        "coverage": {"duration_s": 15.0, "radius_m": 12.0},
        "swarm": {"size": 4},
        "sim": {"seed": 1},
    }
    for name, changes in tables.items():
        values[name] = {**values.get(name, {}), **changes}
    return Mission.model_validate({"schema": 1, "name": "short", **values}).with_origin(DEFAULT_ORIGIN)


def point_masses(_frame: Any, place: Any, _seed: int) -> PointMass:
    """Airframes without JSBSim: faster, for what does not depend on flight dynamics."""
    return PointMass(place, 0.0, ground_down_m=place[2])


def flown(
    mission: Mission,
    folder: Path,
    *,
    in_process: bool = True,
    point_mass: bool = True,
    watch: Callable[[fly.Flight], None] | None = None,
    programs: Mapping[int, Sequence[str]] = MappingProxyType({}),
    entrant: Entrant = BY_OURS,
    keys: FleetKeys | None = None,
    black_box: bool = False,
) -> tuple[fly.Outcome, str]:
    """The outcome, and what a person saw."""
    folder.mkdir(parents=True, exist_ok=True)
    shown = io.StringIO()
    with Progress(shown) as progress:
        outcome = fly.fly(
            mission,
            folder,
            progress,
            in_process=in_process,
            airframes=point_masses if point_mass else None,
            watch=watch,
            programs=programs,
            entrant=entrant,
            keys=keys,
            black_box=black_box,
        )
    return outcome, shown.getvalue()
