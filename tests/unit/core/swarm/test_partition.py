"""A part of a swarm: whether it holds the majority, whom it waits for, and what it looks for where."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

from companion.core.localisation.peer_table import PeerTable
from companion.core.model.beacon import PeerReport
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Role, SwarmPhase
from companion.core.model.vectors import ZERO, norm, sub
from companion.core.swarm.partition import LEAVES_S, STANDS_S, TURN_S, TURNS, build_partition, choose_layer, choose_turn
from companion.core.swarm.partition_recovery import BEYOND, FAR_BEYOND, LOST_S, REACHED_M, Stage
from companion.core.swarm.roster import Roster
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3
from mission.document.height_layers import list_layers
from tests.unit.core.core_kit import heard_beacon, lease, mission, neighbour, picture

WHOLE_S = failsafe_engine.row(Cause.NO_MAJORITY_LONG).lingers_s
HOLD_S = failsafe_engine.row(Cause.OTHERS_LOST).delay_s

PERIOD_S = 0.1
HEARD_M = 30.0
D2: Vec3 = (0.0, 130.0, -8.0)


class Leader:
    """Vehicle 1 of three, flying east; it hears both others, 9 m north of it, as far as HEARD_M."""

    def __init__(self, phase: SwarmPhase, *, quorum: bool, layers: bool = False) -> None:
        self.phase, self.now_s, self.east_m = phase, 100.0, 0.0
        spec = mission(sensing={}, swarm={"size": 3}, separation={"height_layers": layers})
        self.parts = build_partition(spec)
        self.peers, self.roster = PeerTable(size=3), Roster(1, 3)
        self.roster.flown = 0b111
        self.lease = replace(lease(1, established=True), quorum=quorum)
        for east_m in range(40):
            self.east_m = float(east_m)
            self.period(hears=east_m <= HEARD_M)

    def period(self, *, hears: bool = False) -> None:
        self.now_s += PERIOD_S
        pos = (0.0, self.east_m, -8.0)
        if hears:
            for k in (2, 3):
                self.peers.store_beacon(
                    heard_beacon(k, rel_ned_m=(9.0, 0.0, 0.0), time_ms=int(self.now_s * 1e3)), pos, self.now_s
                )
        self.roster.present = 0b111 if hears else 0b001
        said = self.lease if not hears else replace(self.lease, quorum=True)
        now = picture(
            now_s=self.now_s,
            own=Position(pos, ZERO),
            state=FlightState.TRANSIT,
            airborne=True,
            neighbours=[neighbour(k, (9.0, 0.0, 0.0)) for k in (2, 3)] if hears else [],
            contacts=self.peers.contacts(),
        )
        self.parts.update_quorum(now, said)
        self.parts.update_layer(now, said)
        self.parts.search_lost_peers(
            now,
            self.roster,
            said,
            linked=self.roster.present,
            role=Role.LEADER,
            to_goal_mps=3.0 if hears else 0.0,
            ahead=[D2],
            phase=self.phase,
        )

    def run(self, seconds: float) -> list[tuple[Stage, tuple[Vec3, float] | None]]:
        """Each period's stage and goal; on its way back it is where it is bound for at once, else it stands."""
        found: list[tuple[Stage, tuple[Vec3, float] | None]] = []
        for _ in range(round(seconds / PERIOD_S)):
            self.period()
            search = self.parts.recovery
            found.append((search.stage, search.goal))
            if search.stage is Stage.RETRACE and search.goal is not None:
                self.east_m = search.goal[0][1]
        return found


def goals(found: list[tuple[Stage, tuple[Vec3, float] | None]], stage: Stage) -> list[tuple[Vec3, float]]:
    return [goal for its, goal in found if its is stage and goal is not None]


def test_on_the_way_a_part_without_the_majority_goes_back_then_to_where_it_heard_them_then_stays_outside() -> None:
    found = Leader(SwarmPhase.TRANSIT, quorum=False).run(30.0)
    back, there, ahead = (goals(found, stage) for stage in (Stage.RETRACE, Stage.APPROACH, Stage.AHEAD))
    assert norm(sub(back[-1][0], (0.0, HEARD_M - FAR_BEYOND, -8.0))) <= REACHED_M
    assert there[0] == ((9.0, HEARD_M, -8.0), 0.0)
    spec = mission()
    assert ahead[0] == (D2, spec.coverage.radius_m + 2.0 * spec.separation.soft_m)


def test_around_the_tree_it_goes_back_to_its_last_link_at_most() -> None:
    found = Leader(SwarmPhase.COVERAGE, quorum=False).run(30.0)
    assert norm(sub(goals(found, Stage.RETRACE)[-1][0], (0.0, HEARD_M, -8.0))) <= REACHED_M
    assert goals(found, Stage.APPROACH) == goals(found, Stage.AHEAD) == []


@pytest.mark.parametrize(
    ("phase", "waits"), [(SwarmPhase.TRANSIT, [2, 3]), (SwarmPhase.RETURN, [2, 3]), (SwarmPhase.COVERAGE, [])]
)
def test_a_part_with_the_majority_waits_on_the_way_only(phase: SwarmPhase, waits: list[int]) -> None:
    one = Leader(phase, quorum=True)
    found = one.run(LOST_S + 0.5)
    assert one.parts.waits_for == waits
    found += one.run(30.0)
    back = goals(found, Stage.RETRACE)
    assert bool(back) == bool(waits)
    assert all(norm(sub(back[-1][0], (0.0, HEARD_M - BEYOND, -8.0))) <= REACHED_M for _ in waits)
    assert goals(found, Stage.APPROACH) == goals(found, Stage.AHEAD) == []  # it goes on instead


def counted(*quorums: tuple[float, bool], state: FlightState = FlightState.TRANSIT) -> float:
    """For how long it has had no majority, after so many seconds each with and without."""
    parts, now_s = build_partition(mission(sensing={})), 100.0
    for seconds, quorum in quorums:
        for _ in range(round(seconds / PERIOD_S)):
            now_s += PERIOD_S
            parts.update_quorum(picture(now_s=now_s, state=state), replace(lease(2), quorum=quorum))
    return parts.partitioned_s(now_s)


def test_majority_of_a_moment_does_not_end_the_time_without_one() -> None:
    assert counted((10.0, False)) == pytest.approx(10.0, abs=0.2)
    assert counted((5.0, False), (WHOLE_S - 0.5, True), (5.0, False)) == pytest.approx(9.5 + WHOLE_S, abs=0.2)
    assert counted((5.0, False), (WHOLE_S + 0.5, True), (5.0, False)) == pytest.approx(5.0, abs=0.2)
    assert counted((10.0, False), state=FlightState.RELEASED) == 0.0


def found_by_follower(
    seconds: float, *, established: bool = True, separation: Mapping[str, Any] | None = None
) -> set[Cause]:
    one, now_s = Leader(SwarmPhase.TRANSIT, quorum=False), 0.0
    said = replace(lease(2, established=established), quorum=False)
    one.parts = build_partition(mission(sensing={}, separation=dict(separation or {})))
    for k in range(round(seconds / PERIOD_S) + 1):
        now_s = 200.0 + k * PERIOD_S
        one.parts.update_quorum(picture(now_s=now_s, state=FlightState.TRANSIT), said)
    contacts = one.peers.contacts()
    return {found.cause for found in one.parts.hold_findings(one.roster, contacts, said, now_s, role=Role.FOLLOWER)}


def test_follower_holds_at_once_and_follows_its_leader_in_search_of_the_others_when_it_lasts() -> None:
    assert found_by_follower(HOLD_S - 0.2) == {Cause.NO_MAJORITY}
    assert found_by_follower(HOLD_S + 0.2) == {Cause.NO_MAJORITY, Cause.OTHERS_LOST}
    assert found_by_follower(HOLD_S + 0.2, established=False) == {Cause.NO_MAJORITY}


@pytest.mark.parametrize(
    ("state", "led", "company"),
    [
        (FlightState.TRANSIT, False, True),
        (FlightState.WAITING, True, True),
        (FlightState.WAITING, False, False),
    ],
)
def test_one_that_listens_in_the_air_is_in_company_only_where_somebody_leads(
    state: FlightState, led: bool, company: bool
) -> None:
    parts, around = build_partition(mission()), [neighbour(2, (9.0, 0.0, 0.0))]
    for k in range(50):
        now = picture(now_s=100.0 + k * PERIOD_S, state=state, airborne=True, neighbours=around)
        parts.update_peer_contact(now, led=led)
    assert (parts.no_contact_s(105.0) < 0.2) == company


# --- layers of height ---


def layered_part(leader: int, *, way_m: float, hears: bool = True) -> tuple[float | None, float | None]:
    """The layer of a part that `leader` leads without the majority; and 10 s after it has it, one `way_m` from it.

    `hears`: that one; else it hovers there by another's word.
    """
    parts = build_partition(mission(sensing={}, swarm={"size": 3}, separation={"height_layers": True}))
    found: list[float | None] = []
    for quorum in (False, True):
        said = replace(lease(leader, established=True), quorum=quorum)
        for _ in range(100):
            at_s = 100.0 + PERIOD_S * len(found)
            now = picture(
                now_s=at_s,
                own=Position((0.0, 0.0, -6.0), ZERO),
                state=FlightState.TRANSIT,
                airborne=True,
                neighbours=[neighbour(3, (way_m, 0.0, -2.0))] if quorum and hears else [],
                silent={}
                if hears
                else {3: PeerReport(3, (99.0, 0.0, 0.0), 9.0, silent=True, elsewhere=((way_m, 0.0, -2.0),))},
            )
            parts.update_quorum(now, said)
            found.append(parts.update_layer(now, said))
    return found[99], found[-1]


def test_layer_of_a_part_follows_from_its_leaders_id() -> None:
    own_m, lower_m, lowest_m = list_layers(mission(separation={"height_layers": True}))
    assert layered_part(2, way_m=20.0) == (lower_m, own_m)
    assert layered_part(1, way_m=20.0) == (lowest_m, own_m)


def test_vehicle_stays_in_its_layer_while_a_silent_one_may_hover_above_it() -> None:
    own_m, lower_m, _ = list_layers(mission(separation={"height_layers": True}))
    assert layered_part(2, way_m=20.0, hears=False)[1] == own_m
    assert layered_part(2, way_m=3.0, hears=False)[1] == lower_m


def test_vehicle_stays_in_its_layer_while_another_is_above_it() -> None:
    below_m, still_m = layered_part(2, way_m=3.0)
    _, lower_m, _ = list_layers(mission(separation={"height_layers": True}))
    assert below_m == still_m == lower_m


@pytest.mark.parametrize("waits_s", [LEAVES_S - 0.5, LEAVES_S + 0.5])
def test_part_that_has_the_majority_again_does_not_wait_for_ever_below_one_that_hovers(waits_s: float) -> None:
    parts = build_partition(mission(sensing={}, swarm={"size": 3}, separation={"height_layers": True}))
    above = {3: PeerReport(3, (3.0, 0.0, -2.0), 1.0, silent=True)}
    now_s = 100.0
    for quorum, seconds in ((False, 5.0), (True, waits_s)):
        for _ in range(round(seconds / PERIOD_S)):
            now_s += PERIOD_S
            now = picture(now_s=now_s, state=FlightState.TRANSIT, airborne=True, silent=above)
            said = replace(lease(2, established=True), quorum=quorum)
            parts.update_quorum(now, said)
            parts.update_layer(now, said)
    assert parts.leaves_layer(now_s) is (waits_s < LEAVES_S)


def test_part_keeps_its_layer_until_it_goes_back_whoever_leads_when_it_has_the_majority_again() -> None:
    """By the new leader's id it sank to the third layer, and then rose past the second to the first."""
    parts = build_partition(mission(sensing={}, swarm={"size": 3}, separation={"height_layers": True}))
    alone, again = replace(lease(2, established=True), quorum=False), lease(3, established=True)
    heights_m, now_s = list[float | None](), 100.0
    for _ in range(round(6.0 / PERIOD_S)):
        now_s += PERIOD_S
        now = picture(now_s=now_s, state=FlightState.TRANSIT, airborne=True)
        parts.update_quorum(now, alone if now_s < 103.0 else again)
        next_period = alone if now_s + PERIOD_S < 103.0 else again
        heights_m.append(parts.update_layer(now, next_period))  # a lease is known before the next period counts it
    assert set(heights_m) == {8.0, 6.0}


def test_another_leader_takes_no_part_past_the_missions_height() -> None:
    """Leader 3's layer is the one above: the way there would lead through the majority, which it does not hear."""
    tables: dict[str, Any] = {"fence": {"altitude_min_m": 5.0}, "separation": {"height_layers": True}}
    spec = mission(sensing={}, swarm={"size": 3}, **tables)
    own_m, lower_m, higher_m = list_layers(spec)
    assert lower_m < own_m < higher_m
    for first, then, layer_m in ((2, 3, lower_m), (3, 2, higher_m)):
        parts, heights_m = build_partition(spec), list[float | None]()
        for k in range(round(6.0 / PERIOD_S)):
            now = picture(now_s=100.0 + PERIOD_S * k, state=FlightState.TRANSIT, airborne=True)
            said = replace(lease(first if k < 30 else then, established=True), quorum=False)
            parts.update_quorum(now, said)
            heights_m.append(parts.update_layer(now, said))
        assert set(heights_m) == {own_m, layer_m}


def after_a_stall(leader: int, before: FlightState | None, up_m: float) -> set[float | None]:
    """Heights of a vehicle without the majority, at `up_m` after 3 s in which its companion listened.

    `before`: whose state then, for 10 s without the majority, led by vehicle 3; None: nothing is known of before.
    """
    tables: dict[str, Any] = {"fence": {"altitude_min_m": 5.0}, "separation": {"height_layers": True}}
    parts, now_s, heights_m = build_partition(mission(sensing={}, swarm={"size": 3}, **tables)), 100.0, set()
    times = [(3, before, 10.0)] if before is not None else []
    for led_by, state, seconds in [*times, (leader, FlightState.WAITING, 3.0), (leader, FlightState.HOLD, 5.0)]:
        heights_m = set[float | None]()
        for _ in range(round(seconds / PERIOD_S)):
            now_s += PERIOD_S
            own = Position((0.0, 0.0, -up_m), ZERO)
            now = picture(now_s=now_s, own=own, state=state, airborne=True)
            said = replace(lease(led_by, established=True), quorum=False)
            parts.update_quorum(now, said)
            heights_m.add(parts.update_layer(now, said))
    return heights_m


def test_after_a_stall_a_vehicle_keeps_its_layer_whoever_leads() -> None:
    """It forgot its layer, went to the mission's height for a second, and past it: leader 2's is the one below."""
    assert after_a_stall(3, FlightState.HOLD, 10.0) == {10.0}
    assert after_a_stall(2, FlightState.HOLD, 10.0) == {10.0}
    assert after_a_stall(2, FlightState.HOLD, 8.5) == {10.0}  # on its way there


@pytest.mark.parametrize(("up_m", "layer_m"), [(10.0, 10.0), (9.4, 10.0), (6.0, 6.0)])
def test_who_is_started_again_in_a_layer_stays_on_its_side_of_the_missions_height(up_m: float, layer_m: float) -> None:
    for leader in (2, 3):
        assert after_a_stall(leader, None, up_m) == {up_m, layer_m}


def test_who_was_brought_elsewhere_by_a_pilot_goes_on_from_there() -> None:
    assert after_a_stall(3, FlightState.RELEASED, 6.0) == {6.0}


@pytest.mark.parametrize(
    ("changes", "state", "held_m"),
    [
        ({}, FlightState.TRANSIT, 8.0),
        ({}, FlightState.LANDING, None),
        ({"sensing": None}, FlightState.TRANSIT, None),
        ({"separation": {"height_layers": False}}, FlightState.TRANSIT, None),
    ],
)
def test_who_may_meet_parts_in_other_layers_holds_the_missions_height(
    changes: dict[str, Any], state: FlightState, held_m: float | None
) -> None:
    """Else a formation's heights wander by 0.7 m, a third of the way to the next layer."""
    tables: dict[str, Any] = {"sensing": {}, "swarm": {"size": 3}, "separation": {"height_layers": True}} | changes
    parts = build_partition(mission(**{name: value for name, value in tables.items() if value is not None}))
    assert parts.update_layer(picture(now_s=100.0, state=state, airborne=True), lease(1)) == held_m


def test_trail_of_a_part_in_its_layer_is_kept_at_the_missions_height() -> None:
    """Else no position of the way back, flown before at another height, would ever be reached."""
    parts = build_partition(mission(sensing={}, swarm={"size": 3}, separation={"height_layers": True}))
    said = replace(lease(2, established=True), quorum=False)
    for k in range(30):
        now = picture(
            now_s=100.0 + PERIOD_S * k,
            own=Position((0.0, 0.0, -6.0), ZERO),
            state=FlightState.TRANSIT,
            airborne=True,
            neighbours=[neighbour(3, (9.0, 0.0, 0.0))],
        )
        parts.update_quorum(now, said)
        parts.update_layer(now, said)
    parts.recovery.trail.record_links((0.0, 30.0, -8.0), 0b100)
    parts.search_lost_peers(
        now, Roster(2, 3), said, linked=0b100, role=Role.FOLLOWER, to_goal_mps=0.0, ahead=[], phase=SwarmPhase.TRANSIT
    )
    parts.recovery.trail.turn_back(0b100)
    assert parts.recovery.trail.next_waypoint((0.0, 60.0, -8.0)) == (0.0, 0.0, -8.0)


def test_where_there_are_layers_a_part_stands_before_it_looks_for_the_others() -> None:
    """Several parts may share a layer: those that stand are where the others take them to be."""
    for layers, after_s in ((False, HOLD_S), (True, STANDS_S)):
        one = Leader(SwarmPhase.TRANSIT, quorum=False, layers=layers)
        while one.parts.partitioned_s(one.now_s) < after_s - 0.1:
            assert one.parts.recovery.goal is None
            one.period()
        one.run(0.3)
        assert one.parts.recovery.goal is not None


def test_in_layers_a_part_stands_also_when_it_is_lost_again() -> None:
    """It set out at once, as in one height; others that share its layer take it to be where it was."""
    leader = Leader(SwarmPhase.TRANSIT, quorum=False, layers=True)
    leader.parts.recovery.back_s, leader.parts.recovery.on_s = leader.now_s - 5.0, leader.now_s - 1.0
    stands = 0
    while leader.parts.recovery.goal is None:
        leader.period()
        stands += 1
    assert PERIOD_S * stands == pytest.approx(STANDS_S, abs=2.0)


def test_followers_of_a_part_that_stands_stand_too() -> None:
    layers = {"separation": {"height_layers": True}}
    stands_s = STANDS_S + TURN_S  # that of a part which vehicle 2 leads, of three layers
    assert found_by_follower(stands_s - 1.0, **layers) == {Cause.NO_MAJORITY}
    assert Cause.OTHERS_LOST in found_by_follower(stands_s + 0.2, **layers)


@pytest.mark.parametrize("layers_m", [(8.0, 6.0), (8.0, 6.0, 4.0)])
def test_parts_that_share_a_layer_look_for_the_others_one_after_the_other(layers_m: tuple[float, ...]) -> None:
    """All lose the majority at once where a cut leaves none: two set out towards one another, and met at 3.91 m."""
    turns: dict[float, list[int]] = {}
    for leader in range(1, 13):
        turns.setdefault(choose_layer(layers_m, leader), []).append(choose_turn(layers_m, leader))
    assert all(set(its) == set(range(TURNS)) for its in turns.values())
    assert all(one != following for its in turns.values() for one, following in pairwise(its))


def test_who_fell_silent_here_counts_where_two_are_heard() -> None:
    heard = [neighbour(k, (9.0, 0.0, 0.0)) for k in (2, 3)]
    silent = {
        4: PeerReport(4, (9.0, 0.0, 0.0), 3.0, silent=True),
        5: PeerReport(5, (9.0, 0.0, 0.0), 3.0, silent=True, received=True),
    }
    assert picture(neighbours=heard, silent=silent).find_silent_here() == 0b1000
    assert picture(neighbours=heard[:1], silent=silent).find_silent_here() == 0
