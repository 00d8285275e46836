"""Small stands, and a mission that flies in them."""

from __future__ import annotations

from typing import Any

from mission.document.model import Mission
from mission.stand.stand import StandTree


def trunk(east_m: float, north_m: float, radius_m: float = 0.2, base_m: float = 12.0) -> StandTree:
    return StandTree(east_m, north_m, radius_m, 20.0, base_m, 2.0)


def mission_with(forest: Any = None, **changes: Any) -> Mission:
    route = {
        "d1_enu_m": (0.0, 0.0, 4.0),
        "d2_enu_m": (60.0, 0.0, 4.0),
        "vel_leader_mps": 3.0,
        **changes.pop("route", {}),
    }
    base = {"schema": 1, "route": route, "swarm": {"size": 1}, "sensing": {}, "forest": forest or {}}
    base["fence"] = {"altitude_max_m": 10.0}  # below the crowns
    return Mission.model_validate({**base, **changes})
