"""Short flights to measure, and the mission that they fly."""

from __future__ import annotations

from typing import Any

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from sim_bridge.judge.recording import Recording

TRANSIT, COVERAGE = SwarmPhase.TRANSIT, SwarmPhase.COVERAGE
D2 = (100.0, 0.0, 10.0)
TREE = {"base_enu_m": (50.0, 0.0), "trunk_radius_m": 0.3, "height_m": 20.0}


def a_mission(*, n: int = 2, way: dict[str, Any] | None = None, **tables: dict[str, Any]) -> Mission:
    """d1 at the origin's east-north, 10 m up; d2 100 m east; 2 m/s; arrival within 5 m; transit range 30 m."""
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": D2, "vel_leader_mps": 2.0, "arrival_distance_m": 5.0}
    route |= way or {}
    return Mission.model_validate(
        {"schema": 1, "route": route, "swarm": {"size": n}, "radio": {"transit_range_m": 30.0}, **tables}
    )


def a_recording(enu_m: Any, *, dt_s: float = 1.0, **columns: Any) -> Recording:
    """All alive, in the air and in TRANSIT, vehicle 1 leads; `enu_m` (T, n, 3), `columns` broadcast to (T, n)."""
    enu = np.asarray(enu_m, dtype=np.float64)
    ticks, n = enu.shape[:2]
    values: dict[str, Any] = {
        "on_ground": False,
        "armed": True,
        "agent_alive": True,
        "touched": 0,
        "range_m": 30.0,
        "phase": TRANSIT,
        "acting": np.arange(n) == 0,
        "leader": 1,
        **columns,
    }
    types = {"range_m": np.float64, "phase": np.int8, "leader": np.int16, "touched": np.int8}
    full = {k: np.array(np.broadcast_to(v, (ticks, n)), dtype=types.get(k, np.bool_)) for k, v in values.items()}
    return Recording(
        time_s=np.arange(ticks, dtype=np.float64) * dt_s,
        pos_ned_m=enu[:, :, [1, 0, 2]] * np.array([1.0, 1.0, -1.0]),
        vel_ned_mps=np.zeros((ticks, n, 3)),
        **full,
    )


def column(*values: Any) -> np.ndarray[Any, Any]:
    """(T, 1): one value a tick, the same for every vehicle."""
    return np.array(values)[:, None]


def level(*east_m: float, up_m: float = 10.0) -> list[list[float]]:
    """One tick of vehicles in a row from west to east."""
    return [[e, 0.0, up_m] for e in east_m]
