"""What the page's view gets of a flight: the live map's messages (docs/reference/live.md), without arrays."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Sequence
from itertools import combinations, pairwise
from typing import Any, Final

from companion.core.model.states import SwarmPhase
from docs.website.world.flight import PageFlight
from mission import __version__
from mission.check.summary import describe_airtime, summarise
from mission.common.frames import Vec3, enu_to_ned
from mission.document.load import dump_mission
from mission.stand.stand import Stand, StandTree
from sim_bridge.judge.page.replay import FORMAT, SWARM_STEPS, VERSION, mission_values
from sim_bridge.judge.recording import Recorder
from sim_bridge.judge.tick import OBSTACLES
from sim_bridge.trunk_attenuation import range_share

LIVE_FORMAT: Final = "understory-live"
STEPPED: Final = ("alive", "on_ground", "armed", "acting", "touched", "leader", "phase", "range_m")
COLUMNS: Final = {"east_m": 0.01, "north_m": 0.01, "up_m": 0.01, "yaw_deg": 0.1, "beacon_age_s": 0.1}  # their steps
TREE_STEP_M: Final = 0.01
SILENT_S: Final = 0.35  # as the replay's


class Feed:
    """One flight's: `first`, then a `row` and `events` for each tick that is drawn."""

    def __init__(self, flight: PageFlight, title: str) -> None:
        self._flight = flight
        self._title = title
        self._share = range_share(flight.mission.sim, flight.stand)
        self._recorder = Recorder()
        self._flying: frozenset[int] = frozenset()
        self._leader, self._phase = 0, -1
        self._touched: set[int] = set()
        self.least_separation_m = math.inf

    def first(self, controls: Sequence[str], pace: dict[str, Any]) -> dict[str, Any]:
        """The first message: all that does not change, and how things stand."""
        flight = self._flight
        mission = flight.mission
        row = self.row()
        swarm, of_each = row["swarm"], row["vehicles"]
        vehicles = [
            {
                "id": k,
                **{name: _column(of_each[name][at], step) for name, step in COLUMNS.items()},
                **{name: _steps(of_each[name][at]) for name in STEPPED},
            }
            for at, k in enumerate(flight.world.vehicles)
        ]
        replay = {
            "format": FORMAT,
            "version": VERSION,
            "made_by": f"understory {__version__}",
            "title": self._title,
            "seed": mission.sim.seed,
            "mission": mission_values(mission),
            "needs": describe_airtime(summarise(self._title, mission)),
            "mission_toml": dump_mission(mission),
            "stand": stand_values(flight.stand),
            "verdict": {"text": None, "succeeded": None},
            "limits": [],
            "figures": {},
            "time_s": _column(row["time_s"], 0.001),
            "swarm": {
                **{name: _steps(swarm[name]) for name in ("leader", "phase")},
                **{name: _column(swarm[name], step) for name, step in SWARM_STEPS.items()},
            },
            "vehicles": vehicles,
            "links": [],
            "events": [],
        }
        return {"format": LIVE_FORMAT, "version": 1, "replay": replay, "controls": list(controls), "pace": pace}

    def row(self) -> dict[str, Any]:
        """The last tick."""
        flight, tick = self._flight, self._flight.last
        mission = flight.mission
        _, _, _, on_ground, armed, answered, touched, ranges_m, phases, acting, leaders = self._recorder.row(tick)
        high_m = mission.route.d1_enu_m[2] / 2.0
        places = tick.pos_ned_m
        self._flying = frozenset(
            k
            for k, (place, down) in enumerate(zip(places, on_ground, strict=True))
            if not down and (k in self._flying or -place[2] > high_m)
        )
        separation_m = _separation_m(places, self._flying)
        self.least_separation_m = min(self.least_separation_m, separation_m)
        ages_s = [tick.time_s - tick.said_s.get(k, tick.time_s) for k in flight.world.vehicles]
        yaws = [vehicle.airframe.state.attitude_rad[2] for vehicle in flight.world.vehicles.values()]
        return {
            "time_s": round(tick.time_s, 3),
            "swarm": self._swarm(separation_m),
            "vehicles": {
                "east_m": [round(place[1], 2) for place in places],
                "north_m": [round(place[0], 2) for place in places],
                "up_m": [round(-place[2], 2) for place in places],
                "alive": _flags(answered),
                "on_ground": _flags(on_ground),
                "armed": _flags(armed),
                "acting": _flags(acting),
                "touched": touched,
                "leader": leaders,
                "phase": [int(phase) for phase in phases],
                "range_m": [round(range_m, 1) for range_m in ranges_m],
                "yaw_deg": [round(math.degrees(yaw), 1) for yaw in yaws],
                "beacon_age_s": [0.0 if age_s < SILENT_S else round(age_s, 1) for age_s in ages_s],
            },
            "links": self._links(answered, on_ground, ranges_m),
        }

    def events(self) -> list[dict[str, Any]]:
        """What happened since they were asked for last."""
        flight, tick = self._flight, self._flight.last
        found = []
        leader, phase = flight.leader or 0, int(flight.phase)
        if leader not in (0, self._leader):
            found.append(_event(tick.time_s, "lead", [leader], f"vehicle {leader} leads"))
            self._leader = leader
        if phase != self._phase:
            self._phase = phase
            found.append(_event(tick.time_s, "phase", [], SwarmPhase(phase).name.lower()))
        for k, what in enumerate(tick.touched, start=1):
            if what and k not in self._touched:
                self._touched.add(k)
                found.append(_event(tick.time_s, "contact", [k], f"vehicle {k} has run into {OBSTACLES[what]}"))
        return found

    @property
    def touched(self) -> int:
        """How many vehicles have run into something."""
        return len(self._touched)

    def _swarm(self, separation_m: float) -> dict[str, Any]:
        flight = self._flight
        leader, mission = flight.leader, flight.mission
        d2 = enu_to_ned(mission.route.d2_enu_m)
        to_go_m = None if leader is None else round(math.dist(flight.last.pos_ned_m[leader - 1], d2), 3)
        return {
            "leader": leader or 0,
            "phase": int(flight.phase),
            "separation_m": None if math.isinf(separation_m) else round(separation_m, 3),
            "lambda2": None,  # eigenvalues want arrays
            "to_go_m": to_go_m,
            "gap_deg": round(self._gap_deg(d2), 3) if flight.phase is SwarmPhase.COVERAGE else None,
        }

    def _gap_deg(self, d2_ned_m: Vec3) -> float:
        """The largest angle at d2 between neighbours on the ring."""
        places = [self._flight.last.pos_ned_m[k - 1] for k in self._flight.last.alive]
        turns = sorted(math.degrees(math.atan2(e - d2_ned_m[1], n - d2_ned_m[0])) for n, e, _ in places)
        return max((b - a for a, b in pairwise([*turns, turns[0] + 360.0])), default=360.0) if turns else 360.0

    def _links(self, answered: Sequence[bool], on_ground: Sequence[bool], ranges_m: Sequence[float]) -> str:
        places = self._flight.last.pos_ned_m
        able = [is_alive and not down for is_alive, down in zip(answered, on_ground, strict=True)]
        bits = [
            able[a] and able[b] and self._is_linked(places[a], places[b], min(ranges_m[a], ranges_m[b]))
            for a, b in combinations(range(len(places)), 2)
        ]
        padded = bits + [False] * (-len(bits) % 8)
        packed = bytes(sum(bit << 7 - at for at, bit in enumerate(padded[k : k + 8])) for k in range(0, len(padded), 8))
        return base64.b64encode(packed).decode("ascii")

    def _is_linked(self, a: Vec3, b: Vec3, range_m: float) -> bool:
        return math.dist(a, b) <= range_m * (1.0 if self._share is None else self._share(a, b))


def stand_values(stand: Stand) -> dict[str, Any]:
    """The stand as a replay has it."""
    boxes = [[[round(metres, 2) for metres in corner] for corner in box.corners()] for box in stand.boxes]
    return {"trees": _trees(stand, stand.trees), "bushes": _trees(stand, stand.bushes), "boxes_enu_m": boxes}


def _trees(stand: Stand, trees: Sequence[StandTree]) -> dict[str, Any]:
    values: dict[str, Callable[[StandTree], float]] = {
        "east_m": lambda tree: tree.east_m,
        "north_m": lambda tree: tree.north_m,
        "ground_up_m": lambda tree: stand.ground_up_m(tree.east_m, tree.north_m),
        "radius_m": lambda tree: tree.radius_m,
        "height_m": lambda tree: tree.height_m,
        "crown_base_m": lambda tree: tree.crown_base_m,
        "crown_radius_m": lambda tree: tree.crown_radius_m,
    }
    return {
        name: {"step": TREE_STEP_M, "order": 0, "is": [round(value(tree) / TREE_STEP_M) for tree in trees]}
        for name, value in values.items()
    }


def _column(value: float | None, step: float) -> dict[str, Any]:
    """Of one row, as a replay has it (docs/reference/replay.md)."""
    if value is None:
        return {"step": step, "order": 0, "is": [0], "gaps": [0, 1]}
    return {"step": step, "order": 0, "is": [round(value / step)]}


def _steps(value: float) -> dict[str, Any]:
    return {"step": 1.0, "rows": [0], "is": [value]}


def _flags(values: Sequence[bool]) -> list[int]:
    return [int(value) for value in values]


def _event(time_s: float, kind: str, vehicles: list[int], text: str) -> dict[str, Any]:
    return {"time_s": round(time_s, 2), "kind": kind, "vehicles": vehicles, "text": text}


def _separation_m(places: Sequence[Vec3], flying: frozenset[int]) -> float:
    """Least distance between two in flight; inf: fewer than two."""
    up = [places[k] for k in sorted(flying)]
    return min((math.dist(a, b) for a, b in combinations(up, 2)), default=math.inf)
