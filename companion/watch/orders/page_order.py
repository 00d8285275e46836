"""An order as the page asks for it: JSON in, with every field checked, and the text that its MAC is of."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any, Final

from companion.mavlink.orders.order import OrderKind

BODY_MAX_BYTES: Final = 4096  # 250 vehicles that a START goes without are 1 kB
_HEX: Final = re.compile(r"[0-9a-f]{16,64}")
_FIELDS: Final = {"kind", "hand_back", "without", "nonce", "mac"}


@dataclass(frozen=True, slots=True)
class PageOrder:
    """`hand_back`, `without`: of a START: the vehicle that is handed back, or 0; and those that the page named as not
    ready, which the operator has read."""

    kind: OrderKind
    hand_back: int
    without: tuple[int, ...]
    nonce: str
    mac: str

    @property
    def text(self) -> str:
        """All of it but the MAC, for the MAC; the page writes the same (web/watch/orders/ordertext.js)."""
        without = ",".join(map(str, self.without))
        return f"understory order 1\n{self.nonce}\n{self.kind.name}\n{self.hand_back}\n{without}"


def read_page_order(body: bytes, size: int) -> PageOrder:
    """Of a mission with `size` vehicles. ValueError in words, which name the field."""
    try:
        said: Any = json.loads(body)
    except (ValueError, RecursionError):
        raise ValueError("an order must be JSON") from None
    if not isinstance(said, dict) or said.keys() != _FIELDS:
        raise ValueError(f"an order must have {', '.join(sorted(_FIELDS))}")
    if said["kind"] not in list(OrderKind.__members__):  # a list is compared with whatever it is
        raise ValueError(f"kind: must be one of {', '.join(OrderKind.__members__)}")
    kind, hand_back, without = OrderKind[said["kind"]], said["hand_back"], said["without"]
    is_start = kind is OrderKind.START
    if not _is_vehicle(hand_back, size * is_start, least=0):
        raise ValueError(f"hand_back: must be 0, or of a START a vehicle, 1 to {size}")
    if not isinstance(without, list) or not all(_is_vehicle(k, size * is_start) for k in without):
        raise ValueError(f"without: must be a list, empty, or of a START vehicles, 1 to {size}")
    for name in ("nonce", "mac"):
        if not isinstance(said[name], str) or not _HEX.fullmatch(said[name]):
            raise ValueError(f"{name}: must be 16 to 64 digits, hexadecimal")
    return PageOrder(kind, hand_back, tuple(without), said["nonce"], said["mac"])


def _is_vehicle(value: object, most: int, *, least: int = 1) -> bool:
    return type(value) is int and least <= value <= most  # True is no vehicle
