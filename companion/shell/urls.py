"""URL of a link, in MAVSDK's form: `udpin://HOST:PORT`, `udpout://HOST:PORT`, `serial:///dev/ttyX:BAUD`.

`udpbcast://BROADCAST:PORT` is this project's own addition, for a mesh on which everybody hears everybody.
"""

from __future__ import annotations

import re
import socket
from collections.abc import Set
from dataclasses import dataclass
from enum import StrEnum

from mission.common.problems import printable

PORT_MAX = 65535
BAUD_MIN, BAUD_MAX = 1_200, 12_000_000  # from slow telemetry radios to the fastest USB adapters
_URL = re.compile(r"([a-z]+)://(.*):([0-9]{1,9})")
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,252}[A-Za-z0-9])?")


class Scheme(StrEnum):
    """Transport of a link: its URL's scheme."""

    UDP_IN = "udpin"
    UDP_OUT = "udpout"
    UDP_BROADCAST = "udpbcast"
    SERIAL = "serial"


FORMS = {
    Scheme.UDP_IN: "udpin://HOST:PORT (wait there)",
    Scheme.UDP_OUT: "udpout://HOST:PORT (send there)",
    Scheme.UDP_BROADCAST: "udpbcast://BROADCAST:PORT (send to all there, hear all)",
    Scheme.SERIAL: "serial:///dev/ttyX:BAUD",
}
AUTOPILOT_SCHEMES = frozenset({Scheme.UDP_IN, Scheme.UDP_OUT, Scheme.SERIAL})
HEARING_SCHEMES = frozenset({Scheme.UDP_IN, Scheme.UDP_BROADCAST})  # those that need not send to be heard
PEERS_SCHEMES = frozenset({Scheme.UDP_IN, Scheme.UDP_OUT, Scheme.UDP_BROADCAST})


class UrlError(ValueError):
    """The message names the value and what is allowed."""


@dataclass(frozen=True, slots=True)
class Url:
    """`place`: a host's name or IPv4 address, or a device's path. `number`: a UDP port, or baud."""

    scheme: Scheme
    place: str
    number: int

    def __str__(self) -> str:
        return f"{self.scheme}://{self.place}:{self.number}"


def parse_url(text: str, allowed: Set[Scheme]) -> Url:
    """`text` as one of the `allowed` schemes; UrlError."""

    def refused(why: str) -> UrlError:
        forms = ", ".join(form for scheme, form in FORMS.items() if scheme in allowed)
        return UrlError(f"{printable(text)!r}: {why}; allowed: {forms}")

    match = _URL.fullmatch(text)
    if match is None:
        raise refused("not of the form SCHEME://PLACE:NUMBER")
    name, place, number = match[1], match[2], int(match[3])
    if name not in allowed:
        raise refused(f"{name!r} is not for this link")
    scheme = Scheme(name)
    if scheme is Scheme.SERIAL:
        if not place.startswith("/") or not place.isprintable():
            raise refused("a device's path starts with /, so there are three of them")
        if not BAUD_MIN <= number <= BAUD_MAX:
            raise refused(f"the baud rate must be {BAUD_MIN}..{BAUD_MAX}")
        return Url(scheme, place, number)
    if not _HOST.fullmatch(place):
        raise refused("a host's name or IPv4 address must stand before the port")
    if not 1 <= number <= PORT_MAX:
        raise refused(f"the port must be 1..{PORT_MAX}")
    if scheme is Scheme.UDP_BROADCAST and not is_ipv4(place):
        raise refused("the broadcast address must be IPv4, as 192.168.1.255")
    if scheme is not Scheme.UDP_IN and place == "0.0.0.0":
        raise refused("0.0.0.0 is no address to send to")
    return Url(scheme, place, number)


def is_ipv4(text: str) -> bool:
    """Four numbers with dots."""
    try:
        socket.inet_pton(socket.AF_INET, text)
    except OSError:
        return False
    return True
