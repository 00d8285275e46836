"""Leaders that others have given up, by what each of them has observed itself, and say so with their beacons.

What one says of another counts for nothing: it may lie. Of two, one is honest (F + 1, F = 1): so a leader that two
accuse is given up here, too. It costs it the lead and the course that it hands down, for a while, and nothing else;
none comes to lead by it. Accusations are not passed on: each is of a member that is heard here.
"""

from __future__ import annotations

from typing import Final, final

from companion.core.model.beacon import Beacon
from companion.core.swarm.trust.blocklist import BLOCKED_S

ACCUSERS: Final = 2  # F + 1


@final
class Accusations:
    """One vehicle's; bounded by the swarm's size."""

    __slots__ = ("_said",)

    def __init__(self) -> None:
        self._said: dict[int, tuple[int, float]] = {}  # by sender: whom its last beacon accuses, and when it came

    def receive_beacon(self, beacon: Beacon, now_s: float) -> None:
        """A member's beacon: whom it accuses, or nobody any more."""
        if beacon.accused:
            self._said[beacon.sender] = (beacon.accused, now_s)
        elif beacon.sender in self._said:
            del self._said[beacon.sender]

    def is_accused(self, vehicle: int, now_s: float) -> bool:
        """Enough of the others do."""
        return self.count_accusers(vehicle, now_s) >= ACCUSERS

    def count_accusers(self, vehicle: int, now_s: float) -> int:
        """The others that do, by their last beacons of the last BLOCKED_S."""
        accusers = 0
        for sender, (accused, at_s) in self._said.items():
            accusers += accused == vehicle and sender != vehicle and now_s - at_s <= BLOCKED_S
        return accusers
