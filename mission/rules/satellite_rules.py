"""Rules of which vehicles have satellites, and of what the others fly by: start positions, ranges, or trunks alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import combinations

from mission.rules.flight_rules import START_OFF_M
from mission.schema.conflict import Conflict, conflict
from mission.schema.sim import Sky
from mission.schema.tables import Gnss, MissionTables, Ranging

PRIORITIES_MAX = 127  # each twice, with GNSS and without, in a byte of a beacon
# Of separation.soft_m: neighbours fly 10 to 12 m apart where it is 10 m, and four vehicles with ranges to 10 m only
# did not keep their places (seed 1); with 12 m they did
REACH_LEAST = 1.5


def conflicts(mission: MissionTables) -> Iterator[Conflict]:
    """Every law that `mission` breaks."""
    gnss, size = mission.swarm.gnss, mission.swarm.size
    if gnss is Gnss.LEADER and not mission.swarm.leader_priority:
        yield conflict(mission, ("swarm.gnss", "swarm.leader_priority"), "needs the leader that has GNSS, first")
    if isinstance(gnss, tuple):
        if not gnss:
            yield conflict(mission, ("swarm.gnss",), "needs one vehicle at least: no other knows where d2 is")
        elif max(gnss) > size:
            yield conflict(mission, ("swarm.gnss", "swarm.size"), "must name vehicles of the swarm")
    if mission.ranging is not None and not mission.ranging.radio:
        yield from _no_radio(mission)
    if not mission.flies_by_ranges:
        if mission.sim.satellites.crowns is Sky.SHADE:
            must = "must be clear: a swarm of which all have GNSS has nothing else to fly by"
            yield conflict(mission, ("sim.satellites.crowns", "swarm.gnss", "swarm.size"), must)
        return
    if len(mission.swarm.leader_priority) > PRIORITIES_MAX:
        must = f"must be at most {PRIORITIES_MAX} ids where not all have GNSS"
        yield conflict(mission, ("swarm.leader_priority", "swarm.gnss"), must)
    if mission.ranging is None:
        must = (
            "needs [ranging], for where each stands at the start: without satellite positions vehicles find one "
            "another by range radios, or by trunks alone (radio = false)"
        )
        yield conflict(mission, ("swarm.gnss",), must)
    else:
        yield from _ranging(mission, mission.ranging)


def _ranging(mission: MissionTables, ranging: Ranging) -> Iterator[Conflict]:
    size = mission.swarm.size
    if len(ranging.start_enu_m) < size:
        missing = f"has {len(ranging.start_enu_m)} positions"
        yield conflict(mission, ("swarm.size",), f"ranging.start_enu_m {missing}: each vehicle needs one")
    else:
        starts, least_m = ranging.start_enu_m[:size], mission.separation.hard_m + START_OFF_M
        for (i, a), (j, b) in combinations(enumerate(starts, start=1), 2):
            if math.dist(a, b) < least_m:
                must = f"has vehicles {i} and {j} {math.dist(a, b):.1f} m apart: must be at least {least_m:.1f} m"
                yield conflict(mission, ("ranging.start_enu_m", "separation.hard_m"), must)
    if ranging.radio and ranging.reach_m < REACH_LEAST * mission.separation.soft_m:
        must = f"must be at least {REACH_LEAST:g} times the separation kept: neighbours fly farther apart than that"
        yield conflict(mission, ("ranging.reach_m", "separation.soft_m"), must)
    if any(pos_enu_m[2] != 0.0 for pos_enu_m in ranging.start_enu_m):
        must = "must be 0 up, each: vehicles stand on the ground, wherever it is"
        yield conflict(mission, ("ranging.start_enu_m",), must)


def _no_radio(mission: MissionTables) -> Iterator[Conflict]:
    if mission.swarm.size == 1:
        return  # it has nobody to find, by whatever
    if not mission.flies_by_ranges:
        must = "must be true where all have GNSS: without range radios leave [ranging] out there"
        yield conflict(mission, ("ranging.radio", "swarm.gnss"), must)
    elif mission.sensing is None:
        yield conflict(mission, ("ranging.radio",), "must be true without [sensing]: no vehicle sees trunks")
    elif not mission.shares_trunks:
        must = "must be true unless the sensor tells raw scans: by sectors trunks look alike"
        yield conflict(mission, ("ranging.radio", "sensing.sensor"), must)
