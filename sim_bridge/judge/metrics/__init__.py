"""Figures of one flight, from ground truth alone: nothing that a vehicle believes goes in.

Terms, used in the definitions of `FIGURES`:

- A vehicle is *alive* in a tick when its companion answered in that tick (and its autopilot, where that is
  external, in the last 3 s) and it has run into nothing by then, and *airborne* when it is off the ground. A vehicle
  whose companion is dead still flies, hovers and gets in the way, but cannot lead.
- The *graph* G of a tick has the alive vehicles as its vertices, and a link between two of them when both are
  airborne and their distance is at most the smaller of their two radio ranges (section III of the paper), or the
  share of it that trunks between them leave (sim.radio_trunks).
- An *acting leader* is an alive vehicle whose last beacon claims an established lead; a beacon from before its
  companion stalled claims nothing any more. Where one is needed and several act, it is the one with the lowest id.
- The *phase* of a tick is what that leader announces; without one, the highest that a vehicle alive announces.
- *Departure* is the first tick in which an acting leader announces TRANSIT (or COVERAGE).
- The swarm is *gathered* when all alive vehicles, at least one, are airborne, about d2 as closely as it was about
  d1, and one component of G. That is, within radio.transit_range_m of d2 or, if the swarm was wider at departure,
  within the distance that its farthest vehicle then had from d1 and twice route.arrival_distance_m, by which
  the leader may stand off at either end.
- A vehicle is *covering* when it is alive, airborne, and its distance to d2 (level, to the vertical axis through
  it, for a ring; in space for a sphere) is coverage.radius_m within 2 m or a tenth of it, whichever is more. One
  whose companion is dead may hang on the ring: it covers nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from mission.schema.faults import FaultKind
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics.arrays import Bools, Floats, Ints
from sim_bridge.judge.metrics.arrival import arrival, gathered_within_m, overhead, strayed, visited
from sim_bridge.judge.metrics.coverage import (
    SETTLED_RATIO,
    coverage_figures,
    covers,
    ideal_gap_deg,
    last_of,
    ring_gap_deg,
    sphere_covering_bound_deg,
    sphere_gap_deg,
    tolerance_m,
)
from sim_bridge.judge.metrics.fence import fence_exceeded_m
from sim_bridge.judge.metrics.figures import FIGURES, Figure
from sim_bridge.judge.metrics.graph import connectivity, leaders_together, least_vertex_connectivity, partings
from sim_bridge.judge.metrics.leadership import (
    acting_leader,
    departure,
    longest_s,
    swarm_phase,
    tick_lengths_s,
    visits_of,
)
from sim_bridge.judge.metrics.pairs import CONTACT_M, Pairs, closest, in_flight, links, look_at_pairs, separation_m
from sim_bridge.judge.metrics.places import ideal_among_trees_deg, ideals_among_trees_deg
from sim_bridge.judge.metrics.trunks import least_box_clearance_m, least_clearance_m
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.trunk_attenuation import range_share

__all__ = [
    "CONTACT_M",
    "FIGURES",
    "SETTLED_RATIO",
    "Bools",
    "Figure",
    "Floats",
    "Ints",
    "Metrics",
    "acting_leader",
    "covers",
    "departure",
    "gathered_within_m",
    "ideal_among_trees_deg",
    "ideal_gap_deg",
    "links",
    "measure",
    "ring_gap_deg",
    "separation_m",
    "sphere_covering_bound_deg",
    "sphere_gap_deg",
    "swarm_phase",
    "tolerance_m",
    "with_columns",
    "without_cut_links",
]


@dataclass(frozen=True, slots=True)
class Metrics:
    """Figures of one flight, as FIGURES defines them. None: it did not happen, or there was nothing to measure."""

    n: int
    lost: tuple[int, ...]
    armed: tuple[int, ...]
    aloft: tuple[int, ...]
    strayed: tuple[int, ...]
    landed_early: tuple[int, ...]
    sim_time_s: float
    arrived: bool
    visited: int
    absent: tuple[int, ...]
    straight_time_s: float | None
    arrival_leader_s: float | None
    arrival_last_s: float | None
    overhead_leader: float | None
    overhead_last: float | None
    min_separation_m: float | None
    closest: tuple[int, ...]
    closest_at_s: float | None
    contacts: int
    contacts_vehicles: int
    contacts_trunks: int
    contacts_crowns: int
    contacts_boxes: int
    contacts_ground: int
    contacts_steered: int
    fence_exceeded_m: float
    trunk_clearance_min_m: float | None
    box_clearance_min_m: float | None
    speed_mean_transit_mps: float | None
    connected_fraction_transit: float | None
    connected_fraction_coverage: float | None
    splits: int
    longest_gap_s: float
    rejoin_s: float | None
    lambda2_mean_transit: float | None
    vertex_connectivity_coverage: int | None
    coverage_gap_deg: float | None
    coverage_gap_ideal_deg: float | None
    coverage_radius_error_m: float | None
    coverage_settled_s: float | None
    uncovering: tuple[int, ...]
    acting_leaders_max: int
    acting_leaders_overlap_s: float
    leaders_together_s: float
    leader_changes: int
    leaderless_max_s: float

    def as_dict(self) -> dict[str, Any]:
        """Name -> value in the order of declaration, ready for JSON."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def measure(
    recording: Recording,
    mission: Mission,
    stand: Stand | None = None,
    faults: Sequence[FaultEvent] = (),
    end_s: float | None = None,
) -> Metrics:
    """Every figure of the flight `recording` of `mission`, in which `faults` happened.

    `stand`: the mission's, where it has been made already. `end_s`: the mission was over then, and what was recorded
    after it is neither coverage nor early (None: nothing was).

    ValueError: a time or position is not finite, or time runs backwards.
    """
    recording = with_columns(recording, mission.swarm.size)
    _check(recording)
    time_s = recording.time_s
    phase = swarm_phase(recording)
    stand = stand_of(mission) if stand is None else stand
    pairs = look_at_pairs(recording, mission, range_share(mission.sim, stand))
    in_time = time_s <= (np.inf if end_s is None else end_s)
    transit, coverage = phase == SwarmPhase.TRANSIT, (phase == SwarmPhase.COVERAGE) & in_time
    under_way = transit | coverage
    if mission.route.stops:  # what is said of coverage is said of d2
        coverage &= visits_of(recording) == len(mission.visits) - 1
    closest_ids, closest_at_s = closest(recording, pairs)
    connected, lambda2 = connectivity(recording, pairs, transit)
    came = arrival(recording, mission, connected)
    covered = coverage_figures(recording, mission, coverage, partial(ideals_among_trees_deg, mission, stand))
    heard = without_cut_links(pairs, time_s, faults)
    apart = partings(time_s, _in_touch(recording, pairs, heard, connected), under_way)
    ran_into = {what: int((recording.touched[-1:] == code).sum()) for code, what in enumerate(TOUCHED)}
    collisions = max(len(pairs.touches), (ran_into["vehicle"] + 1) // 2)  # the bridge also looks between ticks
    acting = recording.acting & recording.agent_alive
    leaders = acting.sum(axis=1)
    return Metrics(
        n=recording.pos_ned_m.shape[1],
        lost=_ids(~recording.agent_alive[-1:]),
        sim_time_s=float(time_s[-1]) if time_s.size else 0.0,
        armed=_ids(recording.armed[-1:]),
        aloft=_ids(~recording.on_ground[-1:]),
        strayed=strayed(recording, mission),
        landed_early=_landed_early(recording, mission, in_time),
        arrived=came.last_s is not None,
        visited=visited(recording, mission),
        absent=came.absent,
        straight_time_s=came.straight_s,
        arrival_leader_s=came.leader_s,
        arrival_last_s=came.last_s,
        overhead_leader=overhead(came.leader_s, came.straight_s),
        overhead_last=overhead(came.last_s, came.straight_s),
        min_separation_m=_finite_or_none(pairs.separation_m.min(initial=np.inf)),
        closest=closest_ids,
        closest_at_s=closest_at_s,
        contacts=collisions + sum(ran_into[what] for what in ("trunk", "crown", "box", "ground")),
        contacts_vehicles=collisions,
        contacts_trunks=ran_into["trunk"],
        contacts_crowns=ran_into["crown"],
        contacts_boxes=ran_into["box"],
        contacts_ground=ran_into["ground"],
        contacts_steered=_contacts_steered(recording),
        fence_exceeded_m=fence_exceeded_m(recording, mission),
        trunk_clearance_min_m=least_clearance_m(recording, stand),
        box_clearance_min_m=least_box_clearance_m(recording, stand),
        speed_mean_transit_mps=_mean(_level_speeds_mps(recording, transit)),
        connected_fraction_transit=_mean(connected[transit]),
        connected_fraction_coverage=_mean(connected[coverage]),
        lambda2_mean_transit=_mean(lambda2[transit & ~np.isnan(lambda2)]),
        splits=apart.count,
        longest_gap_s=apart.longest_s,
        rejoin_s=apart.rejoined_s,
        vertex_connectivity_coverage=least_vertex_connectivity(recording, pairs, last_of(time_s, coverage)),
        coverage_gap_deg=covered.gap_deg,
        coverage_gap_ideal_deg=covered.gap_ideal_deg,
        coverage_radius_error_m=covered.radius_error_m,
        coverage_settled_s=covered.settled_s,
        uncovering=covered.uncovering,
        acting_leaders_max=int(leaders.max(initial=0)),
        acting_leaders_overlap_s=float(tick_lengths_s(time_s)[leaders > 1].sum()),
        leaders_together_s=longest_s(time_s, leaders_together(recording, heard)),
        leader_changes=int(np.count_nonzero(np.diff(acting.argmax(axis=1)[leaders > 0]))),
        leaderless_max_s=longest_s(
            time_s, (leaders == 0) & (phase >= SwarmPhase.TRANSIT) & (phase <= SwarmPhase.COVERAGE)
        ),
    )


def with_columns(recording: Recording, n: int) -> Recording:
    """`recording`, or one of no ticks and `n` vehicles: without a tick an array cannot tell how many there are."""
    if len(recording.time_s):
        return recording
    values = {field.name: getattr(recording, field.name) for field in dataclasses.fields(recording)}
    shapes = {"time_s": (0,), "pos_ned_m": (0, n, 3), "vel_ned_mps": (0, n, 3)}
    return Recording(**{name: value.reshape(shapes.get(name, (0, n))) for name, value in values.items()})


def _in_touch(recording: Recording, pairs: Pairs, heard: Pairs, connected: Bools) -> Bools:
    """(T,) all alive vehicles are one component of G with the links `heard`; `connected`: with all of `pairs`."""
    if np.array_equal(heard.links, pairs.links):
        return connected
    return connectivity(recording, heard, np.zeros(connected.shape, np.bool_))[0]


def without_cut_links(pairs: Pairs, time_s: Floats, faults: Sequence[FaultEvent]) -> Pairs:
    """`pairs` of the ticks at `time_s` without the links that partitions cut while they last."""
    links = pairs.links.copy()
    for fault in faults:
        if fault.kind is not FaultKind.PARTITION:
            continue
        cut = np.isin(pairs.first + 1, fault.vehicles) != np.isin(pairs.second + 1, fault.vehicles)
        links[np.ix_(_lasts(fault, time_s), cut)] = False
    return dataclasses.replace(pairs, links=links)


def _lasts(fault: FaultEvent, time_s: Floats) -> Bools:
    """(T,) it is in force."""
    lasts: Bools = (time_s >= fault.at_s) & (time_s <= (np.inf if fault.until_s is None else fault.until_s))
    return lasts


def _check(recording: Recording) -> None:
    time_s = recording.time_s
    if not np.isfinite(time_s).all() or (np.diff(time_s) < 0.0).any():
        raise ValueError("time_s: must be finite and never run backwards")
    bad = np.argwhere(~np.isfinite(recording.pos_ned_m).all(axis=2))
    if bad.size:
        tick, column = bad[0]
        raise ValueError(f"pos_ned_m: vehicle {column + 1} at {time_s[tick]:.2f} s: must be finite")


def _contacts_steered(recording: Recording) -> int:
    """Vehicles that first ran into something in a tick before which their companions had answered."""
    has_touched = recording.touched > 0
    begins = has_touched[1:] & ~has_touched[:-1] & recording.agent_alive[:-1]
    return int(begins.any(axis=0).sum())


def _landed_early(recording: Recording, mission: Mission, in_time: Bools) -> tuple[int, ...]:
    """By what each announced when it was down: later, on the ground, it takes a phase from the others' beacons."""
    ticks = np.arange(len(recording.time_s))[:, None]
    last_flight = np.where(in_flight(recording, mission), ticks, -1).max(axis=0, initial=-1)
    has_flown = np.logical_or.accumulate(~recording.on_ground, axis=0)
    has_landed = np.maximum.accumulate(recording.phase, axis=0) >= SwarmPhase.LAND
    down = recording.on_ground & recording.agent_alive & has_flown & ~has_landed & (ticks > last_flight)
    return _ids(down[in_time].any(axis=0, keepdims=True))


def _level_speeds_mps(recording: Recording, wanted: Bools) -> Floats:
    """Of the alive airborne vehicles in the ticks that are `wanted` (T,)."""
    flying = wanted[:, None] & recording.agent_alive & ~recording.on_ground
    north_mps, east_mps = recording.vel_ned_mps[..., 0][flying], recording.vel_ned_mps[..., 1][flying]
    speeds_mps: Floats = np.hypot(north_mps, east_mps)
    return speeds_mps


def _ids(flag: Bools) -> tuple[int, ...]:
    """Of the columns with `flag` (1, n) in the last tick; none without a tick."""
    return tuple(int(k) + 1 for k in np.flatnonzero(flag[:1].any(axis=0)))


def _mean(values: Bools | Floats) -> float | None:
    return float(values.mean()) if values.size else None


def _finite_or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
