"""Checks what comes, as often as its sender could have sent it: a flood of forged records costs a bounded time."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from companion.records.record import Record
from companion.records.signed.keys import RecordKeys
from companion.records.signed.messages import BaseVector

CHECKS_MAX: Final = 32  # signatures in the name of one sender that are checked in CHECKS_S: it sends 20 records at most
CHECKS_S: Final = 1.0
FORGED: Final = "forged"
NOT_CHECKED: Final = "of a flood"


class Intake:
    """Of one node. What it refuses is counted, and said once of each vehicle in whose name it was."""

    def __init__(self, keys: RecordKeys, dropped: dict[str, int], lines: deque[str]) -> None:
        """`dropped`, `lines`: of the exchange that this serves."""
        self._keys = keys
        self._dropped = dropped
        self._lines = lines
        self._checks: dict[int, tuple[float, int]] = {}  # by sender: since when, how many
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
        since_s, count = self._checks.get(sender, (-math.inf, 0))
        if now_s - since_s >= CHECKS_S:
            since_s, count = now_s, 0
        self._checks[sender] = (since_s, count + 1)
        if count >= CHECKS_MAX:
            self._dropped[NOT_CHECKED] += 1
        return count < CHECKS_MAX

    def _note_forged(self, line: str) -> None:
        self._dropped[FORGED] += 1
        self._report_once(line)

    def _report_once(self, line: str) -> None:
        if line not in self._told:  # of known vehicles alone
            self._told.add(line)
            self._lines.append(line)
