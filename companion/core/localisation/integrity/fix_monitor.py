"""GNSS fixes held against the own way as something else tells it: trunks in sight, odometry, or the own velocity.

A receiver that is led astray slowly passes every gate of an estimator. The way that it tells departs from the way that
trunks tell. Once a second both are noted; each note is a hypothesis, that the fix began to leave there, and the test is
how far both have parted since, against how far their errors part them: a generalised likelihood ratio over the last
WINDOW_S, the innovation sum of a drift of any rate and direction. The note that parts most is where it began.

What is uncertain between two notes: the fix at both, the other way's drift with time, and by what angle its frame is
turned from that of fixes, which lets the part across the way grow with it. A frame that was turned since then is known
no better than by that turn: one turned by 15 degrees in 76 s, in a flight whose fixes were true.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, final

Level = tuple[float, float]  # north, east
Frame = tuple[float, float, float]  # turned clockwise, rad, then moved north and east, m

NOTE_S: Final = 1.0
WINDOW_S: Final = 100


@dataclass(frozen=True, slots=True)
class Noise:
    """Sizes of the errors that part both ways, and the alarm's threshold."""

    fix_m: float  # of a fix, on an axis
    fix_memory_s: float  # of that
    walk_m2_per_s: float  # variance of the other way's drift, on an axis
    share: float  # of the way, by which the other is off along it
    alarm: float  # squared sigmas


@dataclass(frozen=True, slots=True)
class _Note:
    at_s: float
    fix_ne_m: Level
    way_ne_m: Level
    frame: Frame
    frame_rad2: float
    fix_m: float


@dataclass(frozen=True, slots=True)
class Parted:
    """A fix that has left the own way: where it would be, had it not, and by how much the other frame was turned."""

    since_s: float
    fix_ne_m: Level  # that the own way has led to by now, from the fix at that time
    turned_rad: float  # the other frame since then


@final
class FixMonitor:
    """One vehicle's."""

    __slots__ = ("_noise", "_notes")

    def __init__(self, noise: Noise) -> None:
        self._noise: Final = noise
        self._notes: deque[_Note] = deque(maxlen=WINDOW_S)

    def forget(self) -> None:
        """Begins anew: of what was before nothing can be said."""
        self._notes.clear()

    def update(
        self,
        fix_ne_m: Level,
        way_ne_m: Level,
        now_s: float,
        *,
        frame: Frame = (0.0, 0.0, 0.0),
        frame_rad2: float = 0.0,
        fix_m: float = 0.0,
        walk_since: Callable[[float], float] | None = None,
    ) -> Parted | None:
        """Both positions now, m; None: they agree, as far as is known.

        `frame`: how the other frame has been turned and moved by now; `frame_rad2`: variance of how far it is turned
        from that of fixes; `fix_m`: standard deviation of this fix on an axis, where it is more than usual;
        `walk_since`: variance of the other way's drift in a second, m2 on an axis, as it is known by now, should the
        fix have left it at the time that is asked for.
        """
        notes = self._notes
        if notes and now_s - notes[-1].at_s < NOTE_S - 1e-6:
            return None
        while notes and now_s - notes[0].at_s > WINDOW_S + 1e-6:
            notes.popleft()
        noise = self._noise
        now = _Note(now_s, fix_ne_m, way_ne_m, frame, frame_rad2, max(fix_m, noise.fix_m))
        worst, parted = noise.alarm, None
        lever_ne_m: Level = (0.0, 0.0)
        for note in reversed(notes):
            walk_m2_per_s = noise.walk_m2_per_s
            if walk_since is not None:
                walk_m2_per_s = max(walk_m2_per_s, walk_since(note.at_s))
            went_ne_m = _way_since(note, now)
            if math.hypot(*went_ne_m) > math.hypot(*lever_ne_m):
                lever_ne_m = went_ne_m
            score, led = _compare(note, now, noise, walk_m2_per_s, went_ne_m, lever_ne_m)
            if score > worst:
                worst, parted = score, Parted(note.at_s, led, frame[0] - note.frame[0])
        notes.append(now)
        return parted


def _way_since(then: _Note, now: _Note) -> Level:
    """The other way from then to now, in the frame of then."""
    at = _in_frame(now.way_ne_m, now.frame, then.frame)
    return at[0] - then.way_ne_m[0], at[1] - then.way_ne_m[1]


def _compare(
    then: _Note, now: _Note, noise: Noise, walk_m2_per_s: float, went_ne_m: Level, lever_ne_m: Level
) -> tuple[float, Level]:
    """Squared sigmas by which both ways since `then` differ, and where the other has led.

    `lever_ne_m`: from the farthest place since then. A frame that has been turned all the time is off by the way from
    then to now; one that was turned on the way, by the way from there: by all the way back, where a vehicle returns.
    """
    led = (then.fix_ne_m[0] + went_ne_m[0], then.fix_ne_m[1] + went_ne_m[1])
    off_n, off_e = now.fix_ne_m[0] - led[0], now.fix_ne_m[1] - led[1]
    (went_n, went_e), (lever_n, lever_e) = went_ne_m, lever_ne_m
    since_s, turned_rad = now.at_s - then.at_s, now.frame[0] - then.frame[0]
    var = (then.fix_m**2 + now.fix_m**2) * (1.0 - math.exp(-since_s / noise.fix_memory_s)) + walk_m2_per_s * since_s
    var = max(var + noise.share**2 * (went_n * went_n + went_e * went_e), 1e-9)
    across, turned2, shortened2 = then.frame_rad2, turned_rad**2, (0.5 * turned_rad**2) ** 2
    nn = var + across * went_e * went_e + turned2 * lever_e * lever_e + shortened2 * lever_n * lever_n
    ee = var + across * went_n * went_n + turned2 * lever_n * lever_n + shortened2 * lever_e * lever_e
    ne = (shortened2 - turned2) * lever_n * lever_e - across * went_n * went_e
    score = (ee * off_n * off_n - 2.0 * ne * off_n * off_e + nn * off_e * off_e) / (nn * ee - ne * ne)
    return score, led


def _in_frame(place: Level, now: Frame, then: Frame) -> Level:
    """A place of now as the frame of then has it."""
    n, e = place[0] - now[1], place[1] - now[2]
    turn = then[0] - now[0]
    c, s = math.cos(turn), math.sin(turn)
    return c * n - s * e + then[1], s * n + c * e + then[2]
