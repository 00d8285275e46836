"""The air between the vehicles: which frame reaches which radio, with loss and delay. Knows bytes, not their meaning.

The paper's G = (V, E): two vehicles are linked when their distance is at most the range r. Each radio has its own
range; a link needs both ranges, so G stays symmetric. What stands between two vehicles may leave a share of it alone.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mission.frames import Vec3

QUEUE_LIMIT: Final = 1024  # frames under way to one receiver; the oldest are lost beyond
MAX_RECEIVERS: Final = 256


class Radio:
    """The radios of the whole swarm, by vehicle id. Draws from `seed` alone, in the order of calls."""

    def __init__(
        self,
        *,
        range_m: float,
        loss: float,
        delay_s: float,
        seed: int,
        share: Callable[[Vec3, Vec3], float] | None = None,
    ) -> None:
        """`range_m`: of every radio until it is set; `loss`: 0..1, for each frame and receiver.

        `delay_s`: the mean; each frame and receiver draws its own, even over 0..2 delay_s.
        `share`: 0..1, of the range between two places (NED m) that what stands there leaves; None: all of it.
        """
        self.cut_off: tuple[frozenset[int], ...] = ()  # groups of ids whose radios reach only one another
        self._ranges_m = np.full(MAX_RECEIVERS, range_m)
        self._loss = loss
        self._delay_s = delay_s
        self._rng = np.random.default_rng([seed, 0x5AD10])
        self._positions: Mapping[int, Vec3] = {}
        self._ids: NDArray[np.intp] = np.zeros(0, np.intp)  # of the radios that are placed, rising
        self._distances_m: dict[int, NDArray[np.float64]] | None = None  # by id, to each of `_ids`
        self._under_way: dict[int, list[tuple[float, int, bytes]]] = {}
        self._count = 0
        self._share = share
        self._shares: dict[tuple[int, int], float] = {}  # by pair of ids, the lower first: where they are now

    def range_m(self, vehicle_id: int) -> float:
        """The range that this vehicle's radio is set to."""
        return float(self._ranges_m[vehicle_id])

    def set_range(self, vehicle_id: int, range_m: float) -> None:
        """Set this vehicle's radio to `range_m`."""
        self._ranges_m[vehicle_id] = range_m

    def place(self, positions: Mapping[int, Vec3]) -> None:
        """Where the radios are from now on: NED m, by id. One that is not among them neither sends nor hears."""
        self._positions = positions
        self._distances_m = None
        self._shares.clear()

    def send(self, sender: int, frame: bytes, now_s: float) -> None:
        """Broadcast one frame. KeyError when the sender has no place."""
        distances_m = (self._distances_m or self._measure())[sender]
        ids, ranges_m = self._ids, self._ranges_m
        reached = distances_m <= np.minimum(ranges_m[ids], ranges_m[sender])
        # One draw per possible receiver, so that one radio's place does not change what another loses.
        if self._loss > 0.0:
            reached &= self._rng.random(MAX_RECEIVERS)[ids] >= self._loss
        delays_s = self._rng.random(MAX_RECEIVERS) * (2.0 * self._delay_s) if self._delay_s > 0.0 else None
        for receiver in ids[reached].tolist():
            if receiver == sender or any((sender in group) is not (receiver in group) for group in self.cut_off):
                continue
            if self._share is not None and self._hidden(sender, receiver, distances_m):
                continue
            due_s = now_s if delays_s is None else now_s + float(delays_s[receiver])
            queue = self._under_way.setdefault(receiver, [])
            self._count += 1
            heapq.heappush(queue, (due_s, self._count, frame))
            if len(queue) > QUEUE_LIMIT:
                heapq.heappop(queue)

    def _hidden(self, sender: int, receiver: int, distances_m: NDArray[np.float64]) -> bool:
        """Whether what stands between two radios, which are in range of each other, leaves too little of it."""
        pair = (sender, receiver) if sender < receiver else (receiver, sender)
        share = self._shares.get(pair)
        if share is None:
            assert self._share is not None
            share = self._shares[pair] = self._share(self._positions[sender], self._positions[receiver])
        if share == 1.0:
            return False
        range_m = min(self._ranges_m[sender], self._ranges_m[receiver])
        return bool(distances_m[np.searchsorted(self._ids, receiver)] > range_m * share)

    def _measure(self) -> dict[int, NDArray[np.float64]]:
        """All distances at once: most of those that are placed send before they are placed anew."""
        ids = sorted(self._positions)
        places = np.array([self._positions[k] for k in ids])
        apart = places[:, None] - places
        self._ids = np.array(ids)
        self._distances_m = dict(zip(ids, np.sqrt((apart * apart).sum(axis=2)), strict=True))
        return self._distances_m

    def deliver(self, receiver: int, now_s: float) -> bytes:
        """One datagram of all the frames that have reached `receiver` by now, unmodified."""
        queue = self._under_way.get(receiver)
        arrived = []
        while queue and queue[0][0] <= now_s:
            arrived.append(heapq.heappop(queue)[2])
        return b"".join(arrived)
