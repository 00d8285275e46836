"""The base station's signed word on its way to those out of its range: passed on unchanged, to who tells of less."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Final

from companion.records.peers import Peers
from companion.records.record import LogKey
from companion.records.signed.messages import BaseVector

LATE_S: Final = 4.0  # who knows less than was known here so long ago does not hear the base station itself
GENUINE_MAX: Final = 64  # messages of the base station: of ten seconds, and more
AGAIN_S: Final = 3.0  # and what is sent to it comes at most so often


class Acknowledgements:
    """Of one vehicle: of each log the message that freed most of it, checked before."""

    def __init__(self) -> None:
        self._words: dict[LogKey, bytes] = {}
        self._genuine: dict[bytes, None] = {}  # the last that were checked
        self._passed_on_s: dict[LogKey, float] = {}  # by a vehicle, this or another
        self._acked: dict[LogKey, deque[tuple[float, int]]] = {}  # of the last LATE_S: when, up to which number

    def __contains__(self, key: LogKey) -> bool:
        return key in self._words

    def store_word(self, key: LogKey, base: BaseVector) -> None:
        """The newest of this log."""
        self._words[key] = base.payload

    def note_genuine(self, base: BaseVector) -> None:
        """The base station has told this."""
        self._genuine[base.payload] = None
        if len(self._genuine) > GENUINE_MAX:
            del self._genuine[next(iter(self._genuine))]

    def note_passed_on(self, base: BaseVector, now_s: float) -> None:
        """A vehicle has sent this: no need to send of the same logs now, if it is known to be genuine."""
        if base.payload in self._genuine:
            self._passed_on_s.update((entry.key, now_s) for entry in base.vector.entries if entry.key in self._words)

    def clear(self) -> None:
        """They are of another file."""
        self._words.clear()
        self._acked.clear()

    def take_due(self, peers: Peers, acked: Mapping[LogKey, int], now_s: float) -> list[bytes]:
        """Payloads to send now; to be asked once a second."""
        due: dict[bytes, None] = {}
        for key, payload in self._words.items():
            known = self._known_before(key, acked[key], now_s)
            is_passed_on = now_s - self._passed_on_s.get(key, now_s - AGAIN_S) < AGAIN_S
            if not is_passed_on and peers.lacks_acknowledgement(key, known, now_s):
                due[payload] = None
        self._passed_on_s.update((key, now_s) for key, payload in self._words.items() if payload in due)
        return list(due)

    def _known_before(self, key: LogKey, acked: int, now_s: float) -> int:
        """Number up to which this vehicle knew LATE_S ago that all is at the base station."""
        before = self._acked.setdefault(key, deque())
        before.append((now_s, acked))
        while len(before) > 1 and now_s - before[1][0] >= LATE_S:
            before.popleft()
        at_s, number = before[0]
        return number if now_s - at_s >= LATE_S else 0
