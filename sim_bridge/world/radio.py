"""The air between the vehicles: who hears whom, with loss and delay. Works on frames, never on their meaning.

The paper's G = (V, E): two vehicles are linked when their distance is at most the range r. Each radio has its own
range, which its companion sets and announces in its beacon; a link needs both ranges, so G stays symmetric.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping

import numpy as np

from companion.mavlink.beacon import WireBeacon, beacons
from mission.frames import Vec3

QUEUE_LIMIT = 1024  # frames under way to one receiver; the oldest are lost beyond
MAX_RECEIVERS = 256


class Radio:
    """One hub for the whole swarm. Draws from `seed` alone, in the order of calls."""

    def __init__(self, *, range_m: float, loss: float, delay_s: float, seed: int) -> None:
        """`delay_s`: mean; each frame and receiver draws its own, even over 0..2 delay_s."""
        self.heard: dict[int, WireBeacon] = {}  # last valid beacon of each sender, for reports
        self.heard_s: dict[int, float] = {}  # when that was
        self.refused = 0  # beacons in another's name
        self.cut_off: tuple[frozenset[int], ...] = ()  # groups that hear nobody outside, and are not heard there
        self._range_m = range_m
        self._loss = loss
        self._delay_s = delay_s
        self._rng = np.random.default_rng([seed, 0x5AD10])
        self._under_way: dict[int, list[tuple[float, int, bytes]]] = {}
        self._count = 0

    def range_m(self, vehicle_id: int) -> float:
        """The range that this vehicle's radio is set to."""
        heard = self.heard.get(vehicle_id)
        return self._range_m if heard is None else heard.range_dm / 10.0

    def send(self, sender: int, data: bytes, positions: Mapping[int, Vec3], now_s: float) -> list[bytes]:
        """A datagram from `sender`'s own socket; returns the valid beacons in it. `positions`: NED m, of all."""
        accepted = []
        for system, frame, beacon in beacons(data):
            if system != sender:
                self.refused += 1
                continue
            self.heard[sender], self.heard_s[sender] = beacon, now_s
            self._broadcast(sender, frame, positions, now_s)
            accepted.append(frame)
        return accepted

    def _broadcast(self, sender: int, frame: bytes, positions: Mapping[int, Vec3], now_s: float) -> None:
        # One draw per possible receiver, so that who is in range does not shift the others' luck.
        lost = self._rng.random(MAX_RECEIVERS) < self._loss if self._loss > 0.0 else None
        delays = self._rng.random(MAX_RECEIVERS) * (2.0 * self._delay_s) if self._delay_s > 0.0 else None
        here, range_m = positions[sender], self.range_m(sender)
        for receiver in sorted(positions):
            if receiver == sender or (lost is not None and lost[receiver]):
                continue
            if any((sender in group) is not (receiver in group) for group in self.cut_off):
                continue
            if math.dist(here, positions[receiver]) > min(range_m, self.range_m(receiver)):
                continue
            due_s = now_s if delays is None else now_s + float(delays[receiver])
            queue = self._under_way.setdefault(receiver, [])
            self._count += 1
            heapq.heappush(queue, (due_s, self._count, frame))
            if len(queue) > QUEUE_LIMIT:
                heapq.heappop(queue)

    def deliver(self, receiver: int, now_s: float) -> bytes:
        """One datagram of all the frames that have reached `receiver` by now, unmodified."""
        queue = self._under_way.get(receiver)
        arrived = []
        while queue and queue[0][0] <= now_s:
            arrived.append(heapq.heappop(queue)[2])
        return b"".join(arrived)
