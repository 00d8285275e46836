"""Messages to viewers of a flight that is under way, worked out of its rows: see docs/reference/live.md."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.document.load import load_mission
from mission.schema.faults import FaultKind
from mission.stand.stand import stand_of
from sim_bridge.judge.export.telemetry import Telemetry
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import with_columns
from sim_bridge.judge.metrics.arrays import Floats
from sim_bridge.judge.metrics.graph import connectivity
from sim_bridge.judge.metrics.leadership import acting_leader, swarm_phase, visits_of
from sim_bridge.judge.metrics.pairs import in_flight, look_at_pairs
from sim_bridge.judge.page.coding import column
from sim_bridge.judge.page.events import Event, elections, phases, reason
from sim_bridge.judge.page.replay import SILENT_S, body, head, swarm_values
from sim_bridge.judge.recording import COLUMNS, Recording, assembled
from sim_bridge.trunk_attenuation import range_share

FLAGS: Final = ("agent_alive", "on_ground", "armed", "acting")
NUMBERS: Final = ("touched", "leader", "phase")


class Feed:
    """One flight. A snapshot of what was, and each row as it comes; `catch_up` before the first of a run of rows."""

    def __init__(self, mission_file: Path, title: str, stems_in: Path) -> None:
        """`stems_in`: the folder with the stem map, if there is one. MissionError, OSError for either."""
        self._title = title
        self._mission = load_mission(mission_file)
        self._stand = stand_of(self._mission, stems_in)
        self._share = range_share(self._mission.sim, self._stand)
        self._flying = np.zeros(self._mission.swarm.size, dtype=np.bool_)
        self._visit, self._leader, self._phase = 0, 0, -1
        self._led: Recording | None = None  # the last row with a leader

    def snapshot(
        self, rows: Sequence[bytes], said: Iterable[Mapping[str, Any]], faults: Iterable[Mapping[str, Any]]
    ) -> dict[str, Any]:
        """The flight so far, as a replay's document. `said`: events that it reported; `faults`: that have begun."""
        decoded = [json.loads(row) for row in rows]
        shown = self._recording(decoded)
        pairs = look_at_pairs(shown, self._mission, self._share)
        _, lambda2 = connectivity(shown, pairs, np.ones(len(decoded), np.bool_))
        silent = {k: Telemetry() for k in range(1, self._mission.swarm.size + 1)}
        happened = [*elections(shown, _events(faults), {}), *phases(shown)]
        document = {
            **head(self._mission, self._stand, self._title),
            "verdict": {"text": None, "succeeded": None},
            "limits": [],
            "figures": {},
            **body(shown, self._mission, pairs, lambda2, silent),
            "events": sorted([*said, *(event.as_dict() for event in happened)], key=lambda event: event["time_s"]),
        }
        for k, vehicle in enumerate(document["vehicles"]):
            for name, step in (("yaw_deg", 1.0), ("beacon_age_s", 0.1)):
                values = [_number(one[name][k]) for one in decoded]
                vehicle[name] = column(np.array(values, dtype=np.float64), step)
        return document

    def catch_up(self, rows: Sequence[bytes]) -> None:
        """As if all of `rows` had been drawn."""
        shown = self._recording([json.loads(row) for row in rows])
        leader, phase = acting_leader(shown), swarm_phase(shown)
        led, known = np.flatnonzero(leader > 0), np.flatnonzero(phase >= 0)
        self._leader = int(leader[led[-1]]) if led.size else 0
        self._phase = int(phase[known[-1]]) if known.size else -1
        self._visit = int(visits_of(shown)[-1]) if led.size else 0
        self._led = self._recording([json.loads(rows[int(led[-1])])]) if led.size else None
        if rows:
            self._flying = in_flight(shown, self._mission)[-1]

    def drawn(self, row: bytes, faults: Iterable[Mapping[str, Any]]) -> tuple[str, list[dict[str, Any]]]:
        """A row as viewers get it, in JSON, and who leads, or which phase began, with it. `faults`: that have begun."""
        decoded = json.loads(row)
        one = self._recording([decoded])
        north_m, east_m, up_m = one.pos_ned_m[0, :, 0], one.pos_ned_m[0, :, 1], -one.pos_ned_m[0, :, 2]
        self._flying = ~one.on_ground[0] & (self._flying | (up_m > self._mission.route.d1_enu_m[2] / 2.0))
        pairs = look_at_pairs(one, self._mission, self._share, flying=self._flying[None])
        _, lambda2 = connectivity(one, pairs, np.ones(1, np.bool_))
        swarm = swarm_values(one, self._mission, pairs, lambda2, np.array([self._bound_for(one)]))
        happened = self._changes(one, int(swarm["leader"][0]), int(swarm["phase"][0]), faults)
        ages_s = [_number(age) for age in decoded["beacon_age_s"]]
        drawn = {
            "time_s": round(float(one.time_s[0]), 3),
            "swarm": {name: _plain(float(values[0]), 3) for name, values in swarm.items()},
            "vehicles": {
                "east_m": _rounded(east_m, 2),
                "north_m": _rounded(north_m, 2),
                "up_m": _rounded(up_m, 2),
                **{name.removeprefix("agent_"): getattr(one, name)[0].astype(int).tolist() for name in FLAGS},
                **{name: getattr(one, name)[0].tolist() for name in NUMBERS},
                "range_m": _rounded(one.range_m[0], 1),
                "yaw_deg": decoded["yaw_deg"],
                "beacon_age_s": [_plain(0.0 if age < SILENT_S else age, 1) for age in ages_s],
            },
            "links": base64.b64encode(np.packbits(pairs.links[0]).tobytes()).decode("ascii"),
        }
        return json.dumps(drawn, separators=(",", ":")), [event.as_dict() for event in happened]

    def _recording(self, decoded: Sequence[Mapping[str, Any]]) -> Recording:
        return with_columns(assembled([one["row"] for one in decoded]), self._mission.swarm.size)

    def _bound_for(self, one: Recording) -> int:
        """Number of the mission's visit that the swarm is bound for, or at."""
        if (one.acting & one.agent_alive).any():
            if self._led is not None:
                both = {name: np.concatenate((getattr(self._led, name), getattr(one, name))) for name in COLUMNS}
                self._visit += int(visits_of(Recording(**both))[-1])
            self._led = one
        return self._visit

    def _changes(self, one: Recording, leader: int, phase: int, faults: Iterable[Mapping[str, Any]]) -> Iterator[Event]:
        time_s = float(one.time_s[0])
        if leader not in (0, self._leader):
            why = reason(one, 0, self._leader, _events(faults), {})
            self._leader = leader
            yield Event(time_s, "lead", (leader,), f"vehicle {leader} leads: {why}")
        if phase not in (-1, self._phase):
            self._phase = phase
            yield Event(time_s, "phase", (), SwarmPhase(phase).name.lower())


def _events(faults: Iterable[Mapping[str, Any]]) -> list[FaultEvent]:
    """FaultEvent of its fields as JSON."""
    return [
        FaultEvent(**{**fault, "kind": FaultKind(fault["kind"]), "vehicles": tuple(fault["vehicles"])})
        for fault in faults
    ]


def _number(value: float | None) -> float:
    return float("nan") if value is None else value


def _plain(value: float, digits: int) -> float | None:
    """As JSON holds it: no NaN."""
    return round(value, digits) if np.isfinite(value) else None


def _rounded(values: Floats, digits: int) -> list[float]:
    found: list[float] = np.round(values, digits).tolist()
    return found
