"""Vehicles with clocks of their own that measure the age of one another's beacons, over a drawn radio."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from companion.core.localisation.beacon_age import BeaconAges
from companion.core.model.beacon import Beacon
from tests.unit.core.core_kit import beacon

TICK_S = 0.05
TICKS_PER_BEACON = 2
Tamper = Callable[[Beacon], Beacon]


@dataclass
class Clock:
    """A vehicle's: what it shows at time 0, how fast it is, and when it ticks first."""

    shows_s: float = 0.0
    fast: float = 0.0  # 1e-6: parts per million
    phase_s: float = 0.0

    def at(self, true_s: float) -> float:
        return self.shows_s + (1.0 + self.fast) * true_s

    def tick_s(self, tick: int) -> float:
        """True time of a tick."""
        return self.phase_s + tick * TICK_S / (1.0 + self.fast)


@dataclass(order=True)
class Flying:
    due_s: float
    order: int
    made_s: float = field(compare=False)
    said: Beacon = field(compare=False)


class Airwaves:
    """`ages[k]` is vehicle k's. `delay_s` draws one beacon's delay, by sender and receiver."""

    def __init__(
        self,
        clocks: dict[int, Clock],
        delay_s: Callable[[random.Random, int, int], float],
        *,
        loss: float = 0.0,
        seed: int = 1,
        tamper: dict[int, Tamper] | None = None,
        stamps: bool = False,
    ) -> None:
        """`stamps`: a beacon counts as arrived when it did, not with the tick that takes it in."""
        self._stamps = stamps
        self.clocks, self._delay_s, self._loss = clocks, delay_s, loss
        self.ages = {k: BeaconAges(k) for k in clocks}
        self._rng = random.Random(seed)
        self._tamper = tamper or {}
        self._under_way: dict[int, list[Flying]] = {k: [] for k in clocks}
        self._order = self._ticks = 0
        self.measured: dict[tuple[int, int], list[tuple[float, float, float]]] = {}
        """By receiver and sender: true time, age measured, true age; of each beacon."""

    def run(self, seconds: float) -> None:
        """On from where it stopped."""
        began, self._ticks = self._ticks, self._ticks + round(seconds / TICK_S)
        ticks = sorted(
            (clock.tick_s(tick), k, tick) for k, clock in self.clocks.items() for tick in range(began, self._ticks)
        )
        for true_s, me, tick in ticks:
            self._take_in(me, true_s)
            if tick % TICKS_PER_BEACON == 0:
                self._send(me, true_s)

    def errors_s(self, me: int, sender: int, from_s: float = 0.0) -> list[float]:
        """Measured ages less the true ones, of what has arrived since."""
        return [found - true for at_s, found, true in self.measured[(me, sender)] if at_s >= from_s]

    def _take_in(self, me: int, true_s: float) -> None:
        queue = self._under_way[me]
        while queue and queue[0].due_s <= true_s:
            one = heapq.heappop(queue)
            arrived_s = one.due_s if self._stamps else true_s
            age_s = self.ages[me].receive(one.said, self.clocks[me].at(arrived_s))
            self.measured.setdefault((me, one.said.sender), []).append((true_s, age_s, arrived_s - one.made_s))

    def _send(self, me: int, true_s: float) -> None:
        now_s = self.clocks[me].at(true_s)
        said = beacon(me, time_ms=int(now_s * 1000.0), echo=self.ages[me].make_echo(now_s))
        said = self._tamper.get(me, lambda said: said)(said)
        for other, queue in self._under_way.items():
            if other != me and self._rng.random() >= self._loss:
                self._order += 1
                heapq.heappush(queue, Flying(true_s + self._delay_s(self._rng, me, other), self._order, true_s, said))
