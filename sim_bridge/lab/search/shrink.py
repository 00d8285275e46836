"""Makes a mission that fails smaller, while it fails in the same way: fewer faults, vehicles, trees, errors."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from mission.document.model import Mission
from mission.schema.fault_kinds import FORMS, PARAMETERS, Lasts, Needs
from mission.schema.faults import within
from mission.schema.kinds import FaultKind, Lie
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.lab.search.attackers import SPOOFS
from sim_bridge.lab.search.flight import fly_to_row

Tables = dict[str, Any]

MOST_FLIGHTS: Final = 60
PLAIN_LIE: Final = Lie.OFFSET.value
PLAIN_SPOOF: Final = FaultKind.POSITION_FREEZE  # it has no numbers
LONG_S: Final = 40.0  # of a fault that had no end
SHORT_S: Final = 2.0  # it is not tried shorter
SMALL: Final = 0.04  # m or m/s, which no number of a fault is tried below

PLAIN: dict[str, Any] = {  # keys of [sim] with the value that hides nothing
    "turbulence_mps": 0.0,
    "wind_mps": [0.0, 0.0, 0.0],
    "radio_loss": 0.0,
    "radio_delay_s": 0.0,
    "radio_trunks": "disc",
    "estimates": "exact",
    "personalities": {},
    "personality": "px4",
    "drag": "low",
    "placement": "grid",
    "battery_mah": {},
}


def shrink(
    mission: Mission,
    grade: str,
    cause: str,
    *,
    on_jsbsim: bool,
    most_flights: int = MOST_FLIGHTS,
    entrant: Entrant = BY_OURS,
    signed: bool = False,
    report_progress: Callable[[str], None] = lambda _: None,
    note_flight: Callable[[], None] = lambda: None,
) -> tuple[Mission, bool]:
    """The smallest that was found within `most_flights`, and fails by `cause` first, as badly; whether it is signed.

    report_progress: is told of each that is smaller. note_flight: is called after each flight.
    """
    left = most_flights
    changed = True
    while changed and left > 0:
        changed = False
        for what, smaller, with_keys in _smaller(mission, signed=signed):
            if left <= 0:
                break
            left -= 1
            row = fly_to_row(smaller, on_jsbsim=on_jsbsim, entrant=entrant, signed=with_keys)
            note_flight()
            if (row["grade"], row["causes"][:1]) == (grade, [cause]):  # the grade, too: what is explained is no failure
                report_progress(f"{what}: still {row['verdict']}")
                mission, signed, changed = smaller, with_keys, True
                break
    return mission, signed


def _smaller(mission: Mission, *, signed: bool) -> Iterator[tuple[str, Mission, bool]]:
    """Possible missions with one thing less, the greatest steps first; with keys, or without."""
    if signed and not any(fault.kind is FaultKind.OUTSIDER for fault in mission.sim.faults):
        yield "unsigned", mission, False  # what an outsider does to an unsigned swarm is no finding
    whole = mission.model_dump(mode="json", by_alias=True)
    for what, tables in _steps(whole, mission):
        try:
            found = Mission.model_validate(tables)
        except ValueError:
            continue
        if found != mission:
            yield what, found, signed


def _steps(whole: Tables, mission: Mission) -> Iterator[tuple[str, Tables]]:
    for k in range(len(mission.sim.faults)):
        yield (
            f"without fault {k + 1}",
            _with(whole, "sim", "faults", [f for j, f in enumerate(_faults(whole)) if j != k]),
        )
    n = mission.swarm.size
    for size in dict.fromkeys((max(1, n // 2), n - 2, n - 1)):
        if 0 < size < n:
            yield f"{size} vehicles", _of_size(whole, mission, size)
    yield from _barer(whole, mission)
    yield "level ground", _with(whole, "forest", "grade", [0.0, 0.0])
    yield "without a boundary", _with(whole, "fence", "polygon_enu_m", None)
    for key, plain in PLAIN.items():
        if whole["sim"][key] != plain:
            yield f"sim.{key} = {plain}", _with(whole, "sim", key, plain)
    for k, fault in enumerate(_faults(whole)):
        for what, smaller in _lesser(fault):
            yield (
                f"fault {k + 1} {what}",
                _with(whole, "sim", "faults", [*_faults(whole)[:k], smaller, *_faults(whole)[k + 1 :]]),
            )


def _barer(whole: Tables, mission: Mission) -> Iterator[tuple[str, Tables]]:
    """Less of what stands there, and of what is done there."""
    if mission.survey is not None:
        yield "without a survey", _without_survey(whole)
        yield "without lanes", _with(whole, "survey", "area_enu_m", None)
        yield "round trunks", _with(whole, "forest", "shapes", None)
    if mission.route.stops:
        yield "one tree", _with(whole, "route", "stops", [])
    stand = mission.forest.stand
    if stand is not None:
        yield "no stand", _with(whole, "forest", "stand", None)
        halved = copy.deepcopy(whole)
        halved["forest"]["stand"]["density_per_ha"] = stand.density_per_ha / 2.0
        if stand.density_per_ha > 20.0:
            yield "half as dense", halved
        if stand.undergrowth_per_ha:
            bare = copy.deepcopy(whole)
            bare["forest"]["stand"]["undergrowth_per_ha"] = 0.0
            yield "without undergrowth", bare


def _lesser(fault: Tables) -> Iterator[tuple[str, Tables]]:
    """A fault that is plainer, begins earlier, ends earlier, strikes fewer, or is half as great."""
    kind = FaultKind(fault["kind"])
    if fault["lie"] is not None:
        yield f"tells {PLAIN_LIE}", {**fault, "lie": PLAIN_LIE}
    if kind in SPOOFS and kind != PLAIN_SPOOF:
        plain = {name: None for name in FORMS[kind].parameters}
        yield f"is {PLAIN_SPOOF.value}", {**fault, **plain, "kind": PLAIN_SPOOF.value}
    vehicles = fault["vehicles"] or ()
    for k in vehicles if len(vehicles) > 1 else ():
        yield f"without {k}", {**fault, "vehicles": [j for j in vehicles if j != k]}
    if fault["at_s"] > 0.0:
        yield "at once", {**fault, "at_s": 0.0}
    lasts = FORMS[kind].lasts
    if lasts is not Lasts.NEVER and (fault["for_s"] or math.inf) > SHORT_S:
        for_s = LONG_S if fault["for_s"] is None else round(fault["for_s"] / 2.0, 1)
        yield f"for {for_s:g} s", {**fault, "for_s": for_s}
    for name in FORMS[kind].parameters:
        value = fault[name]
        halved = [round(one / 2.0, 2) for one in value] if PARAMETERS[name].level else round(value / 2.0, 2)
        if np.any(np.abs(halved) > SMALL):
            yield f"{name} = {halved}", {**fault, name: halved}


def _of_size(whole: Tables, mission: Mission, size: int) -> Tables:
    """The same without the vehicles of the highest ids."""
    tables = copy.deepcopy(whole)
    tables["swarm"]["size"] = size
    tables["swarm"]["leader_priority"] = [k for k in mission.swarm.leader_priority if k <= size]
    sim = tables["sim"]
    sim["faults"] = [fault.model_dump(mode="json", by_alias=True) for fault in within(mission.sim.faults, size)]
    for key in ("personalities", "battery_mah"):
        sim[key] = {k: value for k, value in sim[key].items() if int(k) <= size}
    return tables


def _without_survey(whole: Tables) -> Tables:
    """And without the faults that need its records."""
    left = [fault for fault in _faults(whole) if FORMS[FaultKind(fault["kind"])].needs is not Needs.RECORDS]
    return {**_with(whole, "sim", "faults", left), "survey": None}


def _faults(whole: Tables) -> list[Tables]:
    faults: list[Tables] = whole["sim"]["faults"]
    return faults


def _with(whole: Tables, table: str, key: str, value: object) -> Tables:
    return {**whole, table: {**whole[table], key: value}}
