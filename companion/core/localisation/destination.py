"""The vector to d2, or to the visit before it that the swarm is bound for: once a tick, after the route is known.

Who leads has it from a position; a follower from those nearer to the leader, as their beacons say; where nobody tells,
it goes on by odometry. Of own positions only differences are used, but by a leader.

At another visit nothing of its own bears out what it is told. So there it goes by the leader's own word, where it hears
that; else by the median of the others', in which one false word moves nothing. Of two that contradict each other it
cannot know the false one: it has no vector then, and keeps where it is in the mission by its odometry.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, final

from companion.core.model.neighbour import Neighbour
from companion.core.model.vectors import ZERO, add, median, norm, scale, sub
from mission.common.frames import Vec3, enu_to_ned
from mission.document.model import Mission

FOLLOW_M: Final = 3.0  # that others' words count at once: odometry and they differ by less from moment to moment
TOLD_S: Final = 1.0  # that those are waited for who have not gone over to the visit yet: a hop takes a period or two
FOLLOW_MPS: Final = 0.5  # and for longer: how fast odometry may drift, and a leader goes over to GNSS
DEST_OFF_M: Final = 8.0  # estimates of a GNSS-denied swarm differ by less, but for what they say of themselves
STATED_ERROR_MAX_M: Final = 10.0  # more of what one says of its own error excuses nothing


def honest_gap_m(one_error_m: float, other_error_m: float) -> float:
    """Two vectors to one place that are farther apart contradict each other. Errors: as each states its own, m."""
    return DEST_OFF_M + min(one_error_m + other_error_m, STATED_ERROR_MAX_M)


@final
class Destination:
    """One vehicle's: `ned_m` is the vector, None while it is not known."""

    __slots__ = ("_at_ned_m", "_kept_ned_m", "_kept_s", "_known_s", "_stop", "_stops_ned_m", "lag_m", "ned_m")

    def __init__(self, mission: Mission) -> None:
        self.ned_m: Vec3 | None = None
        self.lag_m = 0.0  # how far a leader's is from what GNSS says
        self._stops_ned_m = [enu_to_ned(visit.pos_enu_m) for visit in mission.visits]
        self._at_ned_m: Vec3 | None = None  # odometry reading that goes with it
        self._kept_ned_m: Vec3 | None = None  # a follower's by its own odometry, which others' words bring round slowly
        self._kept_s = 0.0
        self._known_s = -math.inf  # when the vector was last that of the visit that the swarm is bound for
        self._stop = 0  # index of the visit that it leads to

    def update_leader(self, pos_ned_m: Vec3, stop: int) -> None:
        """From a position in the mission's frame. `stop`: index of the visit."""
        self.ned_m = sub(self._stops_ned_m[stop], pos_ned_m)
        self._keep_as_leader()
        self._note(pos_ned_m, stop)

    def update_anchored_leader(self, pos_ned_m: Vec3, stop: int, fix_ned_m: Vec3 | None, most_m: float) -> None:
        """From odometry: an heir goes on from where its predecessor knew the swarm to be.

        `fix_ned_m`: where GNSS has this vehicle, None: it does not; it goes over to that by `most_m` at once.
        """
        stop_ned_m, dest, at = self._stops_ned_m[stop], self._last_ned_m(), self._at_ned_m
        if dest is None or at is None:
            self.ned_m = sub(stop_ned_m, fix_ned_m or pos_ned_m)
        else:
            on = sub(stop_ned_m, self._stops_ned_m[self._stop])
            dest = add(on, sub(dest, sub(pos_ned_m, at)))
            if fix_ned_m is not None:
                dest, self.lag_m = _approach(dest, sub(stop_ned_m, fix_ned_m), most_m)
            self.ned_m = dest
        self._keep_as_leader()
        self._note(pos_ned_m, stop)

    def update_follower(
        self, pos_ned_m: Vec3, stop: int, upstream: Sequence[Neighbour], now_s: float, *, leader: int
    ) -> None:
        """From the neighbours nearer to the leader, as far as the own odometry bears them out; else by odometry."""
        moved = ZERO if self._at_ned_m is None else sub(pos_ned_m, self._at_ned_m)
        kept, self._at_ned_m = self._kept_ned_m, pos_ned_m
        tellers = [n for n in upstream if n.dest_ned_m is not None]
        told = [n for n in tellers if n.beacon.stop == stop]
        if stop == self._stop:
            self._known_s = now_s
        if told and kept is not None and stop == self._stop:
            self.ned_m = self._bring_round(sub(kept, moved), _mean(told), now_s)
            return
        is_complete = len(told) == len(tellers) or now_s - self._known_s > TOLD_S
        first = _find_first_word(told, leader, is_complete=is_complete)
        if first is not None:
            self.ned_m, self._stop = first, stop
            self._kept_ned_m, self._kept_s = first, now_s
            return
        last = self._last_ned_m()
        self._kept_ned_m, self._kept_s = None if last is None else sub(last, moved), now_s
        self.ned_m = self._kept_ned_m if stop == self._stop else None

    def forget_odometry(self) -> None:
        """It did not know where it is among the others: until it does, their words count alone."""
        if self.ned_m is not None:
            self._kept_ned_m = None

    def _bring_round(self, kept: Vec3, received: Vec3, now_s: float) -> Vec3:
        """The received vector, or as near to it as a false word may bring this vehicle now. `kept`: by odometry."""
        since_s, self._kept_s = max(0.0, now_s - self._kept_s), now_s
        self._kept_ned_m, _ = _approach(kept, received, FOLLOW_MPS * since_s)
        found, _ = _approach(self._kept_ned_m, received, FOLLOW_M)
        return found

    def _last_ned_m(self) -> Vec3 | None:
        """The vector to the last visit that it has known one of."""
        return self._kept_ned_m if self.ned_m is None else self.ned_m

    def offset_ned_m(self, pos_ned_m: Vec3) -> Vec3:
        """The position in the mission's frame less `pos_ned_m`, level, if the vector is true; ZERO: it is not known."""
        last = self._last_ned_m()
        if last is None:
            return ZERO
        there = sub(self._stops_ned_m[self._stop], last)
        return (there[0] - pos_ned_m[0], there[1] - pos_ned_m[1], 0.0)

    def closing_mps(self, ref_ned_mps: Vec3) -> float:
        """The speed at which a course comes nearer to d2; 0 where it is not known."""
        dest = self.ned_m
        if dest is None:
            return 0.0
        away_m = math.hypot(dest[0], dest[1])
        return (ref_ned_mps[0] * dest[0] + ref_ned_mps[1] * dest[1]) / away_m if away_m > 0.0 else 0.0

    def _keep_as_leader(self) -> None:
        """Its own is what it goes on from when it follows again."""
        self._kept_ned_m, self._kept_s = self.ned_m, math.inf

    def _note(self, pos_ned_m: Vec3, stop: int) -> None:
        self._at_ned_m = pos_ned_m
        self._stop = stop


def _find_first_word(told: Sequence[Neighbour], leader: int, *, is_complete: bool) -> Vec3 | None:
    """The vector to a visit that no own one bears out yet; None: no word may be gone by.

    `told`: neighbours that tell one of this visit; `is_complete`: no other one is about to.
    """
    words = {n.id: n.dest_ned_m for n in told if n.dest_ned_m is not None}
    if leader in words:
        return words[leader]
    if not words or not is_complete:
        return None
    if len(told) == 2:
        one, other = told
        apart_m = norm(sub(words[one.id], words[other.id]))
        agrees = apart_m <= honest_gap_m(one.beacon.position_error_m, other.beacon.position_error_m)
        return _mean(told) if agrees else None
    return median(list(words.values()))


def _mean(told: Sequence[Neighbour]) -> Vec3:
    total, count = ZERO, 0
    for neighbour in told:
        if neighbour.dest_ned_m is not None:
            total, count = add(total, neighbour.dest_ned_m), count + 1
    return scale(total, 1.0 / count)


def _approach(from_m: Vec3, to_m: Vec3, most_m: float) -> tuple[Vec3, float]:
    """From one vector towards another by `most_m` at most, and how far that is from it."""
    off = sub(to_m, from_m)
    off_m = norm(off)
    return (to_m, 0.0) if off_m <= most_m else (add(from_m, scale(off, most_m / off_m)), off_m - most_m)
