"""The key of one start of the server, by which the page proves its orders, and the nonces that make each count once.

The page has the key from the fragment of the address, which no browser sends: who reads the network sees nonces and
MACs, and can make no order of them. Times are a local clock's, s. Any thread may ask.
"""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Callable
from enum import Enum
from typing import Final

FRAGMENT: Final = "orders="
KEY_BYTES: Final = 16  # 22 letters in the address
NONCE_BYTES: Final = 12
NONCE_EVERY_S: Final = 0.25  # with every picture at most: asking for more makes no more
NONCE_S: Final = 10.0  # that one counts: a poor mesh, and a page that tries again
NONCES_MAX: Final = 64  # 40 in that time, and one for each order
CHECK: Final = "understory order 1 check"


class Nonce(Enum):
    """The state of one."""

    FRESH = "fresh"
    USED = "used"
    OLD = "old"  # or never issued


class OrderKey:
    """Another one at each start."""

    def __init__(self, draw: Callable[[int], bytes] = secrets.token_bytes) -> None:
        """`draw`: so many random bytes."""
        self._draw = draw
        self._key = draw(KEY_BYTES).hex()
        self._issued: dict[str, tuple[float, bool]] = {}  # since when, and whether it was used; the oldest first
        self._newest = ""
        self._lock = threading.Lock()

    @property
    def fragment(self) -> str:
        """For the address, behind `#`. A secret."""
        return f"{FRAGMENT}{self._key}"

    @property
    def check(self) -> str:
        """By which a page sees whether the key that it has is this one."""
        return self.mac_of(CHECK)

    def mac_of(self, text: str) -> str:
        """HMAC-SHA-256, hexadecimal."""
        return hmac.digest(self._key.encode(), text.encode(), "sha256").hex()

    def proves(self, text: str, mac: str) -> bool:
        """The MAC is of this text, by this key. In constant time."""
        return hmac.compare_digest(self.mac_of(text), mac)

    def nonce(self, now_s: float) -> str:
        """The newest, for whoever asks; it is not used yet."""
        with self._lock:
            since_s, used = self._issued.get(self._newest, (float("-inf"), True))
            if used or now_s - since_s >= NONCE_EVERY_S:
                self._newest = self._draw(NONCE_BYTES).hex()
                self._issued[self._newest] = (now_s, False)
                for nonce in [k for k, (at_s, _) in self._issued.items() if now_s - at_s >= NONCE_S]:
                    del self._issued[nonce]
                while len(self._issued) > NONCES_MAX:
                    del self._issued[next(iter(self._issued))]
            return self._newest

    def use_nonce(self, nonce: str, now_s: float) -> Nonce:
        """Its state until now: it counts once. Only for an order that is proven: nobody else uses any up."""
        with self._lock:
            since_s, used = self._issued.get(nonce, (float("-inf"), False))
            if now_s - since_s >= NONCE_S:
                return Nonce.OLD
            self._issued[nonce] = (since_s, True)
            return Nonce.USED if used else Nonce.FRESH
