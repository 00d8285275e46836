"""Makes a mission that fails smaller, while it fails in the same way: fewer faults, vehicles, trees, errors."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

from mission.document.model import Mission
from mission.schema.faults import within
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.lab.search.flight import fly_to_row

Tables = dict[str, Any]

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
    cause: str,
    *,
    on_jsbsim: bool,
    most_flights: int = 60,
    entrant: Entrant = BY_OURS,
    report_progress: Callable[[str], None] = lambda _: None,
) -> Mission:
    """The smallest that was found within `most_flights`, and still fails by `cause` first."""
    left = most_flights
    changed = True
    while changed and left > 0:
        changed = False
        for what, smaller in _smaller(mission):
            if left <= 0:
                break
            left -= 1
            row = fly_to_row(smaller, on_jsbsim=on_jsbsim, entrant=entrant)
            if row["causes"][:1] == [cause]:
                report_progress(f"{what}: still {row['verdict']}")
                mission, changed = smaller, True
                break
    return mission


def _smaller(mission: Mission) -> Iterator[tuple[str, Mission]]:
    """Possible missions with one thing less, the greatest steps first."""
    whole = mission.model_dump(mode="json", by_alias=True)
    for what, tables in _steps(whole, mission):
        try:
            found = Mission.model_validate(tables)
        except ValueError:
            continue
        if found != mission:
            yield what, found


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
    yield "level ground", _with(whole, "forest", "grade", [0.0, 0.0])
    yield "without a boundary", _with(whole, "fence", "polygon_enu_m", None)
    for key, plain in PLAIN.items():
        if whole["sim"][key] != plain:
            yield f"sim.{key} = {plain}", _with(whole, "sim", key, plain)


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


def _faults(whole: Tables) -> list[Tables]:
    faults: list[Tables] = whole["sim"]["faults"]
    return faults


def _with(whole: Tables, table: str, key: str, value: object) -> Tables:
    return {**whole, table: {**whole[table], key: value}}
