"""Small model of who decides: the beacons that a flight may have, one after the other. Each flight is a trace of it.

A vehicle *decides* when it has said for DECIDES_AFTER_S, without a break, that it leads and that its part has the
majority. Then, whatever is lost, cut off or started again:

| rule | |
|---|---|
| one decides | two vehicles never do at once |
| a phase is decided | who tells one first leads the majority, for so long but before takeoff; the table has the step |
| phases go on | nobody tells an earlier one than before, nor a new one without knowing the newest |

A member that lies is not judged from then on; what it has told may be believed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from companion.core.model.states import SwarmPhase
from companion.core.swarm.phases import Phases, progress_of
from companion.core.swarm.roster import DECIDES_AFTER_S
from companion.mavlink.own_messages import AIRBORNE, QUORUM, WireBeacon
from mission.document.model import Mission

PERIODS_S: Final = 0.25  # two beacons, and a tick: so much later or earlier a beacon tells what has been decided
KNOWN_S: Final = 2.0  # in which what one tells is known to all that hear it
Progress = tuple[bool, int, SwarmPhase]


class Authority:
    """Model of one flight: `judge_tick` with each tick's last beacons returns what breaks a rule, in words; or ""."""

    def __init__(self, mission: Mission) -> None:
        self._mission = mission
        self._told: dict[int, tuple[SwarmPhase, int]] = {}  # by vehicle: phase and stop
        self._first_s: dict[Progress, tuple[float, int]] = {}  # by phase: when it was told first, and by whom
        self._leads_s: dict[int, float] = {}  # by vehicle: since when it says that it leads the majority
        self._left: dict[int, WireBeacon] = {}  # by vehicle: what it had said last when it ceased to answer
        self._has_flown = False

    def deciding(self, now_s: float) -> list[int]:
        """The vehicles that decide."""
        return [k for k, since_s in self._leads_s.items() if now_s - since_s >= DECIDES_AFTER_S + PERIODS_S]

    def judge_tick(self, now_s: float, said: Mapping[int, WireBeacon], answered: Iterable[int], liars: set[int]) -> str:
        """One tick: the last beacon of each, and whose companions have answered in it."""
        answers = set(answered)
        # One that is started again says nothing in its first ticks: what it said in its life before is not its word now
        there = {k for k in answers & said.keys() if self._left.get(k) != said[k]}
        for gone in self._told.keys() - there:  # stalled, or started again: it may know nothing
            del self._told[gone]
            self._leads_s.pop(gone, None)
        self._left = {k: beacon for k, beacon in said.items() if k not in answers or self._left.get(k) == beacon}
        self._has_flown |= any(said[k].flags & AIRBORNE for k in there)
        broken = [self._read_beacon(k, said[k], now_s, is_judged=k not in liars) for k in sorted(there)]
        deciding = [k for k in self.deciding(now_s) if k not in liars]
        if len(deciding) > 1:
            broken.append(f"vehicles {', '.join(map(str, sorted(deciding)))} decide at once")
        return next((what for what in broken if what), "")

    def _read_beacon(self, vehicle: int, said: WireBeacon, now_s: float, *, is_judged: bool) -> str:
        if said.acting_leader == vehicle and said.flags & QUORUM:
            self._leads_s.setdefault(vehicle, now_s)
        else:
            self._leads_s.pop(vehicle, None)
        now = (SwarmPhase(said.swarm_phase), said.stop)
        before = self._told.get(vehicle)
        self._told[vehicle] = now
        progress = progress_of(*now)
        is_first = progress not in self._first_s
        if is_first:
            self._first_s[progress] = (now_s, vehicle)
        if before is None or before == now or not is_judged:
            return ""
        if progress < progress_of(*before):
            return f"vehicle {vehicle} goes back from {before[0].name} to {now[0].name}"
        return self._judge_decision(vehicle, before, now, now_s) if is_first else ""

    def _judge_decision(
        self, vehicle: int, before: tuple[SwarmPhase, int], now: tuple[SwarmPhase, int], now_s: float
    ) -> str:
        """Of the first that tells a phase."""
        what = f"vehicle {vehicle} enters {now[0].name}"
        since_s = self._leads_s.get(vehicle)
        wait_s = DECIDES_AFTER_S - PERIODS_S if self._has_flown else 0.0
        if since_s is None or now_s - since_s < wait_s:
            led_s = 0.0 if since_s is None else now_s - since_s
            return f"{what}, and has led the majority for {led_s:.1f} s"
        known = Phases(self._mission)
        known.adopt_phase(before[0], now_s, before[1])
        if not known.is_step(*now):
            return f"{what} from {before[0].name}: that is no step"
        for progress, (told_s, whose) in self._first_s.items():
            is_between = progress_of(*before) < progress < progress_of(*now)
            if is_between and now_s - told_s > KNOWN_S and whose in self._told:
                return f"{what} from {before[0].name}, though vehicle {whose} has told {progress[2].name} before"
        return ""
