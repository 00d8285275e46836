"""Connections of a live map's server: so many in all and of one address, and those that only hold on make room."""

from __future__ import annotations

import asyncio
from typing import Any

from websockets.asyncio.server import ServerConnection

from mission.common.network.connections import Connections


def bounded(table: Connections[ServerConnection]) -> type[ServerConnection]:
    """Class of connections that `table` lets in; the others are closed at once, before a page or a viewer is made."""

    class Bounded(ServerConnection):
        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            """As the base."""
            peer: Any = transport.get_extra_info("peername")
            is_let_in, goes = table.admit(self, peer[0] if peer else "")
            super().connection_made(transport)
            if goes is not None:
                goes.transport.abort()
            if not is_let_in:
                self.transport.abort()

        def connection_lost(self, exc: Exception | None) -> None:
            """As the base."""
            table.remove(self)
            super().connection_lost(exc)

    return Bounded
