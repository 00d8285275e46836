"""Schedule of message streams: intervals in whole microseconds, so that nothing drifts. Any personality's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

INTERVAL_MIN_US: Final = 1_000  # 1 kHz; no autopilot streams faster
NEVER_US: Final = 1 << 62


class _Stream:
    __slots__ = ("due_us", "interval_us", "order")

    def __init__(self, order: int, interval_us: int, due_us: int) -> None:
        self.order = order
        self.interval_us = interval_us
        self.due_us = due_us


class StreamTable:
    """The streams of one link.

    `order`: every message id that can be streamed, in the order in which those due together go out.
    `rates_hz`: message id -> rate by default. `first_us`: message id -> when it starts, where not at boot.
    """

    def __init__(
        self, order: Iterable[int], rates_hz: Mapping[int, float], first_us: Mapping[int, int] | None = None
    ) -> None:
        self._order = {message_id: index for index, message_id in enumerate(order)}
        self._defaults_us = {message_id: round(1e6 / hz) for message_id, hz in rates_hz.items()}
        self._first_us = dict(first_us or {})
        self._active: dict[int, _Stream] = {}
        self._next_us = 0
        for message_id, interval_us in self._defaults_us.items():
            self._start(message_id, interval_us, self._first_us.get(message_id, 0))

    def interval_us(self, message_id: int) -> int:
        """Microseconds between two; -1: not streamed; 0: cannot be (as MESSAGE_INTERVAL has it)."""
        if message_id not in self._order:
            return 0
        stream = self._active.get(message_id)
        return stream.interval_us if stream else -1

    def set_interval_us(self, message_id: int, interval_us: int, now_us: int) -> bool:
        """As SET_MESSAGE_INTERVAL: -1 stops, 0 is the default. False: cannot be streamed."""
        if message_id not in self._order:
            return False
        if interval_us == 0:
            interval_us = self._defaults_us.get(message_id, -1)
        if interval_us < 0:
            self._active.pop(message_id, None)
        else:
            first_us = max(now_us, self._first_us.get(message_id, 0))
            self._start(message_id, max(interval_us, INTERVAL_MIN_US), first_us)
        return True

    def due(self, now_us: int) -> list[int]:
        """Message ids due at `now_us`, each at most once; their next times stay on their own grid."""
        if now_us < self._next_us:
            return []
        ready: list[tuple[int, int]] = []
        next_us = NEVER_US
        for message_id, stream in self._active.items():
            late_us = now_us - stream.due_us
            if late_us >= 0:
                ready.append((stream.order, message_id))
                stream.due_us += stream.interval_us * (late_us // stream.interval_us + 1)
            next_us = min(next_us, stream.due_us)
        self._next_us = next_us
        ready.sort()
        return [message_id for _, message_id in ready]

    def _start(self, message_id: int, interval_us: int, first_us: int) -> None:
        self._active[message_id] = _Stream(self._order[message_id], interval_us, first_us)
        self._next_us = min(self._next_us, first_us)


def microseconds(seconds: float) -> int:
    """Whole microseconds."""
    return round(seconds * 1e6)
