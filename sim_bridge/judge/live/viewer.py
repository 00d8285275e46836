"""Queue of one viewer of a map: the newest rows, and what else it must know. It may be as slow as it likes."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Mapping
from typing import Any, Final

ROWS_WAITING: Final = 32  # three seconds; a viewer that is slower misses rows
EVENTS_WAITING: Final = 1000


class Viewer:
    """The next message to one viewer."""

    def __init__(self, *, may_interfere: bool) -> None:
        self.may_interfere = may_interfere
        self.begun = False  # it has had its first message, or will now
        self.busy = False  # a message is on its way, or will be
        self._rows: deque[str] = deque(maxlen=ROWS_WAITING)
        self._events: deque[str] = deque(maxlen=EVENTS_WAITING)
        self._newest: dict[str, str] = {}  # of what only the last value counts of
        self._wake = asyncio.Event()

    def begin(self, first: Mapping[str, Any]) -> None:
        """With its first message."""
        self.begun = True
        self.update_values(first)

    def row(self, row: str) -> None:
        """A row, in JSON: it is the same for all."""
        if self.begun:
            self._rows.append(row)
            self._wait_no_more()

    def event(self, event: Mapping[str, Any]) -> None:
        """Something happened; a first message holds what happened before it."""
        if self.begun:
            self._events.append(_json(event))
            self._wait_no_more()

    def update_values(self, values: Mapping[str, Any]) -> None:
        """Updates these values; a first message holds what they are then."""
        if self.begun:
            self._newest.update((key, _json(value)) for key, value in values.items())
            self._wait_no_more()

    async def message(self) -> str:
        """The next one, as soon as there is something to tell."""
        self.busy = self._wake.is_set()
        await self._wake.wait()
        self._wake.clear()
        due = self._newest
        if self._rows:
            due["rows"] = f"[{','.join(self._rows)}]"
        if self._events:
            due["events"] = f"[{','.join(self._events)}]"
        self._rows.clear()
        self._events.clear()
        self._newest = {}
        return "{" + ",".join(f'"{key}":{value}' for key, value in due.items()) + "}"

    def _wait_no_more(self) -> None:
        self.busy = True
        self._wake.set()


def _json(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))
