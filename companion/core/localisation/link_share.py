"""The share of a neighbour's beacons that arrives, and after what silence it counts as not heard any more.

Beacons are due once a period, and each bears its sender's clock: so two stamps tell how many were due in between, and
lost. A bit for each of the last WINDOW periods says which came, late ones too. By that share a silence is taken for one
only when losses alone would seldom make it so long: as many periods as are lost in a row with FALSE_SILENCE. To that
comes by how much beacons are late, one more than another. With a good radio all is as if nothing were measured.

A silence beyond SILENCE_MAX_S is no loss of beacons: the vehicle was out of range, cut off, or had no companion.
"""

from __future__ import annotations

import math
from typing import Final, final

WINDOW: Final = 60  # periods: 6 s at 10 Hz; at 40 % loss the share is known to 0.06
ALL: Final = (1 << WINDOW) - 1
FALSE_SILENCE: Final = 1e-6  # share of beacons after which losses alone make a silence: at 40 % loss 16 in a row
SILENCE_MAX_S: Final = 1.5  # whatever is lost: that long a silent vehicle's autopilot takes to notice, and to stand
ON_TIME: Final = 0.75  # of a period since the one before: earlier, it is one that was sent before its time
FORGETS: Final = 1.0 / 300.0  # of how unlike ages are, with each beacon, at either end: half in 10 s


def periods_of_silence(arrived: int) -> int:
    """Losses in a row by which a neighbour counts as silent, when `arrived` of WINDOW beacons came."""
    lost = 1.0 - arrived / WINDOW
    if lost <= 0.0 or arrived <= 0:
        return 1 if lost <= 0.0 else WINDOW
    return min(WINDOW, math.ceil(math.log(FALSE_SILENCE) / math.log(lost)))


_SILENCE: Final = tuple([periods_of_silence(arrived) for arrived in range(WINDOW + 1)])


@final
class LinkShare:
    """Of one neighbour; taken for whole until it is measured. `record` each of its beacons."""

    __slots__ = (
        "_arrived",
        "_at_s",
        "_latest_s",
        "_least_s",
        "_most_s",
        "_period_s",
        "_stale_s",
        "_stamp_s",
        "stale_s",
    )

    def __init__(self, period_s: float, stale_s: float) -> None:
        """`stale_s`: with a good radio."""
        self._period_s: Final = period_s
        self._stale_s: Final = stale_s
        self._most_s: Final = max(stale_s, SILENCE_MAX_S)
        self.stale_s = stale_s  # the silence after which it is not heard any more
        self._arrived = ALL  # bit k: the beacon of k periods before the newest
        self._stamp_s = -math.inf  # of the newest, by its sender's clock
        self._at_s = -math.inf  # when that arrived
        self._least_s, self._latest_s = math.inf, -math.inf  # ages of late

    @property
    def share(self) -> float:
        """The share of its beacons that arrives, 0..1."""
        return self._arrived.bit_count() / WINDOW

    def record(self, stamp_s: float, age_s: float, now_s: float) -> None:
        """A beacon, new or overtaken, that was made at `stamp_s` of its sender's clock, `age_s` ago."""
        behind = math.inf if now_s - self._at_s > self._most_s else (self._stamp_s - stamp_s) / self._period_s
        if abs(behind) >= WINDOW:  # after a silence, or a clock that began anew
            self._stamp_s, self._at_s = stamp_s, now_s
        elif behind > 0.0:
            self._arrived |= 1 << int(behind + 1.0 - ON_TIME)
        else:
            due = int(1.0 - ON_TIME - behind)
            if due > 0:
                self._arrived = ((self._arrived << due) | 1) & ALL
                self._stamp_s, self._at_s = stamp_s, now_s
        self._arrived &= ALL
        fade_s = FORGETS * max(0.0, self._latest_s - self._least_s) if self._latest_s > -math.inf else 0.0
        self._least_s, self._latest_s = min(age_s, self._least_s + fade_s), max(age_s, self._latest_s - fade_s)
        uneven_s = self._latest_s - self._least_s
        silence_s = _SILENCE[self._arrived.bit_count()] * self._period_s + uneven_s
        self.stale_s = max(self._stale_s, min(self._most_s, silence_s))
