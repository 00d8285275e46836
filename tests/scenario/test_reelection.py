"""Periodic re-election in flight: full dynamics, the whole stack, every agent's own word in every tick."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path

import pytest

from companion.core.model.states import SwarmPhase
from companion.core.model.vectors import norm
from companion.core.swarm.election import HANDOVER_PERIODS
from mission.common.frames import enu_to_ned
from mission.document.model import Mission
from sim_bridge.drive.fly import Flight
from sim_bridge.world.world import TICK_S
from tests.flights import flown, short_mission

TERM_S = 8.0
HANDOVER_S = HANDOVER_PERIODS * 0.1
SETTLED_S = 3.0


def mission_with(battery_mah: Mapping[int, float]) -> Mission:
    return short_mission(
        route={"d2_enu_m": (60, 0, 4)},
        swarm={"size": 5, "reelection_period_s": TERM_S},
        sim={"battery_mah": dict(battery_mah)},
    )


class Terms:
    """Who acts, by the agents' own word, in every tick since somebody first did."""

    def __init__(self) -> None:
        self.claimed_s: float | None = None  # when the first to act began to claim
        self.acting: list[tuple[float, tuple[int, ...], SwarmPhase]] = []
        self.slowest_mps = 1e9  # of all, in the seconds after a hand-over
        self.to_go_s = 0.0  # the new leader's way at cruise speed, at the hand-over

    def __call__(self, flight: Flight) -> None:
        now_s = flight.world.now_s
        elections = {k: c.endpoint.agent.swarm.election for k, c in flight.lockstep.companions.items()}  # type: ignore[attr-defined]
        acting = tuple(k for k, election in elections.items() if election.acts)
        if not self.acting:
            self.claimed_s = None if not elections[1].leads else self.claimed_s or now_s
        if acting or self.acting:
            self.acting.append((now_s, acting, flight.phase()))
        if self.changes and now_s <= self.changes[-1][0] + SETTLED_S:
            states = {k: v.airframe.state for k, v in flight.world.vehicles.items()}
            self.slowest_mps = min(self.slowest_mps, *(norm(s.vel_ned_mps) for s in states.values()))
            if now_s == self.changes[-1][0]:
                route = flight.mission.route
                to_d2_m = math.dist(states[acting[0]].pos_ned_m, enu_to_ned(route.d2_enu_m))
                self.to_go_s = (to_d2_m - route.arrival_distance_m) / route.vel_leader_mps

    @property
    def changes(self) -> list[tuple[float, tuple[int, ...], SwarmPhase]]:
        """Each tick in which others act than in the one before."""
        return [now for before, now in itertools.pairwise(self.acting) if before[1] != now[1]]


def test_better_candidate_takes_over_at_the_period_in_transit_without_gap_or_overlap(tmp_path: Path) -> None:
    terms = Terms()
    outcome, shown = flown(mission_with({1: 300.0}), tmp_path, point_mass=False, watch=terms)
    assert outcome.succeeded, shown
    assert all(len(acting) == 1 for _, acting, _ in terms.acting)
    ((at_s, acting, phase),) = terms.changes
    assert acting != (1,)
    assert phase is SwarmPhase.TRANSIT
    assert terms.claimed_s is not None
    since_period_s = (at_s - terms.claimed_s) % TERM_S
    assert since_period_s == pytest.approx(HANDOVER_S, abs=2 * TICK_S + 1e-6)
    figures = outcome.metrics
    assert (figures.acting_leaders_max, figures.leader_changes, figures.leaderless_max_s) == (1, 1, 0.0)
    assert figures.connected_fraction_transit == 1.0
    assert figures.min_separation_m is not None
    assert figures.min_separation_m > 4.0
    # Nobody slows down for it: only the new leader's place makes the way longer or shorter.
    assert terms.slowest_mps > 0.7 * 2.0
    arrived_s = next(time_s for time_s, _, phase in terms.acting if phase is SwarmPhase.COVERAGE)
    assert arrived_s - at_s == pytest.approx(terms.to_go_s, abs=1.0)


@pytest.mark.parametrize("battery_mah", [{}, {1: 1000.0}], ids=["equal", "better by one step"])
def test_candidate_that_is_not_clearly_better_never_takes_over(battery_mah: dict[int, float], tmp_path: Path) -> None:
    terms = Terms()
    outcome, shown = flown(mission_with(battery_mah), tmp_path, point_mass=False, watch=terms)
    assert outcome.succeeded, shown
    assert {acting for _, acting, _ in terms.acting} == {(1,)}
    assert terms.acting[-1][0] - terms.acting[0][0] > 6 * TERM_S
