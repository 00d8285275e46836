"""Address of `companion watch`, on its command line."""

from __future__ import annotations

import socket
from typing import Final

from mission.common.problems import printable

PORT: Final = 8650


def address_of(text: str) -> tuple[str, int]:
    """ADDRESS or ADDRESS:PORT, IPv4 or localhost. ValueError in words."""
    host, colon, number = text.partition(":")
    if host == "localhost":
        host = "127.0.0.1"
    try:
        socket.inet_pton(socket.AF_INET, host)
    except OSError:
        raise ValueError(
            f"{printable(text)!r}: must be an IPv4 address of this computer or localhost, "
            f"as 192.168.4.10 or 192.168.4.10:{PORT}"
        ) from None
    if not colon:
        return host, PORT
    if not (number.isascii() and number.isdecimal() and len(number) <= 5 and int(number) < 1 << 16):
        raise ValueError(f"{printable(text)!r}: the port must be 0 (a free one) to 65535")
    return host, int(number)
