"""The addresses of this computer, for messages that name where it is reached. Nothing is sent to learn them."""

from __future__ import annotations

import array
import ipaddress
import socket
import struct
import sys
from collections.abc import Sequence
from typing import Final

UNKNOWN: Final = "ADDRESS"  # stands in a URL where this computer's own address belongs and is not known
_SIOCGIFCONF: Final = 0x8912  # netdevice(7)
_INTERFACES_MAX: Final = 128
_IFREQ_BYTES: Final = 40 if struct.calcsize("P") == 8 else 32


def own_ipv4() -> list[str]:
    """Of its interfaces but loopback, IPv4, in the system's order; none where the system does not say."""
    if sys.platform != "linux":
        return []
    import fcntl

    buffer = array.array("B", bytes(_INTERFACES_MAX * _IFREQ_BYTES))
    asked = struct.pack("iP", len(buffer), buffer.buffer_info()[0])
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unused:
            filled: int = struct.unpack("iP", fcntl.ioctl(unused, _SIOCGIFCONF, asked))[0]
    except OSError:
        return []
    data = buffer.tobytes()
    found = [socket.inet_ntoa(data[at + 20 : at + 24]) for at in range(0, filled, _IFREQ_BYTES)]
    return [address for address in dict.fromkeys(found) if not ipaddress.ip_address(address).is_loopback]


def lines(word: str, urls: Sequence[str]) -> list[str]:
    """A line for each of `urls`, which begins with `word`, and one that says what to do with UNKNOWN."""
    hint = [f"{UNKNOWN}: put there this computer's address in the other one's network"]
    return [f"{word} {url}" for url in urls] + (hint if any(f"//{UNKNOWN}:" in url for url in urls) else [])


def reached_at(host: str) -> list[str]:
    """Hosts by which others reach what is bound to `host`: there, or, of 0.0.0.0 and ::, at each own address.

    [UNKNOWN] where there is none to name.
    """
    return (own_ipv4() or [UNKNOWN]) if ipaddress.ip_address(host).is_unspecified else [host]
