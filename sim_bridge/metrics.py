"""What one flight achieved, in figures, from ground truth alone: nothing that a vehicle believes goes in.

Terms, used in the definitions of `Metrics`:

- A vehicle is *alive* in a tick when its companion answered in that tick, and *airborne* when it is off the
  ground. A vehicle whose companion is dead still flies, hovers and gets in the way, but leads nobody.
- The *graph* G of a tick has the alive vehicles as its vertices, and a link between two of them when both are
  airborne and their distance is at most the smaller of their two radio ranges (section III of the paper).
- An *acting leader* is an alive vehicle whose last beacon claims an established lead. Where one is needed and
  several act, it is the one with the lowest id.
- The *phase* of a tick is what that leader announces; while nobody acts, the highest that anybody alive does.
- *Departure* is the first tick in which an acting leader announces TRANSIT (or COVERAGE).
- The swarm is *gathered* when all alive vehicles, at least one, are airborne, about d2 as closely as it was about
  d1, and one component of G. That is, within radio.transit_range_m of d2 or, if the swarm was wider at departure,
  within the distance that its farthest vehicle then had from d1 and twice route.arrival_distance_m, by which
  the leader may stand off at either end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from companion.core.types import SwarmPhase
from mission.frames import Vec3, enu_to_ned
from mission.model import CoverageShape, Mission
from sim_bridge.recording import Recording

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

# Two level F450 (0.45 m between opposite motors, 10 in propellers) touch at 0.57 m side by side with equal
# headings, at 0.70 m arm against arm: closer than this, hardly any pair of headings is free of contact
CONTACT_M = 0.6
TREE_CONTACT_M = 0.35  # half the 0.70 m from propeller tip to propeller tip along an arm
# A gap this close to the ideal: every vehicle has found its place, give or take.
SETTLED_RATIO = {CoverageShape.RING: 1.15, CoverageShape.SPHERE: 1.2}
GAP_WINDOW_S = 5.0  # long enough to average the hunting of the last metre
ROUNDING = 1e-6  # of a cosine, generously
PAIRS_AT_ONCE = 1_000_000  # bounds memory to tens of megabytes, whatever n and T

# Least angle within which n points can have every direction: best known coverings, degrees, n = 1, 2, ...
SPHERE_COVERING_DEG = (
    *(180.0, 90.0, 90.0, 70.5288, 63.4349, 54.7356, 51.0265, 48.1395, 45.8789, 42.3078),
    *(41.4272, 37.3774, 37.0685, 34.9379, 34.0399, 32.8988, 32.0929, 31.0132, 30.3686, 29.6231),
)


@dataclass(frozen=True, slots=True)
class Metrics:
    """Figures of one flight. None: it did not happen, or there was nothing to measure."""

    n: Annotated[int, "Vehicles in the recording."]
    lost: Annotated[tuple[int, ...], "Ids of the vehicles whose companion did not answer any more in the last tick."]
    sim_time_s: Annotated[float, "Simulated time of the last tick."]
    arrived: Annotated[
        bool,
        "An acting leader came within route.arrival_distance_m of d2, and then or later the swarm was gathered.",
    ]
    straight_time_s: Annotated[
        float | None,
        "From the acting leader's place at departure straight towards d2 at route.vel_leader_mps, until it is within "
        "route.arrival_distance_m: what arrival_leader_s would be without turns, pauses and time to speed up.",
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
    contacts: Annotated[
        int,
        "Times that two vehicles came closer than 0.6 m, centre to centre, or that one came closer than "
        "0.35 m to the surface of a trunk, at any moment with one of those involved airborne. A contact "
        "counts once for as long as it lasts.",
    ]
    connected_fraction_transit: Annotated[
        float | None,
        "Share of the ticks of phase TRANSIT in which all alive vehicles were one component of G. One that "
        "sits on the ground is apart; one alone is connected.",
    ]
    connected_fraction_coverage: Annotated[float | None, "The same in phase COVERAGE."]
    lambda2_mean_transit: Annotated[
        float | None,
        "Algebraic connectivity of G, the second smallest eigenvalue of its unweighted Laplacian: mean over "
        "the ticks of phase TRANSIT with at least two alive vehicles.",
    ]
    coverage_gap_deg: Annotated[
        float | None,
        "Mean over the last 5 s of phase COVERAGE of the gap that alive airborne vehicles leave. Ring: the "
        "largest difference in azimuth about d2 between neighbours. Sphere: the largest angle at d2 from any "
        "direction to the nearest vehicle.",
    ]
    coverage_gap_ideal_deg: Annotated[
        float | None,
        "The smallest gap possible with as many vehicles as are alive at the end of phase COVERAGE. Ring: "
        "360 / n. Sphere: the covering radius, best known up to n = 20, Fejes Toth's lower bound beyond.",
    ]
    coverage_settled_s: Annotated[
        float | None,
        "From the start of phase COVERAGE until the gap is, and stays to the end of the phase, at most 1.15 "
        "(ring) or 1.2 (sphere) times the ideal for those alive.",
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
        return values | {"lost": list(self.lost)}


def definitions() -> dict[str, str]:
    """Name -> definition of every figure in `Metrics`, for the documentation."""
    hints = get_type_hints(Metrics, include_extras=True)
    return {field.name: get_args(hints[field.name])[1] for field in dataclasses.fields(Metrics)}


def measure(recording: Recording, mission: Mission) -> Metrics:
    """Every figure of the flight `recording` of `mission`.

    ValueError: a time or position is not finite, or time runs backwards.
    """
    recording = with_columns(recording, mission.swarm.size)
    _check(recording)
    time_s = recording.time_s
    phase = swarm_phase(recording)
    pairs = _pairs(recording, mission)
    transit = phase == SwarmPhase.TRANSIT
    connected, lambda2 = _connectivity(recording, pairs, transit)
    straight_s, leader_s, last_s = _arrivals(recording, mission, connected)
    gap_deg, ideal_deg, settled_s = _coverage(recording, mission, phase == SwarmPhase.COVERAGE)
    acting = recording.acting & recording.agent_alive
    leaders = acting.sum(axis=1)
    return Metrics(
        n=recording.pos_ned_m.shape[1],
        lost=tuple(int(k) + 1 for k in np.flatnonzero(~recording.agent_alive[-1:].all(axis=0))),
        sim_time_s=float(time_s[-1]) if time_s.size else 0.0,
        arrived=last_s is not None,
        straight_time_s=straight_s,
        arrival_leader_s=leader_s,
        arrival_last_s=last_s,
        overhead_leader=_overhead(leader_s, straight_s),
        overhead_last=_overhead(last_s, straight_s),
        min_separation_m=_finite_or_none(pairs.separation_m.min(initial=np.inf)),
        contacts=pairs.contacts + _tree_contacts(recording, mission),
        connected_fraction_transit=_mean(connected[transit]),
        connected_fraction_coverage=_mean(connected[phase == SwarmPhase.COVERAGE]),
        lambda2_mean_transit=_mean(lambda2[transit & ~np.isnan(lambda2)]),
        coverage_gap_deg=gap_deg,
        coverage_gap_ideal_deg=ideal_deg,
        coverage_settled_s=settled_s,
        acting_leaders_max=int(leaders.max(initial=0)),
        acting_leaders_overlap_s=float(_tick_lengths_s(time_s)[leaders > 1].sum()),
        leader_changes=int(np.count_nonzero(np.diff(acting.argmax(axis=1)[leaders > 0]))),
        leaderless_max_s=_longest_s(
            time_s, (leaders == 0) & (phase >= SwarmPhase.TRANSIT) & (phase <= SwarmPhase.COVERAGE)
        ),
    )


# --- who leads, and in which phase ------------------------------------------------------------------------------------


def acting_leader(recording: Recording) -> NDArray[np.int16]:
    """(T,) id of the acting leader, the lowest if several act; 0: nobody acts."""
    acting = recording.acting & recording.agent_alive
    return np.where(acting.any(axis=1), acting.argmax(axis=1) + 1, 0).astype(np.int16)


def swarm_phase(recording: Recording) -> NDArray[np.int8]:
    """(T,) SwarmPhase as the acting leader announces it, else the highest that anybody alive does; -1: none."""
    leader = acting_leader(recording)
    heard = np.where(recording.agent_alive, recording.phase, -1)
    announced = heard[np.arange(len(leader)), np.maximum(leader - 1, 0)]
    return np.where(leader > 0, announced, heard.max(axis=1, initial=-1)).astype(np.int8)


def departure(recording: Recording) -> tuple[int, int] | None:
    """Tick of the departure, and the column of the vehicle that leads it; None if the swarm never departed."""
    # LAND and RETURN without a TRANSIT before are an abort on the spot
    leaving = (recording.phase == SwarmPhase.TRANSIT) | (recording.phase == SwarmPhase.COVERAGE)
    leaving &= recording.acting & recording.agent_alive
    ticks = np.flatnonzero(leaving.any(axis=1))
    return (int(ticks[0]), int(leaving[ticks[0]].argmax())) if ticks.size else None


def _longest_s(time_s: Floats, flag: Bools) -> float:
    """Length of the longest run of ticks with `flag` (T,): a tick lasts until the next one."""
    edges = np.diff(np.concatenate(([False], flag, [False])).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    lengths_s = time_s[np.minimum(ends, len(time_s) - 1)] - time_s[starts] if starts.size else np.zeros(0)
    return float(lengths_s.max(initial=0.0))


def _tick_lengths_s(time_s: Floats) -> Floats:
    """(T,) time from each tick to the next; the last has none."""
    return np.append(np.diff(time_s), 0.0)[: len(time_s)]


# --- pairs of vehicles: separation, contacts, links -------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Pairs:
    """Over T ticks and the P = n (n - 1) / 2 pairs of vehicles."""

    first: Ints  # (P,) column of one vehicle
    second: Ints  # (P,) column of the other
    links: Bools  # (T, P) linked in G
    separation_m: Floats  # (T,) least distance of two vehicles in flight; inf: fewer than two
    contacts: int


def separation_m(recording: Recording, mission: Mission) -> Floats:
    """(T,) least centre distance between two vehicles in flight, as in min_separation_m; inf: fewer than two."""
    return _pairs(recording, mission).separation_m


def links(recording: Recording, tick: int) -> Ints:
    """(L, 2) columns of the vehicles that are linked in G at `tick`."""
    first, second = np.triu_indices(recording.pos_ned_m.shape[1], k=1)
    at = slice(tick, tick + 1) if tick >= 0 else slice(tick, tick + 1 or None)
    linked = _linked(recording, at, first, second, _distance_m(recording, at, first, second))[0]
    return np.stack((first[linked], second[linked]), axis=1)


def in_flight(recording: Recording, mission: Mission) -> Bools:
    """(T, n) airborne, and above half the height of d1 at least once since the last touch of the ground."""
    ticks = np.arange(len(recording.time_s))[:, None]
    high = -recording.pos_ned_m[:, :, 2] > mission.route.d1_enu_m[2] / 2.0
    last_high = np.maximum.accumulate(np.where(high, ticks, -1), axis=0)
    last_ground = np.maximum.accumulate(np.where(recording.on_ground, ticks, -1), axis=0)
    return last_high > last_ground


def _pairs(recording: Recording, mission: Mission) -> _Pairs:
    ticks, n = recording.on_ground.shape
    first, second = np.triu_indices(n, k=1)
    linked = np.zeros((ticks, len(first)), dtype=np.bool_)
    least_m = np.full(ticks, np.inf)
    flying = in_flight(recording, mission)
    touched = np.zeros((1, len(first)), dtype=np.bool_)  # in the tick before
    contacts = 0
    for at in _chunks(ticks, len(first)):
        distance_m = _distance_m(recording, at, first, second)
        linked[at] = _linked(recording, at, first, second, distance_m)
        both_fly = flying[at][:, first] & flying[at][:, second]
        least_m[at] = np.where(both_fly, distance_m, np.inf).min(axis=1, initial=np.inf)
        both_ground = recording.on_ground[at][:, first] & recording.on_ground[at][:, second]
        touching = (distance_m < CONTACT_M) & ~both_ground
        contacts += _rises(np.concatenate((touched, touching)))
        touched = touching[-1:]
    return _Pairs(first, second, linked, least_m, contacts)


def _distance_m(recording: Recording, at: slice, first: Ints, second: Ints) -> Floats:
    """(ticks, P) between centres."""
    east, north, down = (
        recording.pos_ned_m[at, :, axis][:, first] - recording.pos_ned_m[at, :, axis][:, second] for axis in range(3)
    )
    distance_m: Floats = np.sqrt(north * north + east * east + down * down)
    return distance_m


def _linked(recording: Recording, at: slice, first: Ints, second: Ints, distance_m: Floats) -> Bools:
    """(ticks, P)"""
    able = recording.agent_alive[at] & ~recording.on_ground[at]
    range_m = recording.range_m[at]
    in_range: Bools = distance_m <= np.minimum(range_m[:, first], range_m[:, second])
    return in_range & able[:, first] & able[:, second]


def _tree_contacts(recording: Recording, mission: Mission) -> int:
    north_m, east_m, up_m = recording.pos_ned_m.transpose(2, 0, 1) * np.array([1.0, 1.0, -1.0])[:, None, None]
    contacts = 0
    for tree in mission.forest.trees:
        east_from_m, north_from_m = east_m - tree.base_enu_m[0], north_m - tree.base_enu_m[1]
        reach_m = tree.trunk_radius_m + TREE_CONTACT_M
        touching = east_from_m * east_from_m + north_from_m * north_from_m < reach_m * reach_m
        if touching.any():
            touching &= (up_m < tree.height_m) & ~recording.on_ground
            contacts += _rises(np.concatenate((np.zeros_like(touching[:1]), touching)))
    return contacts


def _rises(flag: Bools) -> int:
    """How often a column of `flag` (T, ...) turns true from one row to the next."""
    return int(np.count_nonzero(flag[1:] & ~flag[:-1]))


def _chunks(ticks: int, per_tick: int) -> Iterator[slice]:
    """Slices that cover `ticks`, each of about PAIRS_AT_ONCE values."""
    step = max(1, PAIRS_AT_ONCE // max(1, per_tick))
    return (slice(start, min(start + step, ticks)) for start in range(0, ticks, step))


# --- the graph G ------------------------------------------------------------------------------------------------------


def _connectivity(recording: Recording, pairs: _Pairs, wanted: Bools) -> tuple[Bools, Floats]:
    """(T,) all alive vehicles are one component; (T,) lambda2, nan where not `wanted` (T,) or below two alive."""
    ticks, n = recording.agent_alive.shape
    connected = np.zeros(ticks, dtype=np.bool_)
    lambda2 = np.full(ticks, np.nan)
    if ticks == 0:
        return connected, lambda2
    # Links change far less often than ticks pass: each graph is worked out once
    bits = np.packbits(np.hstack((recording.agent_alive, pairs.links)), axis=1)
    _, examples, graph = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    graph = graph.ravel()
    graph_wanted = np.bincount(graph, weights=wanted) > 0
    adjacency = np.zeros((n, n), dtype=np.bool_)
    graph_connected = np.zeros(len(examples), dtype=np.bool_)
    graph_lambda2 = np.full(len(examples), np.nan)
    for g, tick in enumerate(examples):
        adjacency[pairs.first, pairs.second] = adjacency[pairs.second, pairs.first] = pairs.links[tick]
        alive = np.flatnonzero(recording.agent_alive[tick])
        among_alive = adjacency[np.ix_(alive, alive)]
        graph_connected[g] = _is_connected(among_alive)
        if graph_wanted[g] and len(alive) > 1:
            laplacian = np.diag(among_alive.sum(axis=1)) - among_alive.astype(np.float64)
            graph_lambda2[g] = max(0.0, np.linalg.eigvalsh(laplacian)[1]) if graph_connected[g] else 0.0
    return graph_connected[graph], np.where(wanted, graph_lambda2[graph], np.nan)


def _is_connected(adjacency: Bools) -> bool:
    """Whether a graph (n, n) is one component; without vertices it is none."""
    reached = np.zeros(len(adjacency), dtype=np.bool_)
    newly = reached.copy()
    newly[:1] = True
    while newly.any():
        reached |= newly
        newly = adjacency[newly].any(axis=0) & ~reached
    return bool(reached.size and reached.all())


# --- arrival ----------------------------------------------------------------------------------------------------------


def _arrivals(
    recording: Recording, mission: Mission, connected: Bools
) -> tuple[float | None, float | None, float | None]:
    """straight_time_s, arrival_leader_s, arrival_last_s."""
    started = departure(recording)
    if started is None:
        return None, None, None
    start, leader = started
    alive = recording.agent_alive
    to_d2_m = distance_to_d2_m(recording, mission)
    way_m = float(to_d2_m[start, leader]) - mission.route.arrival_distance_m
    straight_s = max(0.0, way_m) / mission.route.vel_leader_mps
    leads_there: Bools = recording.acting & alive & (to_d2_m <= mission.route.arrival_distance_m)
    from_d1_m = _from_place_m(recording.pos_ned_m[start, alive[start]], mission.route.d1_enu_m)
    there = ~recording.on_ground & (to_d2_m <= gathered_within_m(mission, from_d1_m.max(keepdims=True)))
    gathered: Bools = connected & (there | ~alive).all(axis=1)
    leader_tick = _first(np.asarray(leads_there.any(axis=1)), start)
    last_tick = None if leader_tick is None else _first(gathered, leader_tick)
    since_s = recording.time_s - recording.time_s[start]
    return (
        straight_s,
        None if leader_tick is None else float(since_s[leader_tick]),
        None if last_tick is None else float(since_s[last_tick]),
    )


def distance_to_d2_m(recording: Recording, mission: Mission) -> Floats:
    """(T, n) from each vehicle to d2, in space."""
    return _from_place_m(recording.pos_ned_m, mission.route.d2_enu_m)


def gathered_within_m(mission: Mission, width_m: Floats) -> Floats:
    """(...,) how far from d2 a vehicle may be; `width_m`: how far from d1 the farthest was at departure."""
    return np.asarray(np.maximum(mission.radio.transit_range_m, width_m + 2.0 * mission.route.arrival_distance_m))


def _from_place_m(pos_ned_m: Floats, place_enu_m: Vec3) -> Floats:
    """(...,) of positions (..., 3) to one place."""
    return np.asarray(np.linalg.norm(pos_ned_m - np.array(enu_to_ned(place_enu_m)), axis=-1), dtype=np.float64)


def _first(flag: Bools, start: int) -> int | None:
    """First tick from `start` on with `flag` (T,)."""
    ticks = np.flatnonzero(flag[start:])
    return start + int(ticks[0]) if ticks.size else None


def _overhead(arrival_s: float | None, straight_s: float | None) -> float | None:
    return arrival_s / straight_s - 1.0 if arrival_s is not None and straight_s else None


# --- coverage ---------------------------------------------------------------------------------------------------------


def _coverage(
    recording: Recording, mission: Mission, covering: Bools
) -> tuple[float | None, float | None, float | None]:
    """coverage_gap_deg, coverage_gap_ideal_deg, coverage_settled_s; `covering` (T,): the phase is COVERAGE."""
    ticks = np.flatnonzero(covering)
    if ticks.size == 0:
        return None, None, None
    shape = mission.coverage.shape
    time_s = recording.time_s[ticks]
    alive = recording.agent_alive[ticks]
    covers = alive & ~recording.on_ground[ticks]
    from_d2_m = recording.pos_ned_m[ticks] - np.array(enu_to_ned(mission.route.d2_enu_m))
    gap_of = ring_gap_deg if shape is CoverageShape.RING else sphere_gap_deg
    gaps_deg = np.array([gap_of(tick_m[on]) for tick_m, on in zip(from_d2_m, covers, strict=True)])
    counts = alive.sum(axis=1)
    ideal_of_count = np.array([0.0, *(ideal_gap_deg(shape, k) for k in range(1, int(counts.max()) + 1))])
    ideals_deg = ideal_of_count[counts]
    loose = np.flatnonzero(gaps_deg > SETTLED_RATIO[shape] * ideals_deg)
    settled = int(loose[-1]) + 1 if loose.size else 0
    return (
        float(gaps_deg[time_s >= time_s[-1] - GAP_WINDOW_S].mean()),
        float(ideals_deg[-1]),
        float(time_s[settled] - time_s[0]) if settled < len(time_s) else None,
    )


def ideal_gap_deg(shape: CoverageShape, n: int) -> float:
    """Smallest gap that n >= 1 vehicles can leave: covering circle or sphere as well as is known."""
    if shape is CoverageShape.RING:
        return 360.0 / n
    if n <= len(SPHERE_COVERING_DEG):
        return SPHERE_COVERING_DEG[n - 1]
    return sphere_covering_bound_deg(n)


def sphere_covering_bound_deg(n: int) -> float:
    """No n >= 3 points cover the sphere within less (L. Fejes Toth).

    It is the circumradius of the equilateral spherical triangle of which 2n - 4 have the sphere's area:
    cos R = cot(A / 2) cot(pi / 3), A its angle.
    """
    angle_rad = (np.pi + 4.0 * np.pi / (2.0 * n - 4.0)) / 3.0
    return float(np.degrees(np.arccos(1.0 / (np.tan(angle_rad / 2.0) * np.tan(np.pi / 3.0)))))


def ring_gap_deg(from_d2_m: Floats) -> float:
    """Largest difference in azimuth between neighbours among k vehicles at (k, 3) NED about d2; none: 360."""
    if len(from_d2_m) == 0:
        return 360.0
    azimuth_deg = np.sort(np.degrees(np.arctan2(from_d2_m[:, 1], from_d2_m[:, 0])))
    return float(np.diff(azimuth_deg, append=azimuth_deg[0] + 360.0).max())


def sphere_gap_deg(from_d2_m: Floats) -> float:
    """Largest angle from any direction to the nearest of k vehicles at (k, 3) NED about d2; none: 180.

    The direction farthest from all points has its nearest ones all round it, three or more: a normal of the
    convex hull. Only when the points leave a hemisphere empty can it face away from the middle of two instead,
    or away from one. Each is a direction: one that is not the farthest does no harm among the candidates.
    """
    radius_m = np.linalg.norm(from_d2_m, axis=1)
    units = from_d2_m[radius_m > 0.0] / radius_m[radius_m > 0.0, None]
    if len(units) == 0:
        return 180.0
    normals = _hull_normals(units)
    nearest = _cosine_of_farthest(normals, units)
    if nearest < ROUNDING:  # an empty hemisphere, which some normal shows
        first, second = np.triu_indices(len(units))
        middles = units[first] + units[second]  # of a point and itself, too
        length = np.linalg.norm(middles, axis=1)
        opposite = -middles[length > 0.0] / length[length > 0.0, None]
        nearest = min(nearest, _cosine_of_farthest(opposite, units))
    return float(np.degrees(np.arccos(np.clip(nearest, -1.0, 1.0))))


def _cosine_of_farthest(directions: Floats, units: Floats) -> float:
    """Cosine of the angle to the nearest of `units` (k, 3), from the farthest of `directions` (D, 3)."""
    return float((directions @ units.T).max(axis=1).min())


def _hull_normals(units: Floats) -> Floats:
    """(F, 3) outward unit normals of the faces of the convex hull of `units` (k, 3); both sides of a flat one."""
    if len(units) > 3:
        try:
            return np.asarray(ConvexHull(units).equations[:, :3], dtype=np.float64)
        except QhullError:  # all in one plane
            pass
    # Of a flat hull, the direction in which the points extend least
    normal = np.linalg.svd(units - units.mean(axis=0))[2][-1]
    return np.stack((normal, -normal))


# --- small things -----------------------------------------------------------------------------------------------------


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


def _mean(values: Bools | Floats) -> float | None:
    return float(values.mean()) if values.size else None


def _finite_or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
