"""Checks what comes, as often as its sender could have sent it: a flood of forged records costs a bounded time."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.records.record import Record
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import BaseVector

CHECKS_HZ: Final = 64.0  # signatures in the name of one sender that are checked: it sends 20 records a second at most,
ALL_CHECKS_HZ: Final = 400.0  # and in all names: 5 % of a core
BURST_S: Final = 0.25  # for which they are saved
ALL: Final = 0  # no sender's id
FORGED: Final = "forged"
NOT_CHECKED: Final = "of a flood"


class Intake:
    """Of one node. What it refuses is counted, and said once of each vehicle in whose name it was."""

    def __init__(self, keys: RecordKeys, dropped: dict[str, int], lines: deque[str]) -> None:
        """`dropped`, `lines`: of the exchange that this serves."""
        self._keys = keys
        self._dropped = dropped
        self._lines = lines
        self._checks: dict[int, tuple[float, float]] = {}  # by sender: when, and how many could be checked then
        self._told: set[str] = set()
        dropped.update({FORGED: 0, NOT_CHECKED: 0})

    def knows(self, vehicle_id: int) -> bool:
        """There is a key of this vehicle: it is of the fleet, and not revoked."""
        return vehicle_id in self._keys.verifiers

    def proves(self, record: Record, sender: int, now_s: float) -> bool:
        """Its writer has made this record."""
        if not self._may_check(sender, now_s):
            return False
        if self._keys.proves(record):
            return True
        self._note_forged(f"records: forged as vehicle {record.vehicle_id}'s: refused")
        return False

    def proves_base(self, base: BaseVector, sender: int, now_s: float) -> bool:
        """The base station has told this."""
        if not self._may_check(sender, now_s):
            return False
        if self._keys.proves_base(base.signed, base.signature):
            return True
        self._note_forged("records: forged as the base's word: refused")
        return False

    def note_twice(self, record: Record) -> None:
        """Its writer has given one number to two."""
        self._report_once(f"records: vehicle {record.vehicle_id} gave a number twice")

    def _may_check(self, sender: int, now_s: float) -> bool:
        """There is time for it. A flood in one name leaves as many of that name as it is more than CHECKS_HZ."""
        kept = {}
        for who, rate_hz in ((sender, CHECKS_HZ), (ALL, ALL_CHECKS_HZ)):
            at_s, left = self._checks.get(who, (-math.inf, 0.0))
            kept[who] = (now_s, min(rate_hz * BURST_S, left + rate_hz * max(0.0, now_s - at_s)))
        may = all(left >= 1.0 for _, left in kept.values())
        if not may:
            self._dropped[NOT_CHECKED] += 1
        self._checks.update({who: (at_s, left - may) for who, (at_s, left) in kept.items()})
        return may

    def _note_forged(self, line: str) -> None:
        self._dropped[FORGED] += 1
        self._report_once(line)

    def _report_once(self, line: str) -> None:
        if line not in self._told:  # of known vehicles alone
            self._told.add(line)
            self._lines.append(line)
