"""Alarms for an operator, out of what was heard; and of the mission, where there is one, its fence."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from companion.watch.heard import FRESH_S, Picture, Vehicle
from mission.common.frames import LocalFrame, Wgs84, ned_to_enu
from mission.common.plane import clearance_m

if TYPE_CHECKING:
    from mission.document.model import Mission

LOST_S: Final = 3.0  # thirty beacons: no chance loss any more, and soon enough to look up
LEADERLESS_S: Final = 2.0  # without a leader, or with two: while another takes over, half a second of each is seen
UNPROVEN_S: Final = 3.0  # three manifests
BATTERY_PERCENT: Final = 20  # below it: PX4 warns at 15 (BAT_LOW_THR), and the radio tells steps of 10
FENCE_NEAR_M: Final = 3.0  # GPS is no better


@dataclass(frozen=True, slots=True)
class Alarm:
    """`kind` and `vehicles` tell one from another; `grave`: with sound."""

    kind: str
    vehicles: tuple[int, ...]
    text: str
    grave: bool


def alarms(picture: Picture, mission: Mission | None = None) -> tuple[Alarm, ...]:
    """The gravest first. `mission`: with an origin."""
    found = [*_links(picture), *_leader(picture), *_vehicles(picture), *_signatures(picture)]
    if mission is not None:
        found += _fence(picture, mission)
    return tuple(sorted(found, key=lambda alarm: not alarm.grave))


def _fresh(picture: Picture) -> list[Vehicle]:
    return [vehicle for vehicle in picture.vehicles if vehicle.age_s < FRESH_S]


def _links(picture: Picture) -> Iterator[Alarm]:
    if picture.silence_s is not None and picture.silence_s >= LOST_S:
        text = f"Nothing heard for {picture.silence_s:.0f} s: is this computer's radio in range?"
        yield Alarm("silence", (), text, grave=any(vehicle.airborne for vehicle in picture.vehicles))
        return
    for vehicle in picture.vehicles:
        if vehicle.airborne and vehicle.age_s >= LOST_S:
            text = f"Vehicle {vehicle.id}: link lost in the air, last heard {vehicle.age_s:.0f} s ago"
            yield Alarm("link", (vehicle.id,), text, grave=True)
    for vehicle_id in picture.other_versions:
        yield Alarm("version", (vehicle_id,), f"Vehicle {vehicle_id}: its beacons are of another version", grave=False)


def _leader(picture: Picture) -> Iterator[Alarm]:
    if picture.led_s is not None and picture.led_s >= LEADERLESS_S:
        yield Alarm("leader", (), f"No leader for {picture.led_s:.0f} s", grave=True)
    flying = [vehicle for vehicle in _fresh(picture) if vehicle.airborne and vehicle.acting]
    leaders = tuple(sorted({vehicle.leader for vehicle in flying}))
    if len(leaders) > 1 and picture.apart_s is not None and picture.apart_s >= LEADERLESS_S:
        yield Alarm("leaders", leaders, f"{len(leaders)} leaders: {', '.join(map(str, leaders))}", grave=False)
    known = {vehicle.id for vehicle in picture.vehicles}
    for leader in leaders:
        if leader not in known:
            yield Alarm("unheard", (leader,), f"Leader {leader} was never heard here", grave=False)
    for leader in leaders:
        if not any(vehicle.quorum for vehicle in flying if vehicle.leader == leader):
            yield Alarm("majority", (leader,), f"Leader {leader} has no quorum", grave=False)


def _vehicles(picture: Picture) -> Iterator[Alarm]:
    fresh = _fresh(picture)
    if any(vehicle.abort for vehicle in fresh):
        yield Alarm("abort", (), "An operator has ordered all to land", grave=False)
    for vehicle in fresh:
        which = (vehicle.id,)
        if vehicle.state == "released":
            yield Alarm("pilot", which, f"Vehicle {vehicle.id}: released by its companion", grave=False)
        if vehicle.state == "landing" and vehicle.phase != "land" and not vehicle.abort:
            text = f"Vehicle {vehicle.id}: landing, cause not reported"
            yield Alarm("lands", which, text, grave=True)
        if vehicle.battery_percent is not None and vehicle.battery_percent[1] < BATTERY_PERCENT:
            least, most = vehicle.battery_percent
            unknown = "" if least else ", or its autopilot does not know"
            text = f"Vehicle {vehicle.id}: battery at {most} % or less{unknown}"
            yield Alarm("battery", which, text, grave=least > 0)


def _signatures(picture: Picture) -> Iterator[Alarm]:
    for vehicle in _fresh(picture):
        if vehicle.unproven_s is not None and vehicle.unproven_s >= UNPROVEN_S:
            text = f"Vehicle {vehicle.id}: unproven by its key for {vehicle.unproven_s:.0f} s: no word of it is shown"
            yield Alarm("unproven", (vehicle.id,), text, grave=False)
    for vehicle_id, what in picture.strangers:
        yield Alarm("stranger", (vehicle_id,), f"Vehicle {vehicle_id}: {what}", grave=False)


def _fence(picture: Picture, mission: Mission) -> Iterator[Alarm]:
    """Alarms of vehicles whose reported, or else reckoned, position is outside or near the fence."""
    assert mission.origin is not None
    frame, fence = LocalFrame(mission.origin.wgs84), mission.fence
    for vehicle in _fresh(picture):
        position = vehicle.place or vehicle.reckoned
        if position is None or not vehicle.airborne:
            continue
        east_m, north_m, up_m = ned_to_enu(frame.to_ned(Wgs84(*position)))
        over_m = [] if fence.polygon_enu_m is None else [-clearance_m((east_m, north_m), fence.polygon_enu_m)]
        over_m.append(up_m - mission.ceiling_m)
        worst_m = max(over_m)
        if worst_m > 0.0:
            yield Alarm("fence", (vehicle.id,), f"Vehicle {vehicle.id}: {worst_m:.0f} m outside the fence", grave=True)
        elif worst_m > -FENCE_NEAR_M:
            text = f"Vehicle {vehicle.id}: {-worst_m:.0f} m from the fence"
            yield Alarm("near", (vehicle.id,), text, grave=False)
