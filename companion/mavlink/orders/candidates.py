"""Orders that wait for their Ed25519 check, 0.14 ms each: a flood of forged ones keeps no genuine one out.

An order is sent again and again, byte for byte the same, by the operator and by all that have it. A forger who has no
key of the swarm does not get past the MAC of the link, and one who has spends the checks on orders that are each
looked at once. So those go first whose frame bore a MAC that holds, then those that came in most ticks.
"""

from __future__ import annotations

from typing import Final

SLOTS: Final = 512  # waiting; half of what a flood of 20,000 a second brings in a tick
BAD_MAX: Final = 1024  # that were checked and are forged: the same again costs nothing


class _Slot:
    """One payload that waits."""

    __slots__ = ("count", "is_proven", "payload", "tick")

    def __init__(self, payload: bytes, tick: int, *, is_proven: bool) -> None:
        self.payload = payload
        self.is_proven = is_proven  # a frame with it bore the MAC of one of the swarm
        self.count = 1  # ticks in which it came, less what other newcomers have taken
        self.tick = tick


class Candidates:
    """Payloads that wait for their check. Bounded; `take_likeliest` once a tick."""

    def __init__(self, seed: int) -> None:
        """`seed`: whatever a forger does not know."""
        self._slots: list[_Slot] = []
        self._by_payload: dict[bytes, _Slot] = {}
        self._bad: dict[bytes, None] = {}
        self._state = seed & 0x7FFFFFFF
        self._tick = 0
        self.dropped = 0

    def is_bad(self, payload: bytes) -> bool:
        """It was checked, and is forged."""
        return payload in self._bad

    def add_bad(self, payload: bytes) -> None:
        """The check has failed."""
        if len(self._bad) >= BAD_MAX:
            del self._bad[next(iter(self._bad))]
        self._bad[payload] = None

    def offer(self, payload: bytes, *, is_proven: bool) -> None:
        """Adds one that has come. Where all slots are taken it takes that of a rarer one, found by chance."""
        slot = self._by_payload.get(payload)
        if slot is not None:
            slot.is_proven |= is_proven
            slot.count += slot.tick != self._tick
            slot.tick = self._tick
            return
        new = _Slot(payload, self._tick, is_proven=is_proven)
        if len(self._slots) < SLOTS:
            self._slots.append(new)
            self._by_payload[payload] = new
            return
        self.dropped += 1
        self._state = (self._state * 1103515245 + 12345) & 0x7FFFFFFF
        at = (self._state >> 8) % SLOTS
        there = self._slots[at]
        there.count -= 1
        if is_proven > there.is_proven or (is_proven is there.is_proven and there.count <= 0):
            del self._by_payload[there.payload]
            self._slots[at] = new
            self._by_payload[payload] = new

    def take_likeliest(self, most: int) -> list[bytes]:
        """Takes up to so many to check now, the likeliest first."""
        self._tick += 1
        slots = self._slots
        if not slots:
            return []
        if len(slots) > most:
            slots.sort(key=lambda slot: (not slot.is_proven, -slot.count, slot.tick))
        taken, self._slots = slots[:most], slots[most:]
        for slot in taken:
            del self._by_payload[slot.payload]
        return [slot.payload for slot in taken]
