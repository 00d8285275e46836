"""A flight as one document that a page replays: what docs/reference/replay.md describes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from companion.core.model.states import SwarmPhase
from mission import __version__
from mission.check.summary import describe_airtime, summarise
from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.document.load import dump_mission
from mission.document.model import CoverageShape, Mission, RadioTrunks
from mission.stand.stand import Stand, StandTree, stand_of
from sim_bridge.judge.export.flown import rows_at, sampled
from sim_bridge.judge.export.telemetry import Scan, Telemetry, read_telemetry, started_us
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import (
    Bools,
    Floats,
    Metrics,
    acting_leader,
    covers,
    ring_gap_deg,
    sphere_gap_deg,
    swarm_phase,
    with_columns,
    without_cut_links,
)
from sim_bridge.judge.metrics.graph import connectivity
from sim_bridge.judge.metrics.leadership import visits_of
from sim_bridge.judge.metrics.pairs import Pairs, look_at_pairs
from sim_bridge.judge.page.by_vehicle import vehicle_rows
from sim_bridge.judge.page.coding import Series, column, steps, toggles
from sim_bridge.judge.page.events import events
from sim_bridge.judge.page.limits import limits
from sim_bridge.judge.page.names import named
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.run_folder import STAND_REPORT, load_beacons_lost
from sim_bridge.trunk_attenuation import range_share

FORMAT: Final = "understory-replay"
VERSION: Final = 1
RATE_HZ: Final = 10.0
SCANS_HZ: Final = 2.0  # of each vehicle: they are most of a replay among trees
POS_STEP_M: Final = 0.01
ESTIMATE_STEP_M: Final = 0.05  # GLOBAL_POSITION_INT has centimetres of its own
FIX_HELD_S: Final = 1.0  # an estimate that is older is not shown
SILENT_S: Final = 0.35  # beacons come ten times a second or less: their age begins to tell something here
SWARM_STEPS: Final = {"separation_m": 0.01, "lambda2": 0.01, "to_go_m": 0.1, "gap_deg": 0.5}
CROWDED: Final = 100  # vehicles: with more, scans are left out


@dataclass(frozen=True, slots=True)
class Verdict:
    """Verdict on a flight; None: not known."""

    text: str | None
    succeeded: bool | None
    ended: str | None = None


def replay(
    recording: Recording,
    mission: Mission,
    folder: Path,
    *,
    title: str,
    metrics: Metrics,
    verdict: Verdict,
    figures: Mapping[str, Any],
    faults: Sequence[FaultEvent] = (),
    stand: Stand | None = None,
) -> dict[str, Any]:
    """The document. `folder`: where the telemetry logs are, and the stem map, where the mission has one.

    `metrics`: of the whole recording; `figures`: what the page lists.
    """
    recording = with_columns(recording, mission.swarm.size)
    stand = stand_of(mission, folder) if stand is None else stand
    n = recording.on_ground.shape[1]
    start_us = started_us(folder, n)
    reported = {k: read_telemetry(folder / f"vehicle-{k}.tlog", start_us) for k in range(1, n + 1)}
    rows = rows_at(recording.time_s, RATE_HZ) if len(recording.time_s) else np.zeros(0, np.intp)
    shown = sampled(recording, rows)
    pairs = look_at_pairs(shown, mission, range_share(mission.sim, stand))
    pairs = without_cut_links(pairs, shown.time_s, faults)
    connected, lambda2 = connectivity(shown, pairs, np.ones(len(rows), np.bool_))
    happened = events(shown, faults, reported, connected=connected, pairs=pairs, ended=verdict.ended)
    return {
        **head(mission, stand, title),
        "verdict": {"text": verdict.text, "succeeded": verdict.succeeded},
        "limits": [limit.as_dict() for limit in limits(metrics, mission)],
        "figures": (listed := {name: value for name, value in figures.items() if name != "verdict"}),
        "figures_named": [list(pair) for pair in named(listed)],
        **body(shown, mission, pairs, lambda2, reported),
        "events": [event.as_dict() for event in happened],
        **({"stand_report": STAND_REPORT} if (folder / STAND_REPORT).is_file() else {}),
        "by_vehicle": vehicle_rows(recording, mission, stand, reported, load_beacons_lost(folder, n)),
    }


def head(mission: Mission, stand: Stand, title: str) -> dict[str, Any]:
    """Head of a replay: what is known before the flight begins."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"understory {__version__}",
        "title": title,
        "seed": mission.sim.seed,
        "mission": mission_values(mission),
        "needs": describe_airtime(summarise(title, mission)),
        "mission_toml": dump_mission(mission),
        "stand": _stand_values(stand),
    }


def body(
    shown: Recording, mission: Mission, pairs: Pairs, lambda2: Floats, reported: Mapping[int, Telemetry]
) -> dict[str, Any]:
    """Rows of a replay. `pairs`, `lambda2`: of `shown`; `reported`: by vehicle id."""
    values = swarm_values(shown, mission, pairs, lambda2, visits_of(shown))
    coded = {"leader": steps(values["leader"]), "phase": steps(values["phase"])}
    return {
        "time_s": column(shown.time_s, 0.001, 2),
        "swarm": coded | {name: column(values[name], step) for name, step in SWARM_STEPS.items()},
        "vehicles": [_vehicle(shown, k, reported[k], mission) for k in reported],
        "links": [
            [int(a) + 1, int(b) + 1, *changes]
            for a, b, changes in zip(pairs.first, pairs.second, map(toggles, pairs.links.T), strict=True)
            if changes
        ],
    }


def mission_values(mission: Mission) -> dict[str, Any]:
    """The mission as the page draws it."""
    coverage, fence = mission.coverage, mission.fence
    trunks = mission.sim.radio_trunks
    attenuated = 10.0 ** (-mission.sim.radio_trunk_db / 20.0)
    factor = {RadioTrunks.DISC: 1.0, RadioTrunks.CUT: 0.0, RadioTrunks.ATTENUATED: attenuated}[trunks]
    sensing = mission.sensing
    return {
        "places": [{"name": name, "enu_m": list(pos_enu_m)} for name, pos_enu_m in mission.named_places],
        "coverage": {
            "shape": coverage.shape.value,
            "radius_m": coverage.radius_m,
            "centres_enu_m": [list(visit.pos_enu_m) for visit in mission.trees],
        },
        "fence_enu_m": [list(point) for point in fence.polygon_enu_m or ()],
        "origin": None if mission.origin is None else [mission.origin.lat_deg, mission.origin.lon_deg],
        "altitude_m": [fence.altitude_min_m, fence.altitude_max_m],
        "separation_hard_m": mission.separation.hard_m,
        "trunk_attenuation_factor": factor,
        "kept_per_trunk": factor,  # its name until 0.2: read for one version more
        "sensing_range_m": None if sensing is None else sensing.range_m,
    }


def _stand_values(stand: Stand) -> dict[str, Any]:
    boxes = [[[round(metres, 2) for metres in corner] for corner in box.corners()] for box in stand.boxes]
    return {"trees": _trees(stand, stand.trees), "bushes": _trees(stand, stand.bushes), "boxes_enu_m": boxes}


def _trees(stand: Stand, trees: Sequence[StandTree]) -> dict[str, Any]:
    """Positions and sizes, in the order of the stand."""
    values = {
        "east_m": [tree.east_m for tree in trees],
        "north_m": [tree.north_m for tree in trees],
        "ground_up_m": [stand.ground_up_m(tree.east_m, tree.north_m) for tree in trees],
        "radius_m": [tree.radius_m for tree in trees],
        "height_m": [tree.height_m for tree in trees],
        "crown_base_m": [tree.crown_base_m for tree in trees],
        "crown_radius_m": [tree.crown_radius_m for tree in trees],
    }
    return {name: column(np.array(one, dtype=np.float64), 0.01, 0) for name, one in values.items()}


def swarm_values(
    shown: Recording, mission: Mission, pairs: Pairs, lambda2: Floats, visits: NDArray[np.intp]
) -> dict[str, NDArray[Any]]:
    """Figures of all of it over time, (T,) each; nan where there is none. `visits`: (T,) as `visits_of`."""
    leader, phase = acting_leader(shown), swarm_phase(shown)
    visits_ned_m = np.array([enu_to_ned(visit.pos_enu_m) for visit in mission.trees])
    bound_for = visits_ned_m[np.minimum(visits, len(visits_ned_m) - 1)]
    of_leader = shown.pos_ned_m[np.arange(len(leader)), np.maximum(leader, 1) - 1]
    return {
        "leader": leader,
        "phase": phase,
        "separation_m": np.where(np.isfinite(pairs.separation_m), pairs.separation_m, np.nan),
        "lambda2": lambda2,
        "to_go_m": np.where(leader > 0, np.linalg.norm(of_leader - bound_for, axis=1), np.nan),
        "gap_deg": _gaps_deg(shown, mission, bound_for, phase == SwarmPhase.COVERAGE),
    }


def _gaps_deg(shown: Recording, mission: Mission, bound_for: Floats, covering: Bools) -> Floats:
    """(T,) that the covering vehicles leave about the place; nan in other phases, and where it is not d2."""
    gap_of = ring_gap_deg if mission.coverage.shape is CoverageShape.RING else sphere_gap_deg
    on_shape = covers(shown, mission)
    d2 = np.array(enu_to_ned(mission.route.d2_enu_m))
    gaps_deg = np.full(len(shown.time_s), np.nan)
    for row in np.flatnonzero(covering & (bound_for == d2).all(axis=1)):
        gaps_deg[row] = gap_of(shown.pos_ned_m[row, on_shape[row]] - d2)
    return gaps_deg


def _vehicle(shown: Recording, vehicle_id: int, reported: Telemetry, mission: Mission) -> dict[str, Any]:
    at = vehicle_id - 1
    time_s, pos_ned_m = shown.time_s, shown.pos_ned_m[:, at]
    values: dict[str, Any] = {
        "id": vehicle_id,
        "east_m": column(pos_ned_m[:, 1], POS_STEP_M, 2),
        "north_m": column(pos_ned_m[:, 0], POS_STEP_M, 2),
        "up_m": column(-pos_ned_m[:, 2], POS_STEP_M, 2),
        "alive": steps(shown.agent_alive[:, at]),
        "on_ground": steps(shown.on_ground[:, at]),
        "armed": steps(shown.armed[:, at]),
        "acting": steps(shown.acting[:, at]),
        "touched": steps(shown.touched[:, at]),
        "leader": steps(shown.leader[:, at]),
        "phase": steps(shown.phase[:, at]),
        "range_m": steps(shown.range_m[:, at], 0.1),
    }
    if reported.attitudes:
        values["yaw_deg"] = column(np.degrees(reported.attitude_rad(time_s)[:, 2]), 1.0)
    if reported.batteries:
        values["battery_pct"] = column(_held(time_s, reported.batteries, math.inf), 1.0)
    if reported.beacons_s:
        values["beacon_age_s"] = column(_ages_s(time_s, np.array(reported.beacons_s)), 0.1)
    if reported.fixes and mission.origin is not None:
        values["estimate_off"] = _estimate_off(time_s, pos_ned_m, reported, LocalFrame(mission.origin.wgs84))
    if reported.scans and shown.on_ground.shape[1] <= CROWDED:
        values["scans"] = _scans(time_s, reported.scans)
    return values


def _held(time_s: Floats, samples: Sequence[tuple[float, float]], for_s: float) -> Floats:
    """(T,) the last of `samples` by then; nan where it is older than `for_s`, or there is none."""
    at_s, values = np.array([at for at, _ in samples]), np.array([value for _, value in samples], dtype=np.float64)
    last = np.searchsorted(at_s, time_s + 1e-6, side="right") - 1
    known = (last >= 0) & (time_s - at_s[np.maximum(last, 0)] <= for_s)
    held: Floats = np.where(known, values[np.maximum(last, 0)], np.nan)
    return held


def _ages_s(time_s: Floats, sent_s: Floats) -> Floats:
    """(T,) since the vehicle's last beacon; 0 below SILENT_S, nan before the first."""
    last = np.searchsorted(sent_s, time_s + 1e-6, side="right") - 1
    ages_s = time_s - sent_s[np.maximum(last, 0)]
    return np.where(last < 0, np.nan, np.where(ages_s < SILENT_S, 0.0, ages_s))


def _estimate_off(time_s: Floats, pos_ned_m: Floats, reported: Telemetry, frame: LocalFrame) -> dict[str, Series]:
    """Error of the autopilot's estimated position: less the true one at the time of that fix."""
    at_s = np.array([fix[0] for fix in reported.fixes])
    believed = np.array([frame.to_ned(Wgs84(*fix[1:])) for fix in reported.fixes])
    true = np.column_stack([np.interp(at_s, time_s, pos_ned_m[:, axis]) for axis in range(3)])
    off = believed - true
    held = [
        _held(time_s, list(zip(at_s.tolist(), off[:, axis].tolist(), strict=True)), FIX_HELD_S) for axis in range(3)
    ]
    names = (("north_m", 0, 1.0), ("east_m", 1, 1.0), ("up_m", 2, -1.0))
    return {name: column(sign * held[axis], ESTIMATE_STEP_M) for name, axis, sign in names}


def _scans(time_s: Floats, scans: Sequence[tuple[float, Scan]]) -> dict[str, Any]:
    """At most SCANS_HZ of them, of those that have the sectors of the first."""
    first = scans[0][1]
    rows: list[int] = []
    ranges_dm: list[int] = []
    next_s = -math.inf
    for at_s, scan in scans:
        if at_s < next_s or len(scan.ranges_m) != len(first.ranges_m):
            continue
        next_s = at_s + 1.0 / SCANS_HZ - 0.01
        rows.append(int(np.searchsorted(time_s, at_s - 1e-6)))
        ranges_dm += [-1 if math.isnan(r) else 0 if math.isinf(r) else max(1, round(10.0 * r)) for r in scan.ranges_m]
    return {
        "start_deg": round(math.degrees(first.start_rad), 3),
        "step_deg": round(math.degrees(first.step_rad), 3),
        "sectors": len(first.ranges_m),
        "rows": np.diff(rows, prepend=0).tolist(),
        "ranges_dm": ranges_dm,
    }
