"""The air between the vehicles: which frame reaches which radio, with loss and delay. Knows bytes, not their meaning.

The paper's G = (V, E): two vehicles are linked when their distance is at most the range r. Each radio has its own
range; a link needs both ranges, so G stays symmetric. What stands between two vehicles may leave a share of it alone.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.trunk_attenuation import range_share

QUEUE_LIMIT: Final = 1024  # frames under way to one receiver; the oldest are lost beyond
OVERHEAD_BYTES: Final = 16  # of a frame on a slow channel: preamble, header, checksum of the radio's own
WAIT_MAX_S: Final = 1.0  # for a busy channel; a frame that would wait longer is lost
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
        bit_rate_kbps: float | None = None,
    ) -> None:
        """`range_m`: of every radio until it is set; `loss`: 0..1, for each frame and receiver.

        `delay_s`: the mean; each frame and receiver draws its own, even over 0..2 delay_s.
        `share`: 0..1, of the range between two places (NED m) that what stands there leaves; None: all of it.
        `bit_rate_kbps`: of the one channel that all share, wherever they are; None: a frame takes no time on the air.
        """
        self.cut_off: tuple[frozenset[int], ...] = ()  # groups of ids whose radios reach only one another
        self.cut_links: frozenset[tuple[int, int]] = frozenset()  # sender and receiver of each link that is cut besides
        self._ranges_m = [range_m] * MAX_RECEIVERS
        self._loss = loss
        self._delay_s = delay_s
        self._rng = np.random.default_rng([seed, 0x5AD10])
        self._aside_rng = np.random.default_rng([seed, 0xA51DE])  # beacons are lost as without what is sent aside
        self._bits_per_s = None if bit_rate_kbps is None else bit_rate_kbps * 1e3
        self._free_s = 0.0  # when the channel is
        self._positions: dict[int, Vec3] = {}  # by rising id
        self._under_way: dict[int, list[tuple[float, int, bytes]]] = {}
        self._count = 0
        self._arrived = [0] * MAX_RECEIVERS  # frames that a radio got, and that it was within range of and missed,
        self._missed = [0] * MAX_RECEIVERS  # of those that are not sent aside
        self._share = share
        self._shares: dict[tuple[int, int], float] = {}  # by pair of ids, the lower first: where they are now

    def range_m(self, vehicle_id: int) -> float:
        """The range that this vehicle's radio is set to."""
        return self._ranges_m[vehicle_id]

    def set_range(self, vehicle_id: int, range_m: float) -> None:
        """Set this vehicle's radio to `range_m`."""
        self._ranges_m[vehicle_id] = range_m

    def missed_share(self, receiver: int) -> float | None:
        """Share of what was sent within range of `receiver`, and not aside, that it missed; None: nothing was sent.

        Lost at random, to a cut, or behind what stands between; a channel that is full loses at the sender.
        """
        sent = self._arrived[receiver] + self._missed[receiver]
        return self._missed[receiver] / sent if sent else None

    @property
    def positions(self) -> Mapping[int, Vec3]:
        """Positions of the radios, NED m, by rising id."""
        return self._positions

    def place(self, positions: Mapping[int, Vec3]) -> None:
        """Sets where the radios are: NED m, by id. One that is not among them neither sends nor hears."""
        self._positions = dict(sorted(positions.items()))
        self._shares.clear()

    def send(self, sender: int, frame: bytes, now_s: float, *, aside: bool = False) -> None:
        """Broadcast one frame. KeyError when the sender has no place. `aside`: of other than beacons."""
        here = self._positions[sender]
        rng = self._aside_rng if aside else self._rng
        if self._bits_per_s is not None:
            begin_s = max(now_s, self._free_s)
            if begin_s - now_s > WAIT_MAX_S:
                return
            now_s = self._free_s = begin_s + (len(frame) + OVERHEAD_BYTES) * 8.0 / self._bits_per_s
        # One draw per possible receiver, so that one radio's place does not change what another loses.
        losses = rng.random(MAX_RECEIVERS).tolist() if self._loss > 0.0 else None
        longest_s = 2.0 * self._delay_s
        delays_s = [draw * longest_s for draw in rng.random(MAX_RECEIVERS).tolist()] if self._delay_s > 0.0 else None
        own_range_m = self._ranges_m[sender]
        for receiver, there in self._positions.items():  # written out: for each frame, every radio there is
            range_m = self._ranges_m[receiver]
            if own_range_m < range_m:
                range_m = own_range_m
            x, y, z = there[0] - here[0], there[1] - here[1], there[2] - here[2]
            distance_m = math.sqrt(x * x + y * y + z * z)
            if not distance_m <= range_m or receiver == sender:
                continue
            if (
                (losses is not None and losses[receiver] < self._loss)
                or (self.cut_off and any((sender in group) is not (receiver in group) for group in self.cut_off))
                or (self.cut_links and (sender, receiver) in self.cut_links)
                or (self._share is not None and self._hidden(sender, receiver, distance_m))
            ):
                self._missed[receiver] += not aside
                continue
            self._arrived[receiver] += not aside
            self._put(receiver, now_s if delays_s is None else now_s + delays_s[receiver], frame)

    def _put(self, receiver: int, due_s: float, frame: bytes) -> None:
        queue = self._under_way.get(receiver)
        if queue is None:
            queue = self._under_way[receiver] = []
        self._count += 1
        if self._delay_s > 0.0:
            heapq.heappush(queue, (due_s, self._count, frame))
        else:
            queue.append((due_s, self._count, frame))  # times do not run back
        if len(queue) > QUEUE_LIMIT:
            heapq.heappop(queue) if self._delay_s > 0.0 else queue.pop(0)

    def _hidden(self, sender: int, receiver: int, distance_m: float) -> bool:
        """True if what stands between two radios, which are in range of each other, leaves too little of it."""
        pair = (sender, receiver) if sender < receiver else (receiver, sender)
        share = self._shares.get(pair)
        if share is None:
            assert self._share is not None
            share = self._shares[pair] = self._share(self._positions[sender], self._positions[receiver])
        if share == 1.0:
            return False
        range_m = min(self._ranges_m[sender], self._ranges_m[receiver])
        return distance_m > range_m * share

    def deliver(self, receiver: int, now_s: float) -> bytes:
        """One datagram of all the frames that have reached `receiver` by now, unmodified."""
        queue = self._under_way.get(receiver)
        if not queue:
            return b""
        arrived: list[bytes] = []
        if self._delay_s > 0.0:
            while queue and queue[0][0] <= now_s:
                arrived.append(heapq.heappop(queue)[2])
        else:
            for due_s, _, frame in queue:
                if due_s > now_s:
                    break
                arrived.append(frame)
            del queue[: len(arrived)]
        return b"".join(arrived)


def radio_of(mission: Mission, stand: Stand) -> Radio:
    """The air of a mission, with what its stand leaves of the ranges."""
    sim = mission.sim
    return Radio(
        range_m=mission.radio.transit_range_m,
        loss=sim.radio_loss,
        delay_s=sim.radio_delay_s,
        seed=sim.seed,
        share=range_share(sim, stand),
        bit_rate_kbps=mission.radio.bit_rate_kbps,
    )
