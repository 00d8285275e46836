"""Ticks for tests."""

from __future__ import annotations

from typing import Any

from sim_bridge.judge.tick import Tick


def a_tick(time_s: float = 0.0, *, n: int = 3, **changes: Any) -> Tick:
    """Of `n` vehicles in a row on the ground, 5 m apart, disarmed, whose companions answer and have said nothing."""
    ids = tuple(range(1, n + 1))
    values: dict[str, Any] = {
        "pos_ned_m": tuple((5.0 * k, 0.0, 0.0) for k in ids),
        "vel_ned_mps": ((0.0, 0.0, 0.0),) * n,
        "on_ground": (True,) * n,
        "armed": (False,) * n,
        "mode": ("HOLD",) * n,
        "range_m": (30.0,) * n,
        "touched": ("",) * n,
        "alive": ids,
        "answered": ids,
        "said": {},
        "said_s": {},
        "frames": {},
        "words": {},
        "north_off_rad": (),
        "asked_ned_mps": (),
    }
    return Tick(time_s=time_s, **(values | changes))
