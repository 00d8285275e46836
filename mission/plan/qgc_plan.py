"""QGroundControl's .plan files: a mission's route and fence out, and in again.

The file format: docs.qgroundcontrol.com, "Plan File Format"; commands and frames: MAVLink's common.xml. A plan that
comes in is foreign, and may be hostile: MissionError is all that comes of it.

Heights relative to home, which is how QGroundControl plans, are taken for heights above the ground of the mission's
origin.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

from mission.common.files import parsed_json, refused
from mission.common.frames import LocalFrame, Vec3, Wgs84, enu_to_ned, ned_to_enu
from mission.common.problems import MissionError, Problem, printable, shown
from mission.document.model import AtEnd, Mission
from mission.lanes.spread import PASS_M
from mission.schema.check import validated

MAX_PLAN_BYTES: Final = 1024 * 1024
MAX_ITEMS: Final = 1_000
SAME_POSITION_M: Final = 1.0  # a landing this close to d2 is one there


class Command(IntEnum):
    """MAV_CMD, those that a swarm's mission has."""

    WAYPOINT = 16
    LOITER_UNLIM = 17
    LOITER_TIME = 19
    RETURN = 20
    LAND = 21
    TAKEOFF = 22
    CHANGE_SPEED = 178


# Of cameras, gimbals and grippers: a swarm has none, and its route is the same without.
DROPPED: Final = frozenset(
    {195, 196, 197, 200, 201, 203, 204, 205, 206, 211, 214, 530, 531, 532, 1000, 2000, 2001, 2500, 2501}
)
RELATIVE: Final = (3, 6)  # MAV_FRAME_GLOBAL_RELATIVE_ALT, and its INT
ABSOLUTE: Final = (0, 5)  # MAV_FRAME_GLOBAL, and its INT
MAV_FRAME_MISSION: Final = 2
FIRMWARE_PX4: Final = 12  # MAV_AUTOPILOT, which the ground station lays its menus out for
MULTIROTOR: Final = 2  # MAV_TYPE
GROUND_SPEED: Final = 1


# --- out --------------------------------------------------------------------------------------------------------------


def to_plan(mission: Mission, place: str) -> str:
    """The plan of `mission`, from the file `place`. MissionError when the mission does not say where on Earth it is."""
    if mission.origin is None:
        message = "missing: a plan is in degrees, and needs to know where the mission's frame is"
        raise MissionError([Problem(place, None, "origin", "", message)])
    frame, route = LocalFrame(mission.origin.wgs84), mission.route
    d1 = frame.to_wgs84(enu_to_ned(route.d1_enu_m))
    items = [
        _at(Command.TAKEOFF, (0.0, 0.0, 0.0), frame, route.d1_enu_m),
        _do(Command.CHANGE_SPEED, (GROUND_SPEED, route.vel_leader_mps, -1)),
    ]
    for visit in mission.visits:
        if visit.is_passed:
            items.append(_at(Command.WAYPOINT, (0.0, PASS_M, 0.0), frame, visit.pos_enu_m))
            continue
        stay = (visit.duration_s, 0, mission.coverage.radius_m)
        items.append(_at(Command.LOITER_TIME, stay, frame, visit.pos_enu_m))
    if route.at_end is AtEnd.RETURN:
        items.append(_do(Command.RETURN, ()))
    elif route.at_end is AtEnd.LAND:
        east_m, north_m, _ = route.d2_enu_m
        items.append(_at(Command.LAND, (0.0, 0.0, 0.0), frame, (east_m, north_m, 0.0)))
    for number, item in enumerate(items, start=1):
        item["doJumpId"] = number
    corners = [frame.to_wgs84((north_m, east_m, 0.0)) for east_m, north_m in mission.fence.polygon_enu_m or ()]
    polygon = {"inclusion": True, "polygon": [[at.lat_deg, at.lon_deg] for at in corners], "version": 1}
    document = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [polygon] if corners else [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": route.vel_leader_mps,
            "firmwareType": FIRMWARE_PX4,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": route.vel_leader_mps,
            "items": items,
            "plannedHomePosition": [d1.lat_deg, d1.lon_deg, mission.origin.alt_m],
            "vehicleType": MULTIROTOR,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    return json.dumps(document, indent=4) + "\n"


def _at(command: Command, params: Sequence[float], frame: LocalFrame, pos_enu_m: Vec3) -> dict[str, Any]:
    at, up_m = frame.to_wgs84(enu_to_ned(pos_enu_m)), pos_enu_m[2]
    return {
        "AMSLAltAboveTerrain": None,
        "Altitude": up_m,
        "AltitudeMode": 1,  # relative to home
        "autoContinue": True,
        "command": int(command),
        "frame": RELATIVE[0],
        "params": [*params, None, at.lat_deg, at.lon_deg, up_m],
        "type": "SimpleItem",
    }


def _do(command: Command, params: Sequence[float]) -> dict[str, Any]:
    return {
        "autoContinue": True,
        "command": int(command),
        "frame": MAV_FRAME_MISSION,
        "params": [*params, *[0] * (7 - len(params))],
        "type": "SimpleItem",
    }


# --- in ---------------------------------------------------------------------------------------------------------------


@dataclass
class _Route:
    """Route and limits from the items of a plan, as they are read."""

    d1: Wgs84 | None = None
    positions: list[tuple[Wgs84, float | None]] = field(default_factory=list)  # and for how long
    speed_mps: float | None = None
    at_end: AtEnd | None = None
    endless: bool = False  # at the last of the places
    dropped: list[int] = field(default_factory=list)  # commands


def from_plan(text: str, place: str, base: Mission | None = None) -> tuple[Mission, tuple[str, ...]]:
    """The mission that the plan `text` flies, and what was made of it. MissionError names `place`, item and value.

    base: whose keys it has where the plan says nothing; its origin stays. Without one, the planned home is the origin.
    """
    return _Reader(text, place, base).read_plan()


class _Reader:
    """One plan."""

    def __init__(self, text: str, place: str, base: Mission | None) -> None:
        self._place, self._base = place, base
        self._document = parsed_json(text, place)
        if not isinstance(self._document, dict) or self._document.get("fileType") != "Plan":
            raise refused(place, None, 'must be a plan of QGroundControl: JSON with "fileType": "Plan"')
        self._plan = self._table(self._document, "mission", "")
        self._notes: list[str] = []
        home = self._numbers(self._plan, "plannedHomePosition", "mission.", 3)
        self._home = self._earth(home[0], home[1], home[2], "mission.plannedHomePosition")
        kept = None if base is None or base.origin is None else base.origin.wgs84
        self._origin = kept or self._home

    def read_plan(self) -> tuple[Mission, tuple[str, ...]]:
        route = self._route()
        if route.d1 is None:
            raise self._refused("mission.items", "", f"must begin with a takeoff (command {int(Command.TAKEOFF)}): d1")
        if not route.positions:
            raise self._refused("mission.items", "", "must hold a waypoint to fly to: the last of them is d2")
        values: dict[str, Any] = {"schema": 1} if self._base is None else self._kept(self._base)
        *stops, (d2, stay_s) = route.positions
        told = values.setdefault("route", {})
        told["d1_enu_m"], told["d2_enu_m"] = self._enu(route.d1), self._enu(d2)
        told["stops"] = [{"pos_enu_m": self._enu(at), "duration_s": stop_s or 0.0} for at, stop_s in stops]
        if not stops:
            del told["stops"]
        told["vel_leader_mps"] = self._speed_mps(route)
        told["at_end"] = (route.at_end or AtEnd.HOLD).value
        if stay_s is not None:
            values.setdefault("coverage", {})["duration_s"] = stay_s
        polygon = self._fence()
        if polygon:
            values.setdefault("fence", {})["polygon_enu_m"] = polygon
        elif isinstance(values.get("fence"), dict):
            values["fence"].pop("polygon_enu_m", None)
        at = self._origin
        values["origin"] = {"lat_deg": at.lat_deg, "lon_deg": at.lon_deg, "alt_m": at.alt_m}
        mission = validated(Mission, values, self._place)
        self._note_dropped(route, mission)
        return mission, tuple(self._notes)

    def _kept(self, base: Mission) -> dict[str, Any]:
        values = base.model_dump(mode="json", by_alias=True, exclude_unset=True)
        values["route"].pop("stops", None)
        return values

    def _note_dropped(self, route: _Route, mission: Mission) -> None:
        if route.dropped:
            commands = ", ".join(map(str, sorted(set(route.dropped))))
            self._notes.append(f"dropped items for cameras, gimbals and the like: commands {commands}")
        rally = self._document.get("rallyPoints")
        if isinstance(rally, dict) and rally.get("points"):
            self._notes.append("dropped the rally points: a swarm has none")
        if mission.fence.polygon_enu_m is None:
            self._notes.append("no fence in the plan: none in the mission, but its altitudes")
        low_m, high_m = mission.fence.altitude_min_m, mission.fence.altitude_max_m
        self._notes.append(f"a plan has no fence of altitudes: {low_m:g} to {high_m:g} m")

    # the route

    def _route(self) -> _Route:
        items = self._plan.get("items")
        if not isinstance(items, list):
            raise self._refused("mission.items", _shown_or_null(items), "must be an array of items")
        if len(items) > MAX_ITEMS:
            raise self._refused("mission.items", f"{len(items)} items", f"must be at most {MAX_ITEMS}")
        route = _Route()
        for index, item in enumerate(items):
            self._add_item(route, item, f"mission.items[{index}]")
        return route

    def _add_item(self, route: _Route, item: object, key: str) -> None:
        if not isinstance(item, dict) or item.get("type") != "SimpleItem":
            what = item.get("complexItemType") if isinstance(item, dict) else item
            raise self._refused(
                key, _shown_or_null(what), "must be a SimpleItem: surveys and the like are for one vehicle"
            )
        command = item.get("command")
        if type(command) is not int:
            raise self._refused(f"{key}.command", _shown_or_null(command), "must be a number of MAV_CMD")
        if command in DROPPED:
            route.dropped.append(command)
            return
        params = item.get("params")
        if not isinstance(params, list) or len(params) != 7:
            raise self._refused(f"{key}.params", _shown_or_null(params), "must be an array of 7")
        if route.at_end is not None:
            raise self._refused(
                f"{key}.command", str(command), "must not come after the end: the swarm has landed, or returned"
            )
        match command:
            case Command.TAKEOFF if route.d1 is None and not route.positions:
                route.d1 = self._where(item, params, key, self._home)
            case Command.CHANGE_SPEED:
                self._take_speed(route, params, key)
            case Command.WAYPOINT | Command.LOITER_TIME | Command.LOITER_UNLIM if route.d1 is not None:
                self._take_position(route, command, item, params, key)
            case Command.RETURN if route.positions:
                route.at_end = AtEnd.RETURN
            case Command.LAND if route.positions:
                self._take_landing(route, item, params, key)
            case _:
                known = ", ".join(f"{one.value} {one.name.lower().replace('_', ' ')}" for one in Command)
                message = f"cannot be flown by a swarm, or not here: a plan has a takeoff first, then {known}"
                raise self._refused(f"{key}.command", str(command), message)

    def _take_position(
        self, route: _Route, command: int, item: Mapping[str, Any], params: Sequence[object], key: str
    ) -> None:
        if route.endless:
            message = "must not come after a place to loiter at without end"
            raise self._refused(f"{key}.command", str(command), message)
        route.endless = command == Command.LOITER_UNLIM
        stay_s = None if route.endless else self._number(params[0] or 0.0, f"{key}.params[0]")
        if command == Command.WAYPOINT and not stay_s:
            stay_s = None  # no time is told
        route.positions.append((self._where(item, params, key, None), stay_s))

    def _take_speed(self, route: _Route, params: Sequence[object], key: str) -> None:
        speed_mps = self._number(params[1], f"{key}.params[1]")
        if route.speed_mps not in (None, speed_mps):
            raise self._refused(
                f"{key}.params[1]", f"{speed_mps:g}", f"must be {route.speed_mps:g} as before: a swarm has one speed"
            )
        route.speed_mps = speed_mps

    def _take_landing(self, route: _Route, item: Mapping[str, Any], params: Sequence[object], key: str) -> None:
        d2 = route.positions[-1][0]
        lands = self._where(item, params, key, Wgs84(d2.lat_deg, d2.lon_deg, self._origin.alt_m), level=True)
        frame = LocalFrame(d2)
        off_m = math.hypot(*frame.to_ned(lands)[:2])
        if off_m > SAME_POSITION_M:
            raise self._refused(key, "", f"lands {off_m:.0f} m from d2: must land there, or return")
        route.at_end = AtEnd.LAND

    def _where(
        self, item: Mapping[str, Any], params: Sequence[object], key: str, absent: Wgs84 | None, *, level: bool = False
    ) -> Wgs84:
        """Position of an item. absent: where it is if it says no place; level: its height does not matter."""
        lat, lon = params[4], params[5]
        if absent is not None and (lat in (None, 0) and lon in (None, 0)):
            lat, lon = absent.lat_deg, absent.lon_deg
        up = self._number(0.0 if level else params[6], f"{key}.params[6]")
        frame = item.get("frame")
        if type(frame) is not int or (frame not in RELATIVE and frame not in ABSOLUTE):
            allowed = "must be relative to home (3) or above sea level (0): ground that is not known cannot be followed"
            raise self._refused(f"{key}.frame", _shown_or_null(frame), allowed)
        alt_m = up if frame in ABSOLUTE else self._origin.alt_m + up
        return self._earth(lat, lon, alt_m, f"{key}.params")

    def _speed_mps(self, route: _Route) -> float:
        if route.speed_mps is not None:
            return route.speed_mps
        if self._base is not None:
            self._notes.append("no speed in the plan: the mission's")
            return self._base.route.vel_leader_mps
        speed_mps = self._number(self._plan.get("hoverSpeed"), "mission.hoverSpeed")
        self._notes.append(f"speed: {speed_mps:g} m/s, the plan's hover speed")
        return speed_mps

    # the fence

    def _fence(self) -> list[tuple[float, float]]:
        """East, north; empty: none."""
        if "geoFence" not in self._document:
            return []
        fence = self._table(self._document, "geoFence", "")
        circles, polygons = fence.get("circles", []), fence.get("polygons", [])
        if circles:
            raise self._refused(
                "geoFence.circles", _shown_or_null(circles), "must be empty: a mission's fence is one polygon"
            )
        if not isinstance(polygons, list) or len(polygons) > 1:
            raise self._refused(
                "geoFence.polygons", _shown_or_null(polygons), "must be an array of at most one polygon"
            )
        if not polygons:
            return []
        key = "geoFence.polygons[0]"
        polygon = polygons[0]
        if not isinstance(polygon, dict) or polygon.get("inclusion") is not True:
            raise self._refused(key, "", "must be one to stay inside of (inclusion = true)")
        corners = polygon.get("polygon")
        if not isinstance(corners, list) or len(corners) > MAX_ITEMS:
            raise self._refused(
                f"{key}.polygon", _shown_or_null(corners), "must be an array of latitudes and longitudes"
            )
        found = []
        for index, corner in enumerate(corners):
            at = f"{key}.polygon[{index}]"
            if not isinstance(corner, list) or len(corner) != 2:
                raise self._refused(at, _shown_or_null(corner), "must be latitude and longitude")
            east_m, north_m, _ = self._enu(self._earth(corner[0], corner[1], self._origin.alt_m, at))
            found.append((east_m, north_m))
        return found

    # values

    def _enu(self, at: Wgs84) -> Vec3:
        """To the millimetre: beyond it, a plan's degrees are noise."""
        east_m, north_m, up_m = ned_to_enu(LocalFrame(self._origin).to_ned(at))
        return (round(east_m, 3) + 0.0, round(north_m, 3) + 0.0, round(up_m, 3) + 0.0)

    def _earth(self, lat: object, lon: object, alt_m: float, key: str) -> Wgs84:
        lat_deg, lon_deg = self._number(lat, key), self._number(lon, key)
        if not (abs(lat_deg) <= 85.0 and abs(lon_deg) <= 180.0):
            told = f"{lat_deg:g}, {lon_deg:g}"
            raise self._refused(key, told, "must be a latitude from -85 to 85 and a longitude from -180 to 180 degrees")
        return Wgs84(lat_deg, lon_deg, alt_m)

    def _numbers(self, table: Mapping[str, Any], name: str, prefix: str, count: int) -> list[float]:
        values = table.get(name)
        if not isinstance(values, list) or len(values) != count:
            raise self._refused(f"{prefix}{name}", _shown_or_null(values), f"must be an array of {count} numbers")
        return [self._number(value, f"{prefix}{name}[{index}]") for index, value in enumerate(values)]

    def _number(self, value: object, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= 1e9:  # false for NaN
            raise self._refused(key, _shown_or_null(value), "must be a number")
        return float(value)

    def _table(self, values: Mapping[str, Any], name: str, prefix: str) -> dict[str, Any]:
        table = values.get(name)
        if not isinstance(table, dict):
            raise self._refused(f"{prefix}{name}", _shown_or_null(table), "must be an object")
        return table

    def _refused(self, key: str, value: str, message: str) -> MissionError:
        return MissionError([Problem(self._place, None, printable(key), value, message)])


def _shown_or_null(value: object) -> str:
    return "null" if value is None else shown(value)
