"""The age of what a beacon says: delays measured both ways, as by NTP and two-way ranging. No two clocks need to agree.

A beacon bears its sender's clock when it was made. Received, it has taken its way by the difference of two clocks; what
its sender echoes of an own beacon (the stamp of that, and for how long it has had it) tells the way there by the same
difference, of the other sign. So half of both together is the way without the clocks. Of each way the least of WINDOW_S
counts, as what is late is late by chance: then the age of every beacon is known, of late ones too, as far as both ways
are alike at best. Two clocks that are each off by 200 ppm cost 6 ms (half of WINDOW_S), 12 ms where there is no delay.

Times are those of ticks, when beacons are made and taken in: to wait for a tick is part of an age. Where two vehicles
tick at different moments, this is not alike both ways: ages may be off by half a tick more.

What a neighbour says of clocks is used for its own beacons alone. Ages are never negative, and at most AGE_MAX_S.
"""

from __future__ import annotations

import math
from typing import Final, final

from companion.core.model.beacon import Beacon, BeaconEcho

UNMEASURED_S: Final = 0.05  # the least way of a neighbour that has echoed nothing yet: a tick
AGE_MAX_S: Final = 1.0  # what is older is of no use, and no neighbour flies on for longer in what is reckoned
WINDOW_S: Final = 30.0
SLOT_S: Final = 5.0  # of which the window is made: each keeps its least
RESTART_S: Final = 3.0  # a stamp that is off by more is of a clock that began anew
SILENT_S: Final = 0.5  # one whose stamps fall back has begun anew only after such a silence; else it is an old beacon
ROUND_MAX_S: Final = 3.0  # of a round trip that is believed; of an own stamp from before a restart few are
HOLD_MAX_S: Final = 10.0  # what arrived longer ago is not echoed: the two clocks have gone apart since
STAMP_MASK: Final = 0xFFFF  # the bits of a stamp that are echoed: 65 s of milliseconds


@final
class LeastDelay:
    """The least of one way's delays, clocks' difference included, over the last WINDOW_S: a slot, a number."""

    __slots__ = ("_slots", "least_s")

    def __init__(self) -> None:
        self._slots: list[tuple[int, float]] = []  # at most WINDOW_S / SLOT_S + 1
        self.least_s = math.inf  # infinite: none was measured in the window

    def add(self, delay_s: float, now_s: float) -> None:
        """One delay, measured now."""
        slot = int(now_s // SLOT_S)
        if not self._slots or self._slots[-1][0] < slot:
            self._slots.append((slot, delay_s))
        elif delay_s < self._slots[-1][1]:
            self._slots[-1] = (self._slots[-1][0], delay_s)
        self.expire(now_s)

    def expire(self, now_s: float) -> None:
        """Forget what is older than the window."""
        oldest = int((now_s - WINDOW_S) // SLOT_S)
        self._slots = [one for one in self._slots if one[0] > oldest]
        self.least_s = min([delay_s for _, delay_s in self._slots], default=math.inf)


@final
class _Link:
    """Measurements of one neighbour's beacons."""

    __slots__ = ("best_in_s", "best_ms", "best_s", "from_peer", "heard_s", "to_peer", "way_s")

    def __init__(self) -> None:
        self.from_peer = LeastDelay()  # delay and own clock less its own
        self.to_peer = LeastDelay()  # delay and its clock less the own
        self.way_s = UNMEASURED_S  # of the quickest beacon
        self.heard_s = -math.inf  # the last whose stamp went on
        # The quickest since it was last told of one: that is what is echoed.
        self.best_in_s = math.inf
        self.best_ms = 0  # its stamp
        self.best_s = -math.inf  # when it arrived, by the own clock


@final
class BeaconAges:
    """One vehicle's: `receive` every beacon of a member, `make_echo` for each own one. Ids are the mission's."""

    __slots__ = ("_links", "_me", "_next")

    def __init__(self, me: int) -> None:
        self._me: Final = me
        self._links: dict[int, _Link] = {}
        self._next = 0  # id from which the turn goes on

    def receive(self, said: Beacon, now_s: float) -> float:
        """The age of what this beacon says, seconds, 0..AGE_MAX_S; `now_s`: when it arrived."""
        link = self._links.get(said.sender)
        if link is None:
            link = self._links[said.sender] = _Link()
        stamp_s = said.time_ms / 1000.0
        delay_s = now_s - stamp_s
        off_s = delay_s - link.from_peer.least_s
        if abs(off_s) > RESTART_S and link.heard_s > -math.inf:
            if off_s > RESTART_S and now_s - link.heard_s <= SILENT_S:
                return AGE_MAX_S
            link = self._links[said.sender] = _Link()
        link.heard_s = now_s
        link.from_peer.add(delay_s, now_s)
        if said.echo is not None and said.echo.vehicle == self._me:
            self._take_echo(link, said.echo, stamp_s, now_s)
        link.to_peer.expire(now_s)
        if link.to_peer.least_s < math.inf:
            link.way_s = max(0.0, (link.from_peer.least_s + link.to_peer.least_s) / 2.0)
        if delay_s < link.best_in_s or now_s - link.best_s > HOLD_MAX_S:
            link.best_in_s, link.best_ms, link.best_s = delay_s, said.time_ms, now_s
        return min(AGE_MAX_S, max(0.0, delay_s - link.from_peer.least_s + link.way_s))

    def make_echo(self, now_s: float) -> BeaconEcho | None:
        """For the next own beacon: the quickest beacon of one neighbour since the last echo of it, each in turn."""
        ready = [
            k for k, link in self._links.items() if link.best_in_s < math.inf and now_s - link.best_s <= HOLD_MAX_S
        ]
        if not ready:
            return None
        chosen = min([k for k in ready if k >= self._next], default=min(ready))
        self._next = chosen + 1
        link = self._links[chosen]
        link.best_in_s = math.inf
        return BeaconEcho(chosen, link.best_ms & STAMP_MASK, now_s - link.best_s)

    @staticmethod
    def _take_echo(link: _Link, echo: BeaconEcho, stamp_s: float, now_s: float) -> None:
        """An echo of an own beacon, in one that was made at `stamp_s` of its clock."""
        since_s = ((int(now_s * 1000.0) - echo.time_ms) & STAMP_MASK) / 1000.0  # the own beacon was made
        if 0.0 <= since_s - echo.hold_s <= ROUND_MAX_S:
            link.to_peer.add(stamp_s - echo.hold_s - (now_s - since_s), now_s)
