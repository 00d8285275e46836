"""The figures of a flight, declared once: name, unit, which end is the better one, what it is.

`metrics.json` holds them; summaries, limits, plots and pages of studies, and docs/reference/metrics.md read this table.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

Row = Mapping[str, Any]  # figures of one flight, by name

SHARE: Final = "share"  # of 1; people see percent


class Better(Enum):
    """The better end of a figure."""

    LESS = "less"
    MORE = "more"


LESS, MORE = Better.LESS, Better.MORE


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    better: Better | None = None  # None: neither, and studies do not put it together
    title: str = ""  # name that people see; of each that studies put together
    in_table: bool = False  # of a study
    on_page: bool = False  # of a study
    of_flight: Callable[[Row], float | None] | None = None  # how to work it out of others; None: a flight has it
    of_case: Callable[[Sequence[Row]], float | None] | None = None  # of all flights of a case together


@dataclass(frozen=True, slots=True)
class Figure(_Shown):
    """One figure of a flight, or of a case of a study."""

    name: str
    unit: str
    text: str

    @property
    def heading(self) -> str:
        """Title with the unit of what people see: one name in tables, plots, pages and limits of studies."""
        return f"{self.title}, {self.shown_unit}" if self.shown_unit else self.title

    @property
    def worst(self) -> Callable[[Sequence[float]], float]:
        """The worst of several values."""
        return min if self.better is MORE else max

    @property
    def scale(self) -> float:
        """Factor from the value to what people see."""
        return 100.0 if self.unit == SHARE else 1.0

    @property
    def shown_unit(self) -> str:
        """Unit of what people see."""
        return "%" if self.unit == SHARE else self.unit

    def of(self, row: Row) -> float | None:
        """The value in a row; None: it has none."""
        if self.of_flight is not None:
            return self.of_flight(row)
        value = row.get(self.name)
        return None if value is None else float(value)


FIGURES: Final[tuple[Figure, ...]] = (
    Figure(
        "n",
        "",
        "Vehicles in the recording.",
    ),
    Figure(
        "lost",
        "ids",
        "Ids of the vehicles that were not alive any more in the last tick.",
    ),
    Figure(
        "armed",
        "ids",
        "Ids of the vehicles that were armed in the last tick.",
    ),
    Figure(
        "aloft",
        "ids",
        "Ids of the vehicles that were off the ground in the last tick.",
    ),
    Figure(
        "strayed",
        "ids",
        "Where the mission lands: ids of the vehicles that were on the ground elsewhere in the last tick. With "
        "route.at_end = return that is further from d1, level, than the gathered swarm is from d2 and twice "
        "route.arrival_distance_m (the leader may stand off, and gives way to one that hangs there); with land, "
        "further from d2 than that and than the ring or sphere, too.",
    ),
    Figure(
        "landed_early",
        "ids",
        "Ids of the vehicles that had flown, and were on the ground, alive, before they had announced the phase LAND, "
        "and did not fly again: they came down for a reason of their own (no majority, an order, the battery), not at "
        "the mission's end.",
    ),
    Figure(
        "sim_time_s",
        "s",
        "Simulated time of the last tick.",
    ),
    Figure(
        "arrived",
        "",
        "An acting leader came within route.arrival_distance_m of d2 (0.5 m more where sim.estimates err: it goes "
        "by what it is told), and then or later the swarm was gathered.",
        better=MORE,
        title="arrived",
    ),
    Figure(
        "visited",
        "",
        "Places to cover, d2 among them, at which an acting leader was within route.arrival_distance_m and "
        "announced COVERAGE: 1, and one more for each of route.stops. All other figures of arrival and coverage "
        "are of d2.",
    ),
    Figure(
        "absent",
        "ids",
        "Ids of the vehicles that never came to d2: at no time from the arrival of the leader on alive, airborne "
        "and as close to d2 as the gathered swarm is.",
    ),
    Figure(
        "straight_time_s",
        "s",
        "From the acting leader's place at departure straight towards d2 at route.vel_leader_mps, until it is "
        "within route.arrival_distance_m: what arrival_leader_s would be without turns, pauses and time to speed "
        "up. With route.stops over these, and with the time at each.",
    ),
    Figure(
        "arrival_leader_s",
        "s",
        "Time from departure until an acting leader, whichever it is then, is first within route.arrival_distance_m of "
        "d2.",
        better=LESS,
        title="departure to arrival of the leader",
        in_table=True,
    ),
    Figure(
        "arrival_last_s",
        "s",
        "Time from departure until the swarm is first gathered, not before the arrival of the leader.",
        better=LESS,
        title="departure to arrival of all",
        on_page=True,
    ),
    Figure(
        "overhead_leader",
        SHARE,
        "arrival_leader_s / straight_time_s - 1. One vehicle alone is above 0 too: it speeds up, and slows down "
        "before d2.",
        better=LESS,
        title="overhead of the leader",
        in_table=True,
    ),
    Figure(
        "overhead_last",
        SHARE,
        "arrival_last_s / straight_time_s - 1.",
        better=LESS,
        title="overhead of the last",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "min_separation_m",
        "m",
        "Least distance between the centres of two vehicles in flight: each from when it has climbed above half "
        "the height of d1 until it touches the ground. Vehicles with a dead companion count. In a mission that flies "
        "in layers of height (`separation.height_layers`): the least level distance of two whose heights differ by "
        "less than 1.5 m.",
        better=MORE,
        title="least separation",
        in_table=True,
        on_page=True,
    ),
    Figure("closest", "ids", "Ids of the two vehicles of min_separation_m."),
    Figure("closest_at_s", "s", "Simulated time of min_separation_m."),
    Figure(
        "contacts",
        "",
        "contacts_vehicles + contacts_trunks + contacts_crowns + contacts_boxes + contacts_ground.",
        better=LESS,
        title="contacts",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "contacts_vehicles",
        "",
        "Times that two vehicles came closer than 0.7 m, centre to centre (hulls of 0.35 m touch; the mission's "
        "sensing.vehicle_radius_m, where it has one), with one of them "
        "airborne. A contact counts once for as long as it lasts. In the bridge both fall and are lost.",
        better=LESS,
        title="contacts between vehicles",
    ),
    Figure(
        "contacts_trunks",
        "",
        "Vehicles that came closer than 0.35 m (sensing.vehicle_radius_m) to the surface of a trunk, below its top and "
        "off the ground. In "
        "the bridge such a vehicle falls and is lost; the first thing that one runs into counts, and nothing "
        "after it.",
        better=LESS,
        title="trunks struck",
    ),
    Figure(
        "contacts_crowns",
        "",
        "Vehicles whose centre came into a crown, between its base and its top.",
        better=LESS,
        title="crowns flown into",
    ),
    Figure("contacts_boxes", "", "The same as contacts_trunks with a box.", better=LESS, title="boxes struck"),
    Figure(
        "contacts_ground",
        "",
        "With [sensing]: vehicles that met the ground faster than a landing does, at more than 1 m/s level or 2.5 "
        "m/s down.",
        better=LESS,
        title="hard contacts with the ground",
    ),
    Figure(
        "contacts_steered",
        "",
        "Vehicles that ran into anything while they were alive: not those that drift with a dead companion.",
        better=LESS,
        title="steered vehicles that ran into something",
    ),
    Figure(
        "fence_exceeded_m",
        "m",
        "Greatest distance outside of fence.polygon_enu_m (level) or above fence.altitude_max_m of a vehicle off the "
        "ground, before it ran into anything. 0: none left the fence.",
        better=LESS,
        title="farthest outside the fence",
    ),
    Figure(
        "trunk_clearance_min_m",
        "m",
        "Least level distance from the centre of an airborne vehicle to the surface of a trunk that reaches "
        "higher than it, before it ran into anything. None: never within 20 m.",
        better=MORE,
        title="nearest to a trunk",
        on_page=True,
    ),
    Figure(
        "box_clearance_min_m",
        "m",
        "The same to the surface of a box.",
        better=MORE,
        title="nearest to a box",
        on_page=True,
    ),
    Figure(
        "speed_mean_transit_mps",
        "m/s",
        "Level speed of the alive airborne vehicles over the ground, mean over phase TRANSIT.",
        better=MORE,
        title="mean speed in transit",
    ),
    Figure(
        "connected_fraction_transit",
        SHARE,
        "Share of the ticks of phase TRANSIT in which all alive vehicles were one component of G. One that sits "
        "on the ground is apart; one alone is connected.",
        better=MORE,
        title="connected in transit",
        in_table=True,
        on_page=True,
    ),
    Figure(
        "connected_fraction_coverage",
        SHARE,
        "The same in phase COVERAGE.",
        better=MORE,
        title="connected in coverage",
    ),
    Figure(
        "splits",
        "",
        "Times that the alive vehicles ceased to be one component in phase TRANSIT or COVERAGE: of G without the links "
        "that `partition` faults cut, in range though they are.",
    ),
    Figure(
        "longest_gap_s",
        "s",
        "Longest time from such a split until they were one component again, or the flight was over.",
        better=LESS,
        title="longest partition",
        on_page=True,
    ),
    Figure(
        "rejoin_s",
        "s",
        "The same of those splits that ended in the flight. None with splits above 0: none did.",
        better=LESS,
        title="longest partition that ended",
    ),
    Figure(
        "lambda2_mean_transit",
        "",
        "Algebraic connectivity of G, the second smallest eigenvalue of its unweighted Laplacian: mean over the "
        "ticks of phase TRANSIT with at least two alive vehicles.",
    ),
    Figure(
        "vertex_connectivity_coverage",
        "",
        "Vertex connectivity k of G, the least in the last 5 s of phase COVERAGE with at least two alive "
        "vehicles: so many vehicles must be lost, at least, until those left are not one component. 0: they are "
        "not one now; from 2 on, everyone has two ways to everyone else. Where all hear one another it is one "
        "less than there are.",
    ),
    Figure(
        "coverage_gap_deg",
        "°",
        "Mean over the last 5 s of phase COVERAGE of the gap that the covering vehicles leave. Ring: the largest "
        "difference in azimuth about d2 between neighbours. Sphere: the largest angle at d2 from any direction to "
        "the nearest vehicle.",
        better=LESS,
        title="coverage gap",
    ),
    Figure(
        "coverage_gap_ideal_deg",
        "°",
        "The smallest gap possible with as many vehicles as are alive at the end of phase COVERAGE. Ring: 360 / n "
        "or, where trunks stand in it, the smallest that leaves their bearings out; a bearing is free where a "
        "vehicle that covers keeps sensing.vehicle_radius_m and margin_m from every trunk. Sphere: the covering "
        "radius, best known up to n = 20, Fejes Toth's lower bound beyond.",
    ),
    Figure(
        "coverage_radius_error_m",
        "m",
        "Greatest difference over the last 5 s of phase COVERAGE between coverage.radius_m and the distance to d2 "
        "of an alive airborne vehicle: level, to d2's vertical axis, for a ring; in space for a sphere.",
        better=LESS,
        title="off the coverage radius",
    ),
    Figure(
        "coverage_settled_s",
        "s",
        "From the start of phase COVERAGE until all alive vehicles are covering, and the gap is at most 1.15 "
        "(ring) or 1.2 (sphere) times the ideal for those alive, and both stay so to the end of the phase.",
        better=LESS,
        title="coverage settled after",
    ),
    Figure(
        "uncovering",
        "ids",
        "Ids of the vehicles, their companions alive, that were not covering at some time in the last 5 s of phase "
        "COVERAGE.",
    ),
    Figure(
        "acting_leaders_max",
        "",
        "Most vehicles that acted as leader in the same tick.",
        better=LESS,
        title="most acting leaders",
    ),
    Figure(
        "acting_leaders_overlap_s",
        "s",
        "Total time with more than one acting leader.",
    ),
    Figure(
        "leaders_together_s",
        "s",
        "Longest time that two acting leaders were in one component of G without the links that faults cut.",
        better=LESS,
        title="two leaders in one part",
    ),
    Figure(
        "leader_changes",
        "",
        "Times that the acting leader was another than the one before; the first does not count.",
        better=LESS,
        title="changes of the leader",
    ),
    Figure(
        "leaderless_max_s",
        "s",
        "Longest time within phases TRANSIT and COVERAGE without an acting leader.",
        better=LESS,
        title="longest without a leader",
    ),
)
