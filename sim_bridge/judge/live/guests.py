"""Access control of viewers, to look or to interfere: Host and Origin of a request, and what one may ask for."""

from __future__ import annotations

import ipaddress
import json
from typing import Any, Final

COMMAND_MAX_BYTES: Final = 1024


def is_ours(host: str | None, port: int) -> bool:
    """True if a request's Host names this server as no foreign page can: "localhost" or an address, and the port.

    A page elsewhere whose name was made to lead here (DNS rebinding) sends that name.
    """
    name, _, number = (host or "").rpartition(":")
    if number != str(port):
        return False
    if name == "localhost":
        return True
    try:
        ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True


def is_from_here(origin: str | None, host: str) -> bool:
    """True if who opens a WebSocket is our own page, or no page: programs send no Origin."""
    return origin is None or origin == f"http://{host}"


def is_loopback(address: str) -> bool:
    """True if a peer's address is this machine's own."""
    try:
        peer = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return False
    return (getattr(peer, "ipv4_mapped", None) or peer).is_loopback


def command(data: str | bytes, allowed: list[str]) -> dict[str, Any] | None:
    """Request of a viewer, if it is one of the `allowed`, else None: nothing that is sent raises."""
    if len(data) > COMMAND_MAX_BYTES:
        return None
    try:
        asked = json.loads(data)
    except (ValueError, RecursionError):
        return None
    return asked if isinstance(asked, dict) and asked.get("do") in allowed else None
