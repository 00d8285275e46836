"""One row for each vehicle of a flight: way flown, closest approaches, time behind, holds, lost beacons, last words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.judge.export.telemetry import AUTOPILOT, Telemetry
from sim_bridge.judge.metrics.arrival import arrivals_s
from sim_bridge.judge.metrics.pairs import nearest_of_each
from sim_bridge.judge.metrics.trunks import bark_of_each
from sim_bridge.judge.recording import Recording

HOLD = "hold:"  # as companions begin what they say of one


def vehicle_rows(
    recording: Recording,
    mission: Mission,
    stand: Stand,
    reported: Mapping[int, Telemetry],
    beacons_lost: Sequence[float | None],
) -> list[dict[str, Any]]:
    """In the order of ids, as docs/reference/replay.md has them. `beacons_lost`: of each vehicle, 0..1."""
    nearest, bark = nearest_of_each(recording, mission), bark_of_each(recording, stand)
    arrived_s = arrivals_s(recording, mission)
    first_s = min((at_s for at_s in arrived_s if at_s is not None), default=0.0)
    ways_m = _ways_m(recording)
    rows = []
    for k, one in enumerate(reported.values()):
        near_m, near_id, near_s = nearest[k] or (None, None, None)
        bark_m, bark_s = bark[k] or (None, None)
        came_s = arrived_s[k]
        said = [(at_s, text) for at_s, component, _, text in one.texts if component != AUTOPILOT]
        last_s, last = said[-1] if said else (None, "")
        rows.append(
            {
                "id": k + 1,
                "way_m": round(ways_m[k], 1),
                "nearest_m": _rounded(near_m, 2),
                "nearest_id": near_id,
                "nearest_at_s": _rounded(near_s, 2),
                "bark_m": _rounded(bark_m, 2),
                "bark_at_s": _rounded(bark_s, 2),
                "behind_s": None if came_s is None else round(came_s - first_s, 1),
                "holds": sum(text.startswith(HOLD) for _, text in said) if one.texts else None,
                "beacons_lost": beacons_lost[k],
                "battery_pct": one.batteries[-1][1] if one.batteries else None,
                "last_text": last,
                "last_text_s": _rounded(last_s, 2),
            }
        )
    return rows


def _ways_m(recording: Recording) -> list[float]:
    """Of each vehicle, in the air."""
    moved_m = np.linalg.norm(np.diff(recording.pos_ned_m, axis=0), axis=2)
    aloft = ~recording.on_ground[1:]
    return [float(way_m) for way_m in np.where(aloft, moved_m, 0.0).sum(axis=0)]


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
