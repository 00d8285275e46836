"""What one flight achieved, in figures, from ground truth alone: nothing that a vehicle believes goes in.

Terms, used in the definitions of `Metrics`:

- A vehicle is *alive* in a tick when its companion answered in that tick (and its autopilot, where that is
  external, in the last 3 s) and it has not run into a trunk, a crown or the ground by then, and *airborne* when it is
  off the ground. A vehicle whose companion is dead still flies,
  hovers and gets in the way, but cannot lead.
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
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge.metrics.arrays import Bools, Floats, Ints
from sim_bridge.judge.metrics.arrival import arrival, gathered_within_m, overhead, strayed, visited
from sim_bridge.judge.metrics.coverage import (
    GAP_WINDOW_S,
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
from sim_bridge.judge.metrics.graph import connectivity, least_vertex_connectivity, partings
from sim_bridge.judge.metrics.leadership import (
    acting_leader,
    departure,
    longest_s,
    swarm_phase,
    tick_lengths_s,
    visits_of,
)
from sim_bridge.judge.metrics.pairs import CONTACT_M, links, look_at_pairs, separation_m
from sim_bridge.judge.metrics.places import ideal_among_trees_deg, ideals_among_trees_deg
from sim_bridge.judge.metrics.trunks import least_clearance_m
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.trunk_attenuation import range_share

__all__ = [
    "CONTACT_M",
    "GAP_WINDOW_S",
    "SETTLED_RATIO",
    "Bools",
    "Floats",
    "Ints",
    "Metrics",
    "acting_leader",
    "covers",
    "definitions",
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
]


@dataclass(frozen=True, slots=True)
class Metrics:
    """Figures of one flight. None: it did not happen, or there was nothing to measure."""

    n: Annotated[int, "Vehicles in the recording."]
    lost: Annotated[tuple[int, ...], "Ids of the vehicles that were not alive any more in the last tick."]
    armed: Annotated[tuple[int, ...], "Ids of the vehicles that were armed in the last tick."]
    aloft: Annotated[tuple[int, ...], "Ids of the vehicles that were off the ground in the last tick."]
    strayed: Annotated[
        tuple[int, ...],
        "Where the mission lands: ids of the vehicles that were on the ground elsewhere in the last tick. With "
        "route.at_end = return that is further from d1, level, than the gathered swarm is from d2 and twice "
        "route.arrival_distance_m (the leader may stand off, and gives way to one that hangs there); with land, "
        "further from d2 than that and than the ring or sphere, too.",
    ]
    landed_early: Annotated[
        tuple[int, ...],
        "Ids of the vehicles alive and on the ground in the last tick that had flown, and had announced no phase LAND: "
        "they came down for a reason of their own (no majority, an order, the battery), not at the mission's end.",
    ]
    sim_time_s: Annotated[float, "Simulated time of the last tick."]
    arrived: Annotated[
        bool,
        "An acting leader came within route.arrival_distance_m of d2, and then or later the swarm was gathered.",
    ]
    visited: Annotated[
        int,
        "Places to cover, d2 among them, at which an acting leader was within route.arrival_distance_m and announced "
        "COVERAGE: 1, and one more for each of route.stops. All other figures of arrival and coverage are of d2.",
    ]
    absent: Annotated[
        tuple[int, ...],
        "Ids of the vehicles that never came to d2: at no time from the arrival of the leader on alive, airborne and "
        "as close to d2 as the gathered swarm is.",
    ]
    straight_time_s: Annotated[
        float | None,
        "From the acting leader's place at departure straight towards d2 at route.vel_leader_mps, until it is within "
        "route.arrival_distance_m: what arrival_leader_s would be without turns, pauses and time to speed up. With "
        "route.stops over these, and with the time at each.",
    ]
    arrival_leader_s: Annotated[
        float | None,
        "From departure until an acting leader, whichever it is then, is first within route.arrival_distance_m of d2.",
    ]
    arrival_last_s: Annotated[
        float | None,
        "From departure until the swarm is first gathered, not before the arrival of the leader.",
    ]
    overhead_leader: Annotated[
        float | None,
        "arrival_leader_s / straight_time_s - 1. One vehicle alone is above 0 too: it speeds up, and slows down "
        "before d2.",
    ]
    overhead_last: Annotated[float | None, "arrival_last_s / straight_time_s - 1."]
    min_separation_m: Annotated[
        float | None,
        "Least distance between the centres of two vehicles in flight: each from when it has climbed above "
        "half the height of d1 until it touches the ground. Vehicles with a dead companion count.",
    ]
    contacts: Annotated[int, "contacts_vehicles + contacts_trunks + contacts_crowns + contacts_ground."]
    contacts_vehicles: Annotated[
        int,
        "Times that two vehicles came closer than 0.6 m, centre to centre, with one of them airborne. A contact counts "
        "once for as long as it lasts.",
    ]
    contacts_trunks: Annotated[
        int,
        "Vehicles that came closer than 0.35 m to the surface of a trunk, below its top and off the ground. In the "
        "bridge such a vehicle falls and is lost; the first thing that one runs into counts, and nothing after it.",
    ]
    contacts_crowns: Annotated[int, "Vehicles whose centre came into a crown, between its base and its top."]
    contacts_ground: Annotated[
        int,
        "With [sensing]: vehicles that met the ground faster than a landing does, at more than 1 m/s level or 2.5 m/s "
        "down.",
    ]
    trunk_clearance_min_m: Annotated[
        float | None,
        "Least level distance from the centre of an airborne vehicle to the surface of a trunk that reaches higher "
        "than it, before it ran into anything. None: never within 20 m.",
    ]
    speed_mean_transit_mps: Annotated[
        float | None,
        "Level speed of the alive airborne vehicles over the ground, mean over phase TRANSIT.",
    ]
    connected_fraction_transit: Annotated[
        float | None,
        "Share of the ticks of phase TRANSIT in which all alive vehicles were one component of G. One that "
        "sits on the ground is apart; one alone is connected.",
    ]
    connected_fraction_coverage: Annotated[float | None, "The same in phase COVERAGE."]
    splits: Annotated[
        int, "Times that the alive vehicles ceased to be one component of G in phase TRANSIT or COVERAGE."
    ]
    longest_gap_s: Annotated[
        float, "Longest time from such a split until they were one component again, or the flight was over."
    ]
    rejoin_s: Annotated[
        float | None, "The same of those splits that ended in the flight. None with splits above 0: none did."
    ]
    lambda2_mean_transit: Annotated[
        float | None,
        "Algebraic connectivity of G, the second smallest eigenvalue of its unweighted Laplacian: mean over "
        "the ticks of phase TRANSIT with at least two alive vehicles.",
    ]
    vertex_connectivity_coverage: Annotated[
        int | None,
        "Vertex connectivity k of G, the least in the last 5 s of phase COVERAGE with at least two alive vehicles: so "
        "many vehicles must be lost, at least, until those left are not one component. 0: they are not one now; from 2 "
        "on, everyone has two ways to everyone else. Where all hear one another it is one less than there are.",
    ]
    coverage_gap_deg: Annotated[
        float | None,
        "Mean over the last 5 s of phase COVERAGE of the gap that the covering vehicles leave. Ring: the "
        "largest difference in azimuth about d2 between neighbours. Sphere: the largest angle at d2 from any "
        "direction to the nearest vehicle.",
    ]
    coverage_gap_ideal_deg: Annotated[
        float | None,
        "The smallest gap possible with as many vehicles as are alive at the end of phase COVERAGE. Ring: "
        "360 / n or, where trunks stand in it, the smallest that leaves their bearings out; a bearing is free where a "
        "vehicle that covers keeps sensing.vehicle_radius_m and margin_m from every trunk. Sphere: the covering "
        "radius, best known up to n = 20, Fejes Toth's lower bound beyond.",
    ]
    coverage_radius_error_m: Annotated[
        float | None,
        "Greatest difference over the last 5 s of phase COVERAGE between coverage.radius_m and the distance to d2 of "
        "an alive airborne vehicle: level, to d2's vertical axis, for a ring; in space for a sphere.",
    ]
    coverage_settled_s: Annotated[
        float | None,
        "From the start of phase COVERAGE until all alive vehicles are covering, and the gap is at most 1.15 "
        "(ring) or 1.2 (sphere) times the ideal for those alive, and both stay so to the end of the phase.",
    ]
    acting_leaders_max: Annotated[int, "Most vehicles that acted as leader in the same tick."]
    acting_leaders_overlap_s: Annotated[float, "Total time with more than one acting leader."]
    leader_changes: Annotated[
        int, "Times that the acting leader was another than the one before; the first does not count."
    ]
    leaderless_max_s: Annotated[float, "Longest time within phases TRANSIT and COVERAGE without an acting leader."]

    def as_dict(self) -> dict[str, Any]:
        """Name -> value in the order of declaration, ready for JSON."""
        values = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def definitions() -> dict[str, str]:
    """Name -> definition of every figure in `Metrics`, for the documentation."""
    hints = get_type_hints(Metrics, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in dataclasses.fields(Metrics)}


def measure(recording: Recording, mission: Mission, stand: Stand | None = None) -> Metrics:
    """Every figure of the flight `recording` of `mission`; `stand`: the mission's, where it has been made already.

    ValueError: a time or position is not finite, or time runs backwards.
    """
    recording = with_columns(recording, mission.swarm.size)
    _check(recording)
    time_s = recording.time_s
    phase = swarm_phase(recording)
    stand = stand_of(mission) if stand is None else stand
    pairs = look_at_pairs(recording, mission, range_share(mission.sim, stand))
    transit, coverage = phase == SwarmPhase.TRANSIT, phase == SwarmPhase.COVERAGE
    under_way = transit | coverage
    if mission.route.stops:  # what is said of coverage is said of d2
        coverage &= visits_of(recording) == len(mission.visits) - 1
    connected, lambda2 = connectivity(recording, pairs, transit)
    came = arrival(recording, mission, connected)
    covered = coverage_figures(recording, mission, coverage, partial(ideals_among_trees_deg, mission, stand))
    apart = partings(time_s, connected, under_way)
    ran_into = {what: int((recording.touched[-1:] == code).sum()) for code, what in enumerate(TOUCHED)}
    acting = recording.acting & recording.agent_alive
    leaders = acting.sum(axis=1)
    return Metrics(
        n=recording.pos_ned_m.shape[1],
        lost=_ids(~recording.agent_alive[-1:]),
        sim_time_s=float(time_s[-1]) if time_s.size else 0.0,
        armed=_ids(recording.armed[-1:]),
        aloft=_ids(~recording.on_ground[-1:]),
        strayed=strayed(recording, mission),
        landed_early=_landed_early(recording),
        arrived=came.last_s is not None,
        visited=visited(recording, mission),
        absent=came.absent,
        straight_time_s=came.straight_s,
        arrival_leader_s=came.leader_s,
        arrival_last_s=came.last_s,
        overhead_leader=overhead(came.leader_s, came.straight_s),
        overhead_last=overhead(came.last_s, came.straight_s),
        min_separation_m=_finite_or_none(pairs.separation_m.min(initial=np.inf)),
        contacts=pairs.contacts + sum(ran_into.values()) - ran_into[""],
        contacts_vehicles=pairs.contacts,
        contacts_trunks=ran_into["trunk"],
        contacts_crowns=ran_into["crown"],
        contacts_ground=ran_into["ground"],
        trunk_clearance_min_m=least_clearance_m(recording, stand),
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
        acting_leaders_max=int(leaders.max(initial=0)),
        acting_leaders_overlap_s=float(tick_lengths_s(time_s)[leaders > 1].sum()),
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


def _check(recording: Recording) -> None:
    time_s = recording.time_s
    if not np.isfinite(time_s).all() or (np.diff(time_s) < 0.0).any():
        raise ValueError("time_s: must be finite and never run backwards")
    bad = np.argwhere(~np.isfinite(recording.pos_ned_m).all(axis=2))
    if bad.size:
        tick, column = bad[0]
        raise ValueError(f"pos_ned_m: vehicle {column + 1} at {time_s[tick]:.2f} s: must be finite")


def _landed_early(recording: Recording) -> tuple[int, ...]:
    has_flown = (~recording.on_ground).any(axis=0)
    down = recording.on_ground[-1:] & recording.agent_alive[-1:] & has_flown
    return _ids(down & (recording.phase[-1:] < SwarmPhase.LAND))


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
