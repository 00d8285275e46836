"""`mission check`: every problem of mission files, and what the good ones fly."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE
from mission.common.problems import MissionError, Problem, printable
from mission.document import simulator
from mission.document.airtime import airtime_s, battery_mah, battery_share, find_short_batteries
from mission.document.barometer import find_lacking_room
from mission.document.height_layers import APART_M, LIMIT_M, list_layers
from mission.document.load import MAX_PLACE_CHARS, load_document
from mission.document.model import Mission
from mission.rules.survey_rules import cut_distances_m
from mission.schema.check import validated
from mission.schema.sim import OdometryErrors, RangingErrors, Sky
from mission.schema.tables import Swarm


def run(files: Sequence[str], *, as_json: bool) -> int:
    """Exit code: EXIT_BAD_FILE when one is not good."""
    code = EXIT_DONE
    results: list[dict[str, Any]] = []
    for file in files:
        try:
            result, beyond = _checked(file)
        except MissionError as error:
            code = EXIT_BAD_FILE
            result = {"file": file, "ok": False, "problems": [asdict(problem) for problem in error.problems]}
            if not as_json:
                print(error, file=sys.stderr)
        else:
            if not as_json:
                print(_sentence(result))
                print(f"  {_airtime(result)}")
                for problem in beyond:
                    print(f"  not for the simulator: {problem}")
                for note in result["notes"]:
                    print(f"  {note}")
        results.append(result)
    if as_json:
        print(json.dumps(results, indent=2))
    return code


def _checked(file: str) -> tuple[dict[str, Any], tuple[Problem, ...]]:
    """Reads `file`, and finds what the simulated vehicles cannot fly of it: without [origin] it is for them alone."""
    values, place, line_of = load_document(file)
    mission = validated(Mission, values, place, line_of)
    beyond = simulator.problems(mission, place, values, line_of)
    if beyond and mission.origin is None:
        raise MissionError(beyond)
    absent, notes = _check_stand(mission, file)
    beyond += absent
    lacking = find_lacking_room(mission)
    notes = [
        *find_short_batteries(mission),
        *_idle(mission),
        *_layers(mission),
        *_survey(mission),
        *_sensors(mission),
        *([lacking] if lacking else []),
        *notes,
    ]
    told = {"beyond_simulator": [asdict(problem) for problem in beyond], "notes": notes}
    return _summary(file, mission) | told, beyond


def _idle(mission: Mission) -> Iterator[str]:
    """Notes about satellites, and changes nothing."""
    if mission.flies_by_ranges:
        if mission.sim.satellites.crowns is Sky.SHADE and mission.forest.stand is None and mission.forest.file is None:
            yield "no crowns, which [forest.stand] or forest.file would have: nothing comes of sim.satellites.crowns"
        return
    swarm, sim = mission.swarm, mission.sim
    said = {
        "[ranging]": mission.ranging is not None,
        "swarm.position_error_max_m": swarm.position_error_max_m != Swarm().position_error_max_m,
        "swarm.position_uncertain": swarm.position_uncertain is not Swarm().position_uncertain,
        "[sim.ranging]": sim.ranging != RangingErrors(),
        "[sim.odometry]": sim.odometry != OdometryErrors(),
    }
    idle = [key for key, is_said in said.items() if is_said]
    if idle:
        yield f"all have GNSS (swarm.gnss): nothing comes of {', '.join(idle)}"


def _sensors(mission: Mission) -> Iterator[str]:
    """Notes which sensors that it names are not to be had on this computer: vehicles and simulator need them."""
    if mission.sensors:
        from mission.common.entry_points import SENSORS, installed_names

        here = installed_names(SENSORS)
        absent = [name for name in mission.sensors if name not in here]
        if absent:
            yield f"sensors: {', '.join(absent)} is in no package that is installed here: each vehicle needs it"


def _layers(mission: Mission) -> Iterator[str]:
    """Notes which layers of height there is room for, and where vehicles that sense obstacles could fly in some."""
    if not mission.separation.height_layers:
        if mission.sensing is not None and mission.swarm.size > 1:
            yield (
                "one height for all: parts that do not hear each other may meet. separation.height_layers = true "
                "keeps them apart, where a downward range finder holds each vehicle's height"
            )
        return
    own_m, *others_m = list_layers(mission)
    if others_m:
        heights = " and ".join(f"{height_m:.1f}" for height_m in others_m)
        yield f"{1 + len(others_m)} layers of height: the mission's, {own_m:g} m, and {heights} m"
    else:
        yield (
            "1 layer of height: separation.height_layers wants a level route and ring, and "
            f"{APART_M + LIMIT_M:g} m to the fence's altitudes: parts that do not hear each other may meet"
        )


def _survey(mission: Mission) -> Iterator[str]:
    """A note at which height stems are cut, and how that comes to breast height."""
    if mission.survey is None:
        return
    distances_m, taper = cut_distances_m(mission), f"{mission.survey.taper_cm_per_m:g} cm/m"
    if distances_m is not None:
        yield (
            f"survey: layers cut stems at breast height, 1.3 m, where they pass {distances_m[0]:.1f} to "
            f"{distances_m[1]:.1f} m away; others by taper, {taper}"
        )
        return
    yield (
        f"survey: stems are cut at flight height, {mission.route.d1_enu_m[2]:g} m: diameters at breast height come by "
        f"taper, {taper}, never by measurement"
    )


def _check_stand(mission: Mission, file: str) -> tuple[tuple[Problem, ...], list[str]]:
    """Notes that its stem map is absent, which only the simulator reads, and where its fence meets crowns.

    MissionError for a map that is there and wrong, or that a mission for the simulator alone lacks.
    """
    if mission.forest.file is None and mission.forest.stand is None:
        return (), []
    from mission.cli.forest_notes import fence_notes
    from mission.stand.resolve import resolve_stand

    try:
        stand = resolve_stand(mission, file)
    except MissionError as error:
        if mission.origin is None or (Path(file).parent / (mission.forest.file or "")).exists():
            raise
        return error.problems, []
    return (), list(fence_notes(stand, mission))


def _summary(file: str, mission: Mission) -> dict[str, Any]:
    return {
        "file": file,
        "ok": True,
        "name": mission.name,
        "vehicles": mission.swarm.size,
        "stops": len(mission.route.stops),
        "distance_m": mission.route.length_m,
        "vel_leader_mps": mission.route.vel_leader_mps,
        "transit_s": mission.route.length_m / mission.route.vel_leader_mps,
        "airtime_s": round(airtime_s(mission), 1),
        "battery_mah": round(battery_mah(mission)),
        "battery_share": round(battery_share(mission), 3),
        "origin": mission.origin is not None,
        "flies_blind": mission.flies_blind,
        "problems": [],
    }


def _airtime(result: dict[str, Any]) -> str:
    """Least time in the air, and the charge that it takes."""
    minutes, charge = (
        result["airtime_s"] / 60.0,
        f"{result['battery_mah']} mAh, {100.0 * result['battery_share']:.0f} %",
    )
    return f"at least {minutes:.1f} min in the air: {charge} of the smallest simulated battery"


def _sentence(result: dict[str, Any]) -> str:
    vehicles = "1 vehicle" if result["vehicles"] == 1 else f"{result['vehicles']} vehicles"
    stops = {0: "", 1: " over 1 stop"}.get(result["stops"], f" over {result['stops']} stops")
    return (
        f"{printable(result['file'], MAX_PLACE_CHARS)}: ok: {result['name'] or 'unnamed'}, {vehicles}, "
        f"{result['distance_m']:.1f} m{stops}, "
        f"{result['transit_s']:.1f} s at {result['vel_leader_mps']} m/s"
        f"{'' if result['origin'] else '; no [origin]: for the simulator alone'}"
        f"{'; no [sensing]: vehicles do not see the forest' * result['flies_blind']}"
    )
