"""A swarm that flies by ranges, for tests: four vehicles, of which the first has GNSS."""

from __future__ import annotations

from typing import Any

from mission.document.model import Mission
from tests.flights import short_mission

STARTS = [(-4.0, -4.0, 0.0), (4.0, -4.0, 0.0), (-4.0, 4.0, 0.0), (4.0, 4.0, 0.0)]


def ranging_mission(**tables: dict[str, Any]) -> Mission:
    """As `short_mission`."""
    swarm = {"size": 4, "leader_priority": [1], "gnss": "leader"} | tables.pop("swarm", {})
    ranging = {"start_enu_m": STARTS} | tables.pop("ranging", {})
    return short_mission(swarm=swarm, ranging=ranging, **tables)
