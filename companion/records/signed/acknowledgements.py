"""The base station's signed word on its way to those out of its range: passed on unchanged, to who tells of less."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from companion.records.peers import Peers
from companion.records.record import LogKey
from companion.records.signed.messages import BaseVector

AGAIN_S: Final = 3.0  # one that was on the air is not sent again for so long: a vector tells each second who has it


class Acknowledgements:
    """Of one vehicle: of each log the message that freed most of it, checked before."""

    def __init__(self) -> None:
        self._words: dict[LogKey, bytes] = {}
        self._aired_s: dict[bytes, float] = {}  # of those that are kept

    def __contains__(self, key: LogKey) -> bool:
        return key in self._words

    def has(self, base: BaseVector) -> bool:
        """This very message."""
        return base.payload in self._words.values()

    def store_word(self, key: LogKey, base: BaseVector) -> None:
        """The newest of this log."""
        self._words[key] = base.payload

    def note_aired(self, base: BaseVector, now_s: float) -> None:
        """It was on the air, from whomever."""
        kept = set(self._words.values())
        self._aired_s = {payload: at_s for payload, at_s in self._aired_s.items() if payload in kept}
        if base.payload in kept:
            self._aired_s[base.payload] = now_s

    def clear(self) -> None:
        """They are of another file."""
        self._words.clear()

    def take_due(self, peers: Peers, acked: Mapping[LogKey, int], now_s: float) -> list[bytes]:
        """Payloads to send now."""
        due: dict[bytes, None] = {}
        for key, payload in self._words.items():
            is_aired = now_s - self._aired_s.get(payload, now_s - AGAIN_S) < AGAIN_S
            if not is_aired and peers.lacks_acknowledgement(key, acked[key], now_s):
                due[payload] = None
        self._aired_s.update(dict.fromkeys(due, now_s))
        return list(due)
