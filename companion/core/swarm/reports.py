"""The news of a swarm for its operator: the leader, a new phase, for whom or what the swarm waits, other layers."""

from __future__ import annotations

import math
from typing import Final

from companion.core.model.actions import Say
from companion.core.model.beacon import Lease
from companion.core.model.states import Severity, SwarmPhase
from companion.core.swarm.roster import ids, list_vehicles
from mission.document.model import Mission

ABSENT_SAID_S: Final = 10.0  # the leader names those that are not ready this often
SETTLES_S: Final = 1.0  # those that one cut takes are missed one after the other: named together
WAIT_SAID_S: Final = 20.0  # one that was waited for so lately, or is back, has a link that comes and goes:
LASTS_S: Final = 5.0  # said when it has lasted for so long
LAYER_SAID_S: Final = 10.0  # no more often: by a radio that comes and goes a part leaves its layer again and again
NEWS = {
    SwarmPhase.GATHER: "ready: swarm takes off",
    SwarmPhase.TRANSIT: "gathered at d1: leaving for d2",
    SwarmPhase.COVERAGE: "arrived at d2: spreading around it",
    SwarmPhase.RETURN: "coverage done: returning to d1",
    SwarmPhase.LAND: "swarm lands",
}


class SwarmReports:
    """The reports of one vehicle, each given once; `take_all` takes them."""

    def __init__(self, mission: Mission, me: int) -> None:
        self._me = me
        self._size = mission.swarm.size
        self._visits = len(mission.visits)
        self._has_stops = bool(mission.route.stops)
        self._lanes = len(mission.lanes)
        self._reports: list[Say] = []  # since they were taken last
        self._leader: int | None = None
        self._waited_s: dict[int, float] = {}  # by id: when it was last waited for
        self._waits_said: list[int] = []  # for whom, as it was said last
        self._waits_due_s = math.inf  # when that is said anew
        self._waits_named: set[int] = set()  # since this wait began
        self._waits_for_position = False
        self._absent_said_s: float | None = None
        self._own_m = self._layer_m = mission.route.d1_enu_m[2]  # the mission's height, and that of the last report
        self._layer_said_s = -math.inf

    def take_all(self) -> list[Say]:
        """The reports since they were taken last."""
        reports, self._reports = self._reports, []
        return reports

    def report_leader(self, lease: Lease | None, *, is_steered: bool) -> None:
        """Each period: another leader, or none any more."""
        leader = lease.leader if lease is not None and lease.established else None
        if leader != self._leader and leader is not None:
            self._add(Severity.NOTICE, f"leader: vehicle {leader}" + (" (this one)" if leader == self._me else ""))
        elif leader is None and self._leader is not None and is_steered:
            self._add(Severity.WARNING, f"leader {self._leader} lost")
        self._leader = leader

    def report_phase(self, entered: SwarmPhase, before: SwarmPhase, stop: int, done: int) -> None:
        """A leader's: a new phase, and without whom the swarm takes off or leaves d1. `done`: bit k-1: vehicle k."""
        self._add(Severity.NOTICE, self._name_phase(entered, before, stop))
        missing = self._others_than(done) if SwarmPhase.GATHER in (entered, before) else ""
        if missing:
            self._add(Severity.NOTICE, f"swarm goes on without {missing}")

    def report_lane(self, before: int, stop: int, *, is_reached: bool) -> None:
        """A leader's that goes on from the visit `before` to `stop`; `is_reached`: it has come there."""
        if stop > before + 1:
            self._add(Severity.NOTICE, "stand known: leaving for d2")
            return
        if not is_reached:
            end = "end" if before % 2 else "start"
            self._add(Severity.WARNING, f"lane {before // 2 + 1}: {end} not reached, going on")
        if stop == 2 * self._lanes:
            self._add(Severity.NOTICE, "lanes done: leaving for d2")
        else:
            self._add(Severity.NOTICE, f"{'on' if stop % 2 else 'leaving for'} {self._name_lane(stop)}")

    def report_blocked(self, vehicle: int, why: str) -> None:
        """A member whose words count for separation alone from now on."""
        self._add(Severity.WARNING, f"vehicle {vehicle} blocked: {why}")

    def report_stuck(self) -> None:
        """A leader's that comes no nearer to its goal: the swarm lands where it is."""
        self._add(Severity.WARNING, "leader stuck: landing")

    def report_backtracking(self) -> None:
        """A leader's that turns back by its own way."""
        self._add(Severity.WARNING, "position uncertain: backtracking to d1")

    def report_absent(self, done: int, now_s: float) -> None:
        """From time to time, for which vehicles the swarm waits: out of radio range, not ready, or not there at all."""
        missing = self._others_than(done)
        if missing and (self._absent_said_s is None or now_s - self._absent_said_s >= ABSENT_SAID_S):
            if self._absent_said_s is not None:
                self._add(Severity.WARNING, f"waiting for {missing}")
            self._absent_said_s = now_s

    def report_waits(self, waits_for: list[int], now_s: float, until_s: float, present: int, *, goes_on: bool) -> None:
        """Each period: for which vehicles, lost on the way, a leader waits, to `until_s` at most; and that it goes on.

        `present`: bit k-1 for vehicle k, those in its part. `goes_on`: it leads on the way, with the majority; else
        others say why the wait is over.
        """
        if not goes_on:
            self._waits_said, self._waits_due_s = [], math.inf
            self._waits_named.clear()
            return
        if waits_for == self._waits_said:
            self._waits_due_s = math.inf
        else:
            is_news = any([now_s - self._waited_s.get(k, -math.inf) > WAIT_SAID_S for k in waits_for])
            settles_s = SETTLES_S if is_news or not waits_for else LASTS_S
            self._waits_due_s = min(self._waits_due_s, now_s + settles_s)
        for vehicle in waits_for:
            self._waited_s[vehicle] = now_s
        if now_s >= self._waits_due_s:
            self._waits_said, self._waits_due_s = list(waits_for), math.inf
            self._report_wait(waits_for, until_s - now_s, present)

    def _report_wait(self, waits_for: list[int], left_s: float, present: int) -> None:
        self._waits_named.update(waits_for)
        if waits_for:
            self._add(Severity.NOTICE, f"no link to {list_vehicles(waits_for)}: waiting up to {math.ceil(left_s)} s")
            return
        without = [k for k in sorted(self._waits_named) if not present >> (k - 1) & 1]
        self._waits_named.clear()
        if without:
            self._add(Severity.NOTICE, f"swarm goes on without {list_vehicles(without)}")
        else:
            self._add(Severity.NOTICE, "links regained: swarm goes on")

    def report_wait_for_position(self, *, waits: bool) -> None:
        """A leader's each period: it waits at d1 for a surer position, or does not."""
        if waits and not self._waits_for_position:
            self._add(Severity.WARNING, "position uncertain: waiting at d1")
        self._waits_for_position = waits

    def report_layer(self, layer_m: float | None, now_s: float, *, is_steered: bool) -> None:
        """Each tick: the height of its layer (m above the origin; None: the mission's), when it is another one."""
        if not is_steered:
            self._layer_m = self._own_m  # it lands, or a pilot has it: said by others
            return
        height_m = self._own_m if layer_m is None else layer_m
        if height_m == self._layer_m or now_s - self._layer_said_s < LAYER_SAID_S:
            return
        self._layer_m, self._layer_said_s = height_m, now_s
        if height_m == self._own_m:
            self._add(Severity.NOTICE, f"back to {height_m:.1f} m: quorum")
        else:
            self._add(Severity.NOTICE, f"to layer {height_m:.1f} m: no quorum")

    def _name_phase(self, entered: SwarmPhase, before: SwarmPhase, stop: int) -> str:
        """A new phase in words."""
        if entered is SwarmPhase.TRANSIT and self._lanes:
            return f"gathered at d1: leaving for {self._name_lane(stop)}"
        if not self._has_stops or entered not in (SwarmPhase.TRANSIT, SwarmPhase.COVERAGE):
            return NEWS[entered]
        tree = f"tree {stop + 1} of {self._visits}"
        if entered is SwarmPhase.COVERAGE:
            return f"arrived at {tree}: spreading around it"
        return f"{'gathered at d1' if before is SwarmPhase.GATHER else 'coverage done'}: leaving for {tree}"

    def _name_lane(self, stop: int) -> str:
        """The lane that this visit is an end of."""
        return f"lane {stop // 2 + 1} of {self._lanes}"

    def _others_than(self, done: int) -> str:
        """The other vehicles of the swarm that are not in `done`, as a list in words."""
        others = ((1 << self._size) - 1) & ~(1 << (self._me - 1))
        return list_vehicles(ids(others & ~done))

    def _add(self, severity: Severity, text: str) -> None:
        self._reports.append(Say(severity, text))
