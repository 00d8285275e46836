"""Observes a flight as a person does, whichever driver flies it: leader, phase, texts, and whether it is over."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

import numpy as np

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from companion.mavlink.framing.texts import Reader
from mission.common.forming import FORMING_LIMIT_S
from mission.common.frames import enu_to_ned
from mission.document.model import AtEnd, Mission
from mission.stand.stand import Stand
from sim_bridge.judge.coverage_end import CoverageEnd
from sim_bridge.judge.progress import Status
from sim_bridge.judge.tick import OBSTACLES, Tick
from sim_bridge.judge.tlog import TlogWriter
from sim_bridge.judge.verdict import COVERED, LANDED

OPEN_FIELD: Final = Stand()
REPEAT_TEXT_S: Final = 5.0  # those that say the same within this time are shown together, at its end
LEFT_LIMIT_S = (
    60.0  # for vehicles without a companion: an autopilot that lands by itself does so from 30 m in that time
)
STATUSTEXT_ID = dialect.MAVLINK_MSG_ID_STATUSTEXT.to_bytes(3, "little")  # as in a frame's header


class SharedTexts:
    """Texts that several say: the first is shown at once, the others by their numbers at the end of REPEAT_TEXT_S."""

    def __init__(self) -> None:
        self._others: dict[str, tuple[float, list[int]]] = {}  # by text, the oldest first: since when, and who
        self._said_s: dict[tuple[int, str], float] = {}  # by vehicle and text

    def add(self, now_s: float, vehicle_id: int, text: str) -> str:
        """The line to show now; empty: it is shown later, or the vehicle has said the same a moment ago."""
        is_again = now_s - self._said_s.get((vehicle_id, text), -math.inf) <= REPEAT_TEXT_S
        self._said_s[vehicle_id, text] = now_s
        if is_again:
            return ""
        if text in self._others:
            self._others[text][1].append(vehicle_id)
            return ""
        self._others[text] = (now_s, [])
        return f"vehicle {vehicle_id}: {text}"

    def take_due(self, now_s: float) -> list[str]:
        """The lines for those that said the same as another whose time is over."""
        found = []
        while self._others:
            text, (began_s, others) = next(iter(self._others.items()))
            if now_s - began_s < REPEAT_TEXT_S:
                break
            del self._others[text]
            if others:
                found.append(f"vehicle{'s' * (len(others) > 1)} {name_runs(others)} also: {text}")
        return found


def name_runs(vehicles: Iterable[int]) -> str:
    """Ids in words, of three and more in a row the first and the last: 1, 2, 4 to 8."""
    runs: list[list[int]] = []
    for vehicle in sorted(vehicles):
        if runs and vehicle == runs[-1][-1] + 1:
            runs[-1].append(vehicle)
        else:
            runs.append([vehicle])
    return ", ".join([f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs])


class Observer:
    """Reads every tick, and keeps the logs of the vehicles' links."""

    def __init__(self, mission: Mission, ids: Iterable[int], folder: Path | None, stand: Stand = OPEN_FIELD) -> None:
        """Logs go to `folder`; None: none are kept. `stand`: the mission's.

        OSError where one cannot be opened; later, that is an event.
        """
        self.mission = mission
        self.events: list[tuple[float, str]] = []
        self._files = ExitStack()
        self._texts = {k: Reader() for k in ids}
        self._tlogs: dict[int, TlogWriter] = {}
        if folder is not None:
            for k in self._texts:
                self._tlogs[k] = self._files.enter_context(
                    TlogWriter(folder / f"vehicle-{k}.tlog", self._note_lost_log)
                )
        self._kept_s = 0.0  # time of what was logged last
        self.epoch_us = time.time_ns() // 1000  # Unix time of time 0
        self.tap: Callable[[float, int, bytes], None] | None = None  # is told what the telemetry logs are
        self._framing = Framing(frozenset({dialect.MAVLINK_MSG_ID_STATUSTEXT}))
        self._shared = SharedTexts()
        self._now_s = 0.0
        self._reported: set[str] = set()
        self._coverage = CoverageEnd(mission, stand)
        self._landed_since_s: float | None = None  # all but vehicles whose companions are dead
        self._limit_s = mission.sim.time_limit_s or time_limit_s(mission)

    def finished(self, tick: Tick) -> str | None:
        """Reason why the flight is over, or None. To be asked each tick."""
        now_s = self._now_s = tick.time_s
        self._tell_shared(now_s)
        for vehicle_id, what in enumerate(tick.touched, start=1):
            if what:
                self.tell_once(now_s, f"vehicle {vehicle_id} has run into {OBSTACLES[what]}")
        if not tick.alive:
            return "no companion left"
        if now_s >= self._limit_s:
            return f"time limit of {self._limit_s:.0f} s reached"
        phase = tick.phase(tick.alive)
        at_d2 = tick.stop(tick.alive) == len(self.mission.visits) - 1
        holds = self.mission.route.at_end is AtEnd.HOLD
        if holds and phase is SwarmPhase.COVERAGE and at_d2 and self._coverage.is_over(tick):
            return COVERED
        return self._landed(tick, phase)

    def _landed(self, tick: Tick, phase: SwarmPhase) -> str | None:
        """True when all have landed, in the last phase or having given up before it."""
        armed = {vehicle_id for vehicle_id, is_armed in enumerate(tick.armed, start=1) if is_armed}
        gave_up = any(tick.said[k].flight_state == FlightState.LANDED for k in tick.alive if k in tick.said)
        if armed & set(tick.alive) or not (gave_up or phase is SwarmPhase.LAND):
            self._landed_since_s = None
            return None
        if not armed:
            return LANDED
        if self._landed_since_s is None:
            self._landed_since_s = tick.time_s
        if tick.time_s - self._landed_since_s < LEFT_LIMIT_S:
            return None
        return f"{LANDED} but {', '.join(map(str, sorted(armed)))}"

    def status(self, tick: Tick, real_time_factor: float) -> Status:
        """A glance at the swarm."""
        leader = tick.leader(tick.answered)
        stop = min(tick.stop(tick.answered), len(self.mission.visits) - 1)
        goal_ned_m = enu_to_ned(self.mission.visits[stop].pos_enu_m)
        first, second = np.triu_indices(len(tick.pos_ned_m), k=1)
        positions, ranges_m = np.array(tick.pos_ned_m), np.array(tick.range_m)
        distances_m = np.linalg.norm(positions[first] - positions[second], axis=1)
        return Status(
            time_s=tick.time_s,
            phase=tick.phase(tick.answered).name.lower(),
            leader=leader,
            to_go_m=None if leader is None else math.dist(tick.pos_ned_m[leader - 1], goal_ned_m),
            separation_m=float(distances_m.min()) if distances_m.size else None,
            links=int(np.count_nonzero(distances_m <= np.minimum(ranges_m[first], ranges_m[second]))),
            real_time_factor=real_time_factor,
        )

    def log_traffic(self, now_s: float, vehicle_id: int, data: bytes, said: bytes = b"") -> None:
        """Log what went over a vehicle's links: `data` and then `said`, its companion's words to the autopilot."""
        if vehicle_id in self._tlogs:
            self._kept_s = now_s
            self._tlogs[vehicle_id].write(self.epoch_us + round(now_s * 1e6), data + said)
        if self.tap is not None:
            self.tap(now_s, vehicle_id, data + said)
        if STATUSTEXT_ID in said:  # a glance, as most ticks say nothing
            self._note_texts(vehicle_id, said, now_s)

    def tell_once(self, now_s: float, text: str) -> None:
        """An event that is none the second time."""
        if text not in self._reported:
            self._reported.add(text)
            self.events.append((now_s, text))

    def close(self) -> None:
        """Close the logs, and say what was still to be said."""
        self._tell_shared(math.inf)
        self._files.close()

    def _note_lost_log(self, why: str) -> None:
        self.events.append((self._kept_s, why))

    def _note_texts(self, vehicle_id: int, said: bytes, now_s: float) -> None:
        self._now_s = now_s
        for message in self._framing.parse(said):
            text = self._texts[vehicle_id].read_text(message)
            if text is None:
                continue
            line = self._shared.add(now_s, vehicle_id, text)
            if line:
                self.events.append((now_s, line))

    def _tell_shared(self, due_s: float) -> None:
        self.events.extend((self._now_s, line) for line in self._shared.take_due(due_s))


def time_limit_s(mission: Mission) -> float:
    """Time after which a flight has failed: generous for each part of it."""
    cruise_s = mission.way_m / mission.route.vel_leader_mps
    climb_s = mission.route.d1_enu_m[2] / mission.limits.climb_max_mps
    back = mission.route.at_end is AtEnd.RETURN
    legs = 2 if back else 1
    covers_s = sum(visit.duration_s for visit in mission.visits)
    if mission.route.at_end is not AtEnd.HOLD:
        covers_s += FORMING_LIMIT_S
    return 150.0 + mission.swarm.start_timeout_s + 4.0 * climb_s + 3.0 * legs * cruise_s + covers_s
