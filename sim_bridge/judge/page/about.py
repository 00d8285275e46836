"""Keys of a replay, for people: docs/reference/replay.md is made of this; a test holds it true."""

from __future__ import annotations

from typing import Final, NamedTuple


class About(NamedTuple):
    """One place of the document. `[]`: in each entry of an array."""

    kind: str
    unit: str
    meaning: str


_TREES: Final = {
    "east_m": "The axis.",
    "north_m": "The axis.",
    "ground_up_m": "The ground there.",
    "radius_m": "Of the trunk.",
    "height_m": "Above the ground.",
    "crown_base_m": "Above the ground; as high as the tree: it has no crown.",
    "crown_radius_m": "Of the crown.",
}

ABOUT: Final[dict[str, About]] = {
    "format": About("text", "", '"understory-replay".'),
    "version": About("integer", "", "Of this layout. A later one may add keys."),
    "made_by": About("text", "", "Program and version."),
    "title": About("text", "", "The mission's name."),
    "seed": About("integer", "", "sim.seed."),
    "verdict.text": About("text or null", "", "As `sim-bridge fly` ends; null: not known."),
    "verdict.succeeded": About("boolean or null", "", "The same."),
    "limits[].name": About("text", "", "What the verdict looks at."),
    "limits[].flown": About("text", "", "What was flown, with its unit."),
    "limits[].allowed": About("text", "", "What the mission allows; empty: it sets no limit."),
    "limits[].kept": About("boolean or null", "", "Whether it was kept; null: no limit."),
    "figures": About("object", "", "The [figures](metrics.md) by name."),
    "figures_named": About("array", "", "The same by the names that people see, with units; shares are percent."),
    "mission.places[].name": About("text", "", "d1, stop 1 ... or lane 1, lane 1 end ..., d2."),
    "mission.places[].enu_m": About("3 numbers", "m", "Where it is."),
    "mission.coverage.shape": About("text", "", "ring or sphere."),
    "mission.coverage.radius_m": About("number", "m", "Of the ring or sphere."),
    "mission.coverage.centres_enu_m": About("array of 3 numbers", "m", "The places that are covered; d2 is the last."),
    "mission.fence_enu_m": About("array of 2 numbers", "m", "The fence's polygon; empty: it has none."),
    "mission.origin": About("2 numbers or null", "deg", "Latitude and longitude that ENU counts from; null: not said."),
    "mission.altitude_m": About("2 numbers", "m", "Floor and ceiling."),
    "mission.separation_hard_m": About("number", "m", "separation.hard_m."),
    "mission.trunk_attenuation_factor": About("number", "", "What a trunk across a link leaves of its range, 0 to 1."),
    "mission.kept_per_trunk": About("number", "", "The same by its name until 0.2; goes with the next version."),
    "mission.sensing_range_m": About("number or null", "m", "Of the obstacle sensor; null: there is none."),
    "needs": About("text", "", "Least time in the air, and the charge that it takes, as `mission check` has it."),
    "mission_toml": About("text", "", "The mission as flown, whole."),
    **{
        f"stand.{kind}.{name}": About("column", "m", meaning)
        for kind in ("trees", "bushes")
        for name, meaning in _TREES.items()
    },
    "stand.boxes_enu_m": About("array of arrays of 2 numbers", "m", "The corners of each box, in order."),
    "time_s": About("column", "s", "Simulated time of each row."),
    "swarm.leader": About("steps", "", "Id of the acting leader; 0: none."),
    "swarm.phase": About("steps", "", "[SWARM_PHASE](beacon.md#swarm_phase); -1: none yet."),
    "swarm.separation_m": About("column", "m", "Least distance between two vehicles in flight."),
    "swarm.lambda2": About("column", "", "Algebraic connectivity; nothing with fewer than two alive vehicles."),
    "swarm.to_go_m": About("column", "m", "From the acting leader to where the swarm is bound for."),
    "swarm.gap_deg": About("column", "deg", "That the covering vehicles leave about d2, in phase COVERAGE."),
    "vehicles[].id": About("integer", "", "1 ... n."),
    "vehicles[].east_m": About("column", "m", "True position."),
    "vehicles[].north_m": About("column", "m", "True position."),
    "vehicles[].up_m": About("column", "m", "True position."),
    "vehicles[].alive": About("steps", "", "1: its companion answers, and it has run into nothing."),
    "vehicles[].on_ground": About("steps", "", "0 or 1."),
    "vehicles[].armed": About("steps", "", "0 or 1."),
    "vehicles[].acting": About("steps", "", "1: it claims an established lead."),
    "vehicles[].touched": About(
        "steps", "", "What it ran into: 0 nothing, 1 trunk, 2 crown, 3 ground, 4 vehicle, 5 box."
    ),
    "vehicles[].leader": About("steps", "", "Id of the leader that its beacon names; 0: none."),
    "vehicles[].phase": About("steps", "", "That its beacon announces; -1 before the first."),
    "vehicles[].range_m": About("steps", "m", "Of its radio."),
    "vehicles[].yaw_deg": About("column", "deg", "Heading, clockwise from north, unwrapped. Absent: not logged."),
    "vehicles[].battery_pct": About("column", "%", "What is left. Absent: not logged."),
    "vehicles[].beacon_age_s": About("column", "s", "Since its last beacon; 0 below 0.35 s. Absent: not logged."),
    "vehicles[].estimate_off.east_m": About("column", "m", "Where its autopilot believed to be, less where it was."),
    "vehicles[].estimate_off.north_m": About("column", "m", "The same."),
    "vehicles[].estimate_off.up_m": About("column", "m", "The same."),
    "vehicles[].scans.start_deg": About("number", "deg", "First sector, clockwise from the nose. No scans: absent."),
    "vehicles[].scans.step_deg": About("number", "deg", "From a sector to the next, clockwise."),
    "vehicles[].scans.sectors": About("integer", "", "Of each scan."),
    "vehicles[].scans.rows": About("differences", "", "The row of each scan; two scans a second are kept."),
    "vehicles[].scans.ranges_dm": About("array of integers", "dm", "Scan by scan. 0: nothing there; -1: not measured."),
    "links": About(
        "array of arrays",
        "",
        "Of each pair that was ever linked, in range and not cut by a `partition` fault: its two ids, then the "
        "differences of the rows in which the link comes, goes, comes ...",
    ),
    "events[].time_s": About("number", "s", "When; in the order of time."),
    "events[].kind": About(
        "text", "", "fault, lead, phase, lost, contact, closest, parted, text or end. A later version may have more."
    ),
    "events[].vehicles": About("array of integers", "", "Ids that it is about."),
    "events[].text": About("text", "", "What happened; of `lead` with its reason."),
    "events[].severity": About("text", "", "MAVLink's, of a `text`; else absent."),
    "stand_report": About("text", "", "The forester's page, from the run folder. Absent: the flight surveyed nothing."),
    "chart": About("object", "", "The reader's own map, of `report --map`. Absent: there is none."),
    "chart.tiles": About("object", "", "Data URLs of web Mercator's tiles, by zoom/x/y, y from the north; or `image`."),
    "by_vehicle[].id": About("integer", "", "1 ... n. Of a flight under way there are no rows."),
    "by_vehicle[].way_m": About("number", "m", "Way flown, in the air."),
    "by_vehicle[].nearest_m": About("number or null", "m", "Least distance to another in flight; null: it met none."),
    "by_vehicle[].nearest_id": About("integer or null", "", "Which one that was."),
    "by_vehicle[].nearest_at_s": About("number or null", "s", "When."),
    "by_vehicle[].bark_m": About("number or null", "m", "Least level distance to a trunk; null: never within 20 m."),
    "by_vehicle[].bark_at_s": About("number or null", "s", "When."),
    "by_vehicle[].behind_s": About("number or null", "s", "Arrived at d2 so long after the first; null: never."),
    "by_vehicle[].holds": About("integer or null", "", "Times that it said `hold: ...`; null: not logged."),
    "by_vehicle[].beacons_lost": About("number or null", "", "Share that it missed of those sent in its range."),
    "by_vehicle[].battery_pct": About("number or null", "%", "What was left at the end."),
    "by_vehicle[].last_text": About("text", "", "What it said last; empty: nothing, or not logged."),
    "by_vehicle[].last_text_s": About("number or null", "s", "When."),
}

STUDY: Final[dict[str, About]] = {
    "format": About("text", "", '"understory-study".'),
    "version": About("integer", "", "Of this layout."),
    "made_by": About("text", "", "Program and version."),
    "title": About("text", "", "The study's name."),
    "answer": About("text", "", "What it found, in a sentence."),
    "succeeded": About("boolean or null", "", "Every limit is reached; null: it has none."),
    "must": About(
        "array of objects",
        "",
        "must.json, with names and units as people see them: what its cases must reach, and what they did.",
    ),
    "figures[].name": About("text", "", "With its unit."),
    "figures[].cases[].name": About("text", "", "Run, and the settings that tell its cases apart."),
    "figures[].cases[].mean": About("number", "", "Over the seeds."),
    "figures[].cases[].low": About("number or null", "", "95 % interval of the mean, Student's t; null below two."),
    "figures[].cases[].high": About("number or null", "", "The same."),
    "figures[].cases[].seeds": About("array of arrays", "", "Seed, value and, where there is one, the replay's path."),
    "worst[].case": About("text", "", "As above."),
    "worst[].seed": About("integer", "", "sim.seed."),
    "worst[].why": About("text", "", "Why it is worth a look."),
    "worst[].verdict": About("text", "", "As flown; why it never ended; empty for point masses."),
    "worst[].replay": About("text or null", "", "Path of its replay from the page; null: it was not flown again."),
}
