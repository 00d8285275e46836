"""Pace of a flight: as fast as it can, so many times real time, a step at a time, or not at all."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

WATCHED: Final = (
    5.0  # times real time, while somebody looks and nothing else was asked for: a flight takes half a minute
)
FACTOR_MIN, FACTOR_MAX = 0.05, 1000.0  # that a viewer may ask for
LAG_MAX_S: Final = 0.25  # of wall time, that is made up for; what is more is given up
LOOK_EVERY_S: Final = 0.05  # of wall time, at what viewers ask for


class Pace:
    """Of one flight in lockstep: nothing that is said here changes the flight, only when its ticks are."""

    def __init__(self, asked: float | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        """`asked`: times real time, also while nobody looks; None: as fast as it goes then."""
        self.watched = False
        self.paused = False
        self._asked = asked
        self._wanted: float | None = asked or WATCHED  # while somebody looks; None: as fast as it goes
        self._steps = 0
        self._clock = clock
        self._since: tuple[float, float, float] | None = None  # factor, and sim and wall time from which it holds

    @property
    def factor(self) -> float | None:
        """Times real time, now; None: as fast as it goes."""
        return self._wanted if self.watched else self._asked

    def want(self, factor: float | None) -> None:
        """A viewer's wish, while somebody looks; None: as fast as it goes. ValueError out of FACTOR_MIN..FACTOR_MAX."""
        if factor is not None and not FACTOR_MIN <= factor <= FACTOR_MAX:  # false for NaN
            raise ValueError(f"speed {factor:g}: must be {FACTOR_MIN:g} to {FACTOR_MAX:g}")
        self._wanted = factor

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""
        self.paused = paused
        self._steps = 0

    def step(self) -> None:
        """One tick more, and then stand still."""
        self._steps += self.paused
        self.paused = True

    def wait_s(self, now_s: float) -> float:
        """Wall time until the next tick is due, at most LOOK_EVERY_S; 0: now. `now_s`: simulated time."""
        if self.paused and self.watched:
            self._since = None
            if self._steps:
                self._steps -= 1
                return 0.0
            return LOOK_EVERY_S
        factor, wall_s = self.factor, self._clock()
        if factor is None:
            return 0.0
        if self._since is None or self._since[0] != factor:
            self._since = (factor, now_s, wall_s)
        due_s = self._since[2] + (now_s - self._since[1]) / factor
        if wall_s - due_s > LAG_MAX_S:
            self._since = (factor, now_s, wall_s)
        return min(LOOK_EVERY_S, max(0.0, due_s - wall_s))
