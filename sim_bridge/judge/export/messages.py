"""Messages of an MCAP file, in Foxglove's frames: ENU metres about the mission's origin
(`map`), and each vehicle's own, x ahead, y left, z up (`vehicle_K`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import numpy as np

from companion.core.model.states import SwarmPhase
from companion.mavlink import dialect
from mission.common.frames import Vec3, enu_to_ned
from sim_bridge.judge.export import foxglove
from sim_bridge.judge.export.axes import quaternions_enu, to_enu
from sim_bridge.judge.export.flown import Flown, sampled
from sim_bridge.judge.export.telemetry import AUTOPILOT, Scan
from sim_bridge.judge.metrics.leadership import acting_leader, swarm_phase
from sim_bridge.judge.metrics.pairs import look_at_pairs
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.trunk_attenuation import range_share

RATE_HZ: Final = 10.0  # of what comes from the recording; telemetry comes as it was logged
MAP: Final = "map"
LEVELS: Final = (5, 5, 5, 4, 3, 2, 2, 1)  # foxglove.LogLevel by MAV_SEVERITY
Color = tuple[float, float, float, float]
TRUNK: Final[Color] = (0.48, 0.32, 0.19, 1.0)
CROWN: Final[Color] = (0.07, 0.47, 0.2, 0.12)
LINK: Final[Color] = (0.4, 0.45, 0.5, 0.5)
SETPOINT: Final[Color] = (0.85, 0.5, 0.1, 1.0)
LEADER: Final[Color] = (0.8, 0.1, 0.15, 1.0)
FOLLOWER: Final[Color] = (0.2, 0.35, 0.75, 1.0)
SILENT: Final[Color] = (0.55, 0.55, 0.55, 1.0)
PLACE: Final[Color] = (0.1, 0.1, 0.1, 1.0)
VEHICLE_M: Final = 0.7  # across, from tip to tip
STILL: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


class Message(NamedTuple):
    """One message of a topic. `time_ns`: Unix time."""

    time_ns: int
    topic: str
    schema: str
    body: dict[str, Any]


def messages(flight: Flown) -> Iterator[Message]:
    """All of `flight`, each topic in the order of time."""
    clock = _Clock(flight)
    yield Message(clock.ns(0.0), "/forest", foxglove.SCENE, _forest(flight, clock.stamp(0.0)))
    yield from _swarm(flight, clock)
    for vehicle_id, telemetry in flight.telemetry.items():
        frame = f"vehicle_{vehicle_id}"
        for time_s, lat_deg, lon_deg, alt_m in telemetry.fixes:
            body = {
                "timestamp": clock.stamp(time_s),
                "frame_id": frame,
                "latitude": lat_deg,
                "longitude": lon_deg,
                "altitude": alt_m,
                "position_covariance": [0.0] * 9,
                "position_covariance_type": 0,
            }
            yield Message(clock.ns(time_s), f"/{frame}/fix", foxglove.FIX, body)
        for time_s, scan in telemetry.scans:
            yield Message(clock.ns(time_s), f"/{frame}/scan", foxglove.SCAN, _scan(scan, frame, clock.stamp(time_s)))
    yield from _log(flight, clock)


class _Clock:
    """From the recording's seconds to Unix time."""

    def __init__(self, flight: Flown) -> None:
        self._start_us = flight.start_us

    def ns(self, time_s: float) -> int:
        return (self._start_us + round(time_s * 1e6)) * 1000

    def stamp(self, time_s: float) -> dict[str, int]:
        seconds, nanoseconds = divmod(self.ns(time_s), 1_000_000_000)
        return {"sec": seconds, "nsec": nanoseconds}


def _swarm(flight: Flown, clock: _Clock) -> Iterator[Message]:
    """Poses, links, setpoints, roles and phases, from the recording, at RATE_HZ."""
    rows = flight.rows(RATE_HZ)
    recording = sampled(flight.recording, rows)
    time_s, n = recording.time_s, len(flight.ids)
    logs = [flight.telemetry[k] for k in flight.ids]
    turns = np.stack([quaternions_enu(one.attitude_rad(time_s)) for one in logs], axis=1).round(5).tolist()
    asked = to_enu(np.stack([one.setpoints_ned_mps(time_s) for one in logs], axis=1))
    positions, velocities = to_enu(recording.pos_ned_m), to_enu(recording.vel_ned_mps)
    pairs = look_at_pairs(recording, flight.mission, range_share(flight.mission.sim, flight.stand))
    leaders, phases = acting_leader(recording), swarm_phase(recording)
    names = [f"vehicle_{k}" for k in flight.ids]
    for row in range(len(time_s)):
        at_s = float(time_s[row])
        stamp, time_ns = clock.stamp(at_s), clock.ns(at_s)
        here = [_vector(position) for position in positions[row].round(4).tolist()]
        transforms = [
            {
                "timestamp": stamp,
                "parent_frame_id": MAP,
                "child_frame_id": names[k],
                "translation": here[k],
                "rotation": dict(zip("xyzw", turns[row][k], strict=True)),
            }
            for k in range(n)
        ]
        yield Message(time_ns, "/tf", foxglove.TF, {"transforms": transforms})
        linked = np.flatnonzero(pairs.links[row])
        links = [here[k] for pair in linked for k in (pairs.first[pair], pairs.second[pair])]
        ends = (positions[row] + asked[row]).round(3)
        arrows = [point for k in range(n) if np.isfinite(ends[k, 0]) for point in (here[k], _vector(ends[k].tolist()))]
        lines = [_lines(links, LINK, 1.5), _lines(arrows, SETPOINT, 3.0)]
        alive, acting = recording.agent_alive[row].tolist(), recording.acting[row].tolist()
        spheres = [
            {
                "pose": {"position": here[k], "orientation": STILL},
                "size": {"x": VEHICLE_M, "y": VEHICLE_M, "z": 0.25},
                "color": _color(SILENT if not alive[k] else LEADER if acting[k] else FOLLOWER),
            }
            for k in range(n)
        ]
        entity = _entity("swarm", stamp, lines=lines, spheres=spheres)
        yield Message(time_ns, "/swarm/scene", foxglove.SCENE, {"deletions": [], "entities": [entity]})
        state = {
            "timestamp": stamp,
            "phase": _phase(int(phases[row])),
            "leader": int(leaders[row]),  # 0: none
            "links": len(linked),
            "vehicles": [
                {
                    "id": k + 1,
                    "role": "silent" if not alive[k] else "leader" if acting[k] else "follower",
                    "leader": int(recording.leader[row, k]),
                    "phase": _phase(int(recording.phase[row, k])),
                    "armed": bool(recording.armed[row, k]),
                    "on_ground": bool(recording.on_ground[row, k]),
                    "alive": alive[k],
                    "touched": TOUCHED[recording.touched[row, k]],
                    "range_m": float(recording.range_m[row, k]),
                    "velocity_enu_mps": _vector(velocities[row, k].round(4).tolist()),
                    "setpoint_enu_mps": (
                        _vector(asked[row, k].round(4).tolist()) if np.isfinite(asked[row, k, 0]) else None
                    ),
                }
                for k in range(n)
            ],
        }
        yield Message(time_ns, "/swarm/state", foxglove.SWARM, state)


def _log(flight: Flown, clock: _Clock) -> Iterator[Message]:
    """Texts of companions and autopilots, and simulated faults."""
    lines: list[tuple[float, int, str, str]] = []
    for vehicle_id, telemetry in flight.telemetry.items():
        for time_s, component, severity, text in telemetry.texts:
            who = "autopilot" if component == AUTOPILOT else "companion"
            lines.append((time_s, LEVELS[min(max(severity, 0), 7)], f"vehicle {vehicle_id} {who}", text))
    for fault in flight.faults:
        warning = LEVELS[dialect.MAV_SEVERITY_WARNING]
        lines.append((fault.at_s, warning, "simulator", fault.begins()))
        if fault.until_s is not None:
            lines.append((fault.until_s, warning, "simulator", fault.ends()))
    for time_s, level, name, text in sorted(lines, key=lambda line: line[0]):
        body = {"timestamp": clock.stamp(time_s), "level": level, "message": text, "name": name, "file": "", "line": 0}
        yield Message(clock.ns(time_s), "/log", foxglove.LOG, body)


def _forest(flight: Flown, stamp: dict[str, int]) -> dict[str, Any]:
    """Trunks, crowns, places and fence: they do not change."""
    stand, mission = flight.stand, flight.mission
    trunks, crowns = [], []
    for tree in stand.trees:
        ground_m = stand.ground_up_m(tree.east_m, tree.north_m)
        trunks.append(_cylinder(tree.east_m, tree.north_m, ground_m, ground_m + tree.height_m, tree.radius_m, TRUNK))
        if tree.height_m > tree.crown_base_m:
            low_m, high_m = ground_m + tree.crown_base_m, ground_m + tree.height_m
            crowns.append(_cylinder(tree.east_m, tree.north_m, low_m, high_m, tree.crown_radius_m, CROWN))
    texts = [
        {
            "pose": {"position": _vector(enu_to_ned(flight.frame.to_ned(position))), "orientation": STILL},
            "billboard": True,
            "font_size": 14.0,
            "scale_invariant": True,
            "color": _color(PLACE),
            "text": name,
        }
        for name, position in flight.route_points()
    ]
    fence = mission.fence.polygon_enu_m or ()
    ring = [_vector((east_m, north_m, stand.ground_up_m(east_m, north_m))) for east_m, north_m in fence]
    entities = [
        _entity("trunks", stamp, cylinders=trunks),
        _entity("crowns", stamp, cylinders=crowns),
        _entity("mission", stamp, texts=texts, lines=[{**_lines(ring, PLACE, 1.0), "type": 1}]),
    ]
    return {"deletions": [], "entities": entities}


def _scan(scan: Scan, frame: str, stamp: dict[str, int]) -> dict[str, Any]:
    """Its sectors run clockwise: Foxglove's angles fall. 0: nothing seen there, or not measured; JSON has no inf."""
    start_rad = -scan.start_rad
    return {
        "timestamp": stamp,
        "frame_id": frame,
        "pose": {"position": _vector((0.0, 0.0, 0.0)), "orientation": STILL},
        "start_angle": round(start_rad, 6),
        "end_angle": round(start_rad - (len(scan.ranges_m) - 1) * scan.step_rad, 6),
        "ranges": [range_m if math.isfinite(range_m) else 0.0 for range_m in scan.ranges_m],
        "intensities": [],
    }


def _phase(phase: int) -> str:
    return SwarmPhase(phase).name.lower() if phase >= 0 else ""


def _vector(values: Vec3 | list[float]) -> dict[str, float]:
    return {"x": values[0], "y": values[1], "z": values[2]}


def _color(color: Color) -> dict[str, float]:
    return dict(zip("rgba", color, strict=True))


def _entity(name: str, stamp: dict[str, int], **primitives: list[Any]) -> dict[str, Any]:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": stamp,
        "frame_id": MAP,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **{kind: primitives.get(kind, []) for kind in kinds},
    }


def _lines(points: list[dict[str, float]], color: Color, thickness_px: float) -> dict[str, Any]:
    """Between each two of the points."""
    return {
        "type": 2,  # LINE_LIST
        "pose": {"position": _vector((0.0, 0.0, 0.0)), "orientation": STILL},
        "thickness": thickness_px,
        "scale_invariant": True,
        "points": points,
        "color": _color(color),
        "colors": [],
        "indices": [],
    }


def _cylinder(
    east_m: float, north_m: float, low_m: float, high_m: float, radius_m: float, color: Color
) -> dict[str, Any]:
    return {
        "pose": {"position": _vector((east_m, north_m, round((low_m + high_m) / 2.0, 3))), "orientation": STILL},
        "size": {"x": 2.0 * radius_m, "y": 2.0 * radius_m, "z": round(high_m - low_m, 3)},
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": _color(color),
    }
