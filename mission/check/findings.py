"""A mission's document, checked as a whole: what `mission check` says of it, and `mission edit` beside its fields."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mission.common.plane import area_m2
from mission.common.problems import MissionError, Problem
from mission.document import simulator
from mission.document.airtime import find_short_batteries
from mission.document.barometer import HEIGHT_SD_M, find_lacking_room
from mission.document.height_layers import (
    APART_M,
    LIMIT_M,
    OVER_BUSHES_M,
    find_room_m,
    find_room_over_ground_m,
    find_slope,
    highest_ground_m,
    list_layers,
    spread_m,
)
from mission.document.load import Document, check_kind
from mission.document.model import Estimates, Mission
from mission.rules.forest_rules import TAKEOFF_CLEAR_M
from mission.rules.payload_rules import records_hz, records_max_hz
from mission.rules.rise_rules import upward_view
from mission.rules.survey_rules import cut_distances_m
from mission.schema.check import validated
from mission.schema.forest import M2_PER_HA
from mission.schema.kinds import RAW_LIDARS
from mission.schema.sim import OdometryErrors, RangingErrors, Sky
from mission.schema.tables import Ranging, Sensing, Survey, Swarm

if TYPE_CHECKING:
    from mission.stand.stand import ReadStems, Stand

# By trunks alone, flown: none of two swarms left their start by lidars of 12 m; at 50 trees/ha one of three did
ALONE_RANGE_M = 16.0
ALONE_DENSITY_PER_HA = 100.0
ALONE_TREES = 6  # that two must have in common to be aligned
HALF_TURN_DEG = 180.0


@dataclass(frozen=True, slots=True)
class Findings:
    """A good mission, and what there is to say of it.

    beyond: what the simulated vehicles cannot fly of it; without [origin] that is refused. stand: its stem map's or its
    generated one; None where it has neither, or its map is not there.
    """

    mission: Mission
    beyond: tuple[Problem, ...]
    notes: tuple[str, ...]
    stand: Stand | None


def check_document(document: Document, path: str | os.PathLike[str], read: ReadStems | None = None) -> Findings:
    """Findings about the document of the file `path`, beside which its stem map is. MissionError with every problem.

    read: as for `stand_of`.
    """
    check_kind(document)
    mission = validated(Mission, *document)
    values, place, line_of = document
    beyond = simulator.problems(mission, place, values, line_of)
    if beyond and mission.origin is None:
        raise MissionError(beyond)
    stand, absent, notes = _check_stand(mission, document, path, read)
    lacking = find_lacking_room(mission)
    notes = [
        *find_short_batteries(mission),
        *_idle(mission),
        *_trunks_alone(mission, stand),
        *_sensing(mission),
        *_layers(mission),
        *_survey(mission),
        *_payload(mission),
        *_sensors(mission),
        *([lacking] if lacking else []),
        *notes,
    ]
    return Findings(mission, beyond + absent, tuple(notes), stand)


def _idle(mission: Mission) -> Iterator[str]:
    """Notes about satellites, and changes nothing."""
    if mission.flies_by_ranges:
        if mission.sim.satellites.crowns is Sky.SHADE and mission.forest.stand is None and mission.forest.file is None:
            yield "no crowns, which [forest.stand] or forest.file would have: nothing comes of sim.satellites.crowns"
        return
    swarm, sim = mission.swarm, mission.sim
    said = {
        "swarm.position_error_max_m": swarm.position_error_max_m != Swarm().position_error_max_m,
        "swarm.position_uncertain": swarm.position_uncertain is not Swarm().position_uncertain,
        "[sim.ranging]": sim.ranging != RangingErrors() and mission.ranging is None,
        "[sim.odometry]": sim.odometry != OdometryErrors(),
        "[ranging]": mission.ranging is not None and swarm.size == 1,
    }
    idle = [key for key, is_said in said.items() if is_said]
    if idle:
        why = "all have GNSS (swarm.gnss)" if swarm.size > 1 else "a swarm of one has GNSS, and no others to find"
        yield f"{why}: nothing comes of {', '.join(idle)}"


def _trunks_alone(mission: Mission, stand: Stand | None) -> Iterator[str]:
    """Notes what comes of nothing without range radios, and where trunks may be too few to leave the start by."""
    ranging, sensing = mission.ranging, mission.sensing
    if not mission.flies_by_ranges or ranging is None or ranging.radio or sensing is None:
        return
    said = {
        "ranging.reach_m": ranging.reach_m != Ranging().reach_m,
        "ranging.rate_hz": ranging.rate_hz != Ranging().rate_hz,
        "[sim.ranging]": mission.sim.ranging != RangingErrors(),
    }
    idle = [key for key, is_said in said.items() if is_said]
    if idle:
        yield f"no range radios (ranging.radio): nothing comes of {', '.join(idle)}"
    trees = mission.forest.trees if stand is None else stand.trees
    if len(trees) < ALONE_TREES and (stand is not None or mission.forest.file is None):
        grown = f"{len(trees) or 'no'} tree{'s' * (len(trees) != 1)}"
        yield (
            f"by trunks alone: simulated vehicles do not set out, as [forest] has {grown}: two must have {ALONE_TREES} "
            "in common"
        )
    spec = mission.forest.stand
    few = [
        *([f"sensing.range_m = {sensing.range_m:g}"] if sensing.range_m < ALONE_RANGE_M else []),
        *(
            [f"forest.stand.density_per_ha = {spec.density_per_ha:g}"]
            if spec is not None and spec.density_per_ha < ALONE_DENSITY_PER_HA
            else []
        ),
    ]
    if few:
        yield f"by trunks alone: with {' and '.join(few)} vehicles may see too few of the same trunks to set out"


def _sensing(mission: Mission) -> Iterator[str]:
    """Notes a view that is too narrow for the own motion, and vehicles whose autopilots are told of none."""
    sensing = mission.sensing
    if sensing is None:
        return
    if sensing.sensor in RAW_LIDARS and sensing.field_of_view_deg < HALF_TURN_DEG:
        yield (
            f"sensing.field_of_view_deg = {sensing.field_of_view_deg:g}: a raw lidar that sees less than half a turn "
            "corrects the own motion by few trunks, or by none"
        )
    without = len(mission.without_satellites)
    if sensing.sends_odometry and without:
        yield (
            f"nothing comes of sensing.sends_odometry on {without} of {mission.swarm.size} vehicles: they have no GNSS "
            "(swarm.gnss)"
        )


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
    if mission.swarm.size == 1:
        yield "1 layer of height: a swarm of one does not part"
        return
    own_m, *others_m = list_layers(mission)
    if others_m:
        heights = " and ".join(f"{height_m:.1f}" for height_m in others_m)
        shared = "parts without the majority may share one"
        if mission.swarm.size == 2 and len(others_m) == 1:
            shared = "two that part have no majority, and share the other: nothing keeps them apart by height"
        elif mission.swarm.size % 2 == 0:
            shared += ", and of two halves neither has it"
        yield f"{1 + len(others_m)} layers of height: the mission's, {own_m:g} m, and {heights} m; {shared}"
        if not mission.sim.range_finder and mission.sim.estimates is not Estimates.EXACT:
            yield (
                f"heights by a barometer, wrong by up to {HEIGHT_SD_M:g} m rms: those of two err by more than layers "
                f"are apart, {APART_M:g} m; sim.range_finder = true holds them"
            )
    else:
        yield f"1 layer of height, {_why_one_layer(mission)}: parts that do not hear each other may meet"


def _why_one_layer(mission: Mission) -> str:
    """Reason for which there is no second layer."""
    slope = find_slope(mission)
    if slope:
        return f"as layers want a level route and ring, and {slope}"
    low_m, high_m = find_room_m(mission)
    limit = f"{LIMIT_M:g} m above fence.altitude_min_m"
    if low_m > mission.fence.altitude_min_m + LIMIT_M:
        ground_m = highest_ground_m(mission)
        above_m = find_room_over_ground_m(mission)
        bushes = "" if above_m == TAKEOFF_CLEAR_M else f", {OVER_BUSHES_M:g} m above the undergrowth"
        limit = f"{above_m:g} m above the ground{bushes}, {ground_m:.1f} m up within {spread_m(mission):g} m of the way"
    room = f"{low_m:.1f} m ({limit}) to {high_m:.1f} m ({LIMIT_M:g} m below fence.altitude_max_m)"
    own_m = mission.route.d1_enu_m[2]
    return f"as another would be {APART_M:g} m below or above the mission's, {own_m:g} m, and there is room from {room}"


def _survey(mission: Mission) -> Iterator[str]:
    """Notes on the lanes, and at which height stems are cut, and how that comes to breast height."""
    if mission.survey is None:
        return
    yield from _lanes(mission, mission.survey)
    yield from _rise(mission)
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


def _rise(mission: Mission) -> Iterator[str]:
    """Notes how high the leader may rise, and from where that is seen."""
    view = upward_view(mission)
    if view is not None:
        yield (
            f"survey.rise_to_m = {mission.rise_to_m:g}: the leader alone may rise above fence.altitude_max_m = "
            f"{mission.fence.altitude_max_m:g}, in a column that it has seen free from {view[0]:.1f} m away and "
            "farther; autopilots' fences have to allow it on every vehicle"
        )


def _payload(mission: Mission) -> Iterator[str]:
    """A note on what is recorded besides, and how much that is."""
    if mission.payload:
        kinds = ", ".join(f"{one.name} ({one.unit}) each {one.period_s:g} s" for one in mission.payload)
        yield f"payload: {kinds}: {records_hz(mission):.1f} records a second of {records_max_hz(mission):.1f} at most"


def _lanes(mission: Mission, survey: Survey) -> Iterator[str]:
    """Notes how many lanes there are, how far apart, and what that leaves unseen."""
    lanes, swath = mission.lanes, mission.swath
    if not lanes:
        if survey.lane_m is not None:
            yield "no survey.area_enu_m: nothing comes of survey.lane_m"
        return
    flown_m = sum(math.dist(lane.start, lane.end) for lane in lanes)
    most = f"at most {swath.lane_m:.1f} m apart, " if len(lanes) > 1 else ""
    wide = f", the swarm {swath.spread_m:.1f} m wide" if mission.swarm.size > 1 else ""
    count = "1 lane" if len(lanes) == 1 else f"{len(lanes)} lanes"
    yield (
        f"survey: {count} over {area_m2(survey.area_enu_m or ()) / M2_PER_HA:.2f} ha, {most}{flown_m:.0f} m of "
        f"{mission.way_m:.0f} m in all{wide}"
    )
    reach_m = min(survey.reach_m, (mission.sensing or Sensing()).range_m)
    seen_m = swath.spread_m + reach_m
    if len(lanes) > 1 and swath.lane_m > seen_m:
        yield (
            f"survey.lane_m = {swath.lane_m:g}: stems between lanes are passed on one side, or not within "
            f"{reach_m:g} m: up to {seen_m:.1f} m they are on both"
        )
    if mission.swarm.size > 1 and mission.separation.soft_m > 2.0 * reach_m:
        yield (
            f"separation.soft_m = {mission.separation.soft_m:g}: stems between two vehicles are not all passed within "
            f"{reach_m:g} m"
        )


def _check_stand(
    mission: Mission, document: Document, path: str | os.PathLike[str], read: ReadStems | None
) -> tuple[Stand | None, tuple[Problem, ...], list[str]]:
    """Its stand; that its stem map is absent, which only the simulator reads; notes where its fence meets crowns, and
    where no tree is to be covered.

    MissionError for a map that is there and wrong, or that a mission for the simulator alone lacks.
    """
    if mission.forest.file is None and mission.forest.stand is None:
        return None, (), []
    from mission.check.forest_notes import bare_notes, fence_notes
    from mission.stand.resolve import resolve_stand

    try:
        stand = resolve_stand(mission, path, document, read)
    except MissionError as error:
        if mission.origin is None or (Path(path).parent / (mission.forest.file or "")).exists():
            raise
        return None, error.problems, []
    return stand, (), [*bare_notes(stand, mission), *fence_notes(stand, mission)]
