"""The search of parts of a swarm that have lost one another, until they are together again.

Each holds, and flies back its own way to its last link: then they stand as they stood when they still heard one
another. If that does not help, the part with the majority goes on after a while. The other flies to where it heard the
others last, then ahead to where the swarm was bound, and stays outside there.

Only vehicles that sense obstacles look for others (missions with `[sensing]`): those that they do not hear they can
still see. The acting leader of a part looks, and its followers follow it. A vehicle alone is a part of one. Positions
are NED m of the vehicle's own odometry.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from enum import Enum
from typing import Final, final

from companion.core.model.breadcrumbs import BreadcrumbTrail
from companion.core.model.vectors import ZERO, norm, sub
from companion.core.swarm.roster import ids
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.failsafe import Cause
from mission.common.frames import Vec3

# The row says how long a part holds before it looks, and its majority waits for each that is lost.
OTHERS_LOST: Final = failsafe_engine.row(Cause.OTHERS_LOST)
STEP_M: Final = 1.0  # between two positions of a trail
KEPT: Final = 80  # positions: as many metres of the way, more than a swarm is wide
RETRACE_LIMIT_S: Final = 20.0
APPROACH_LIMIT_S: Final = 20.0
STANDS_S: Final = 2.0  # trees, or those that are taken to hang there, let it come no nearer
MOVED_M: Final = 0.5
REACHED_M: Final = 1.0
LISTEN_S: Final = 5.0  # at each position ahead: what is there is heard by then
BEYOND: Final = 4  # positions farther back: it is a second, and some metres, until a link that is cut is missed
FAR_BEYOND: Final = 20  # without the majority: those that were the link may not have come back as far; heard, it stops
AHEAD_M: Final = 5.0  # of the way back: nearer, a vehicle would not reach the speed of its cruise
LOST_S: Final = 1.5  # so long not among those that are there: a branch that goes over to another parent is back by then
LINGER_S: Final = 3.0  # at its last link
HERE_S: Final = 4.0  # so long among the others again, until it is over
AGAIN_S: Final = 40.0  # lost again so soon: what cut them off stands on the way, and going back once more leads nowhere
LED_MPS: Final = 0.7  # slower is no course
TURNS_S: Final = 0.5  # so much later it hears of the course of a leader that goes on
AT_ONCE: Final = 6  # positions of the way back that one may be past at once
ON_S: Final = 8.0  # lost again, the majority first goes on for so long: past what cuts them off, or part of the way


@final
class LinkTrail:
    """The way of a vehicle, and which peers it was linked to at each position, over others too (bit k-1: vehicle k)."""

    __slots__ = ("_linked", "_to_go", "_trail")

    def __init__(self) -> None:
        self._trail = BreadcrumbTrail(STEP_M, KEPT)
        self._linked: deque[int] = deque(maxlen=KEPT)  # one for each crumb
        self._to_go = 0  # crumbs still to go back to

    def record_links(self, pos_ned_m: Vec3, linked: int) -> None:
        """It is here, and linked to these."""
        if self._trail.append(pos_ned_m):
            self._linked.append(linked)
        else:
            self._linked[-1] |= linked

    def turn_back(self, lost: int, *, beyond: int = BEYOND) -> bool:
        """Turn back, to `beyond` the last position with a link to one of `lost`; False: it keeps no such position."""
        self._to_go = 0
        for k in range(len(self._linked)):
            if self._linked[-1 - k] & lost:
                self._to_go = min(k + 1 + beyond, len(self._linked))
                return True
        return False

    def next_waypoint(self, pos_ned_m: Vec3) -> Vec3 | None:
        """The next position on the way back; None: there is no more. What it has come back along is forgotten."""
        # Of some positions the farthest back: a vehicle cuts corners.
        passed = self._trail.reached(pos_ned_m, REACHED_M, min(self._to_go, AT_ONCE))
        self._trail.drop(passed)
        for _ in range(passed):
            self._linked.pop()
        self._to_go -= passed
        if not self._to_go:
            return None
        within = min(self._trail.count_within(pos_ned_m, AHEAD_M), self._to_go)
        return self._trail.crumb(max(0, within - 1))


class Stage(Enum):
    """The stages of a part's search; the value says so in words."""

    HOLD = "holding"
    RETRACE = "back to the last link"
    APPROACH = "at last known position"
    AHEAD = "ahead, then wait"
    WAIT = "nothing left to try"


class PartitionRecovery:
    """An acting leader's, while others are lost. `goal`: as `Phases.goal`; None: it holds."""

    __slots__ = (
        "_ahead_index",
        "_here_last_s",
        "_here_s",
        "_moved_from_ned_m",
        "_moved_s",
        "_since_s",
        "_there_s",
        "back_s",
        "goal",
        "on_s",
        "stage",
        "trail",
    )

    def __init__(self) -> None:
        self.trail = LinkTrail()
        self.stage = Stage.HOLD
        self.goal: tuple[Vec3, float] | None = None
        self._since_s = self._moved_s = 0.0
        self._moved_from_ned_m = ZERO
        self._ahead_index = 0  # of those ahead
        self.back_s = self.on_s = -math.inf  # when this vehicle has gone back last, and from when on it has gone on
        self._here_last_s = -math.inf  # when the others were here last
        self._there_s = 0.0  # since when it is back at its last link
        self._here_s: float | None = None  # since when the others are here again

    def note_course(self, to_goal_mps: float, now_s: float) -> None:
        """Each period under way: how fast the course that it flies on, whichever gave it, comes nearer to the goal."""
        if to_goal_mps <= -LED_MPS:
            self.back_s = now_s
        elif to_goal_mps >= LED_MPS and self.on_s < self.back_s:
            self.on_s = now_s

    def is_again(self, lost_s: float) -> bool:
        """Others that are lost from `lost_s` on were so lately: they went back to one another, and had gone on."""
        return self.back_s < self.on_s <= lost_s + TURNS_S and lost_s < self.back_s + AGAIN_S

    @property
    def hold_s(self) -> float:
        """The time that a part holds before it looks for the others: lost again, it goes ahead at once."""
        return 0.0 if self.is_again(self._here_last_s) else OTHERS_LOST.delay_s

    def end(self, now_s: float) -> None:
        """They are here again, or not waited for any more, or another leads. Lost again in a moment, it goes on."""
        self.goal = None
        if self._here_s is None:
            self._here_s = now_s
        self._here_last_s = now_s
        if now_s - self._here_s >= HERE_S or self.on_s > self.back_s:
            self.stage = Stage.HOLD

    def update(
        self,
        now_s: float,
        pos_ned_m: Vec3,
        *,
        lost_s: float,
        lost: int,
        heard_at: Vec3 | None,
        ahead: Sequence[tuple[Vec3, float]],
        beyond: int = BEYOND,
    ) -> None:
        """One period. `lost`: which it misses, and `lost_s` for how long.

        `heard_at`: where the one of them that was heard last was then, None: nowhere; `ahead`: where the swarm was
        bound, one position after the other, and how far outside to stay; `beyond`: as in `LinkTrail.turn_back`.
        """
        if lost_s < self.hold_s:
            self.end(now_s)
            return
        self._here_s = None
        if self.stage is Stage.HOLD:
            self._begin_search(lost, beyond, now_s)
        if self.stage is Stage.RETRACE:
            self._run_retrace(pos_ned_m, now_s)
        if self.stage is Stage.APPROACH:
            self._run_approach(pos_ned_m, heard_at, now_s)
        if self.stage is Stage.WAIT and self._ahead_index < len(ahead):  # it had the majority when it began to wait
            self._enter_stage(Stage.AHEAD, now_s)
        if self.stage is Stage.AHEAD:
            self._run_ahead(pos_ned_m, ahead, now_s)
        if self.stage is Stage.WAIT:
            self.goal = None

    def _begin_search(self, lost: int, beyond: int, now_s: float) -> None:
        self._ahead_index = 0
        if self.is_again(self._here_last_s):
            self._enter_stage(Stage.AHEAD, now_s)
        else:
            self._enter_stage(Stage.RETRACE if self.trail.turn_back(lost, beyond=beyond) else Stage.APPROACH, now_s)

    def _run_retrace(self, pos_ned_m: Vec3, now_s: float) -> None:
        """Back along the own way; at its end it lingers: the others may still be on their way back to theirs."""
        position = self.trail.next_waypoint(pos_ned_m)
        self.goal = None if position is None else (position, 0.0)
        if position is not None:
            self._there_s = now_s
        vain = position is not None and self._is_vain(pos_ned_m, now_s, RETRACE_LIMIT_S)
        if vain or now_s - self._there_s > LINGER_S:
            self._enter_stage(Stage.APPROACH, now_s)

    def _run_approach(self, pos_ned_m: Vec3, heard_at: Vec3 | None, now_s: float) -> None:
        # If one hangs there the leader's own way leads to a position beside it (`avoidance.find_clear_position`).
        self.goal = None if heard_at is None else (heard_at, 0.0)
        if _is_there(pos_ned_m, self.goal) or self._is_vain(pos_ned_m, now_s, APPROACH_LIMIT_S):
            self._enter_stage(Stage.AHEAD, now_s)

    def _run_ahead(self, pos_ned_m: Vec3, ahead: Sequence[tuple[Vec3, float]], now_s: float) -> None:
        self.goal = ahead[self._ahead_index] if self._ahead_index < len(ahead) else None
        if self.goal is None:
            self._enter_stage(Stage.WAIT, now_s)
        elif not _is_there(pos_ned_m, self.goal):
            self._since_s = now_s
        elif now_s - self._since_s > LISTEN_S:
            self._ahead_index += 1

    def _enter_stage(self, stage: Stage, now_s: float) -> None:
        self.stage, self._since_s, self._moved_s, self._there_s = stage, now_s, now_s, now_s

    def _is_vain(self, pos_ned_m: Vec3, now_s: float, limit_s: float) -> bool:
        """It has taken too long, or the vehicle stands."""
        if norm(sub(pos_ned_m, self._moved_from_ned_m)) > MOVED_M:
            self._moved_from_ned_m, self._moved_s = pos_ned_m, now_s
        return now_s - self._since_s > limit_s or now_s - self._moved_s > STANDS_S


def _is_there(pos_ned_m: Vec3, goal: tuple[Vec3, float] | None) -> bool:
    """No goal, or as near to it as one goes."""
    return goal is None or norm(sub(goal[0], pos_ned_m)) <= goal[1] + REACHED_M


class LostPeerTimer:
    """The majority's: for how long each of the others has not been there, and whether its leader still waits for it."""

    __slots__ = ("_due_s", "_limit_s", "_since_s", "_waited_s", "until_s")

    def __init__(self, limit_s: float = OTHERS_LOST.limit_s) -> None:
        """`limit_s`: how long each is waited for."""
        self._limit_s: Final = limit_s
        self.until_s = 0.0  # no longer: of those that are waited for the last
        self._since_s: dict[int, float] = {}
        self._due_s: dict[int, float] = {}  # from when on each of these is waited for
        self._waited_s: dict[int, float] = {}  # when each was lost of which that was last

    def update(self, missing: int, now_s: float, search: PartitionRecovery) -> list[int]:
        """One period; which are waited for now, ascending. `missing`: bit k-1 for vehicle k.

        Those that are lost again are waited for later: what cuts them off stands on the way.
        """
        self._since_s = {k: self._since_s.get(k, now_s) for k in ids(missing)}
        self._due_s = {k: due_s for k, due_s in self._due_s.items() if k in self._since_s}
        waits = []
        for k, since_s in self._since_s.items():
            if now_s - since_s < LOST_S:
                continue
            if k not in self._due_s:
                again = since_s - self._waited_s.get(k, -math.inf) < AGAIN_S or search.is_again(since_s)
                self._due_s[k] = since_s + LOST_S + (ON_S if again else 0.0)
                self._waited_s[k] = since_s
            if 0.0 <= now_s - self._due_s[k] < self._limit_s:
                waits.append(k)
        self.until_s = max([self._due_s[k] + self._limit_s for k in waits], default=now_s)
        return waits

    def waited_s(self, now_s: float) -> float:
        """For the one that is waited for since last."""
        return now_s - max([due_s for due_s in self._due_s.values() if due_s <= now_s], default=now_s)

    def end(self) -> None:
        """Another leads."""
        self._since_s.clear()
        self._due_s.clear()


def stay_outside_m(radius_m: float, soft_m: float) -> float:
    """Distance from a tree of a part without the majority: two separations from the ring or sphere of the others."""
    return radius_m + 2.0 * soft_m
