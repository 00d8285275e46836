"""HTTP and WebSocket for the viewers of one flight: the page at /, its stream at /live."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections import deque
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from mission.common.network.connections import Connections
from sim_bridge.judge.live import guests, wire
from sim_bridge.judge.live.admission import bounded
from sim_bridge.judge.live.viewer import Viewer

if TYPE_CHECKING:  # numpy, and what else it takes to draw, is loaded when somebody looks
    from sim_bridge.judge.live.feed import Feed

FORMAT: Final = "understory-live"
VERSION: Final = 1
VIEWERS_MAX: Final = 16
OF_ADDRESS_MAX: Final = 2 * VIEWERS_MAX  # connections: one too many is told so, and a page is fetched beside
ROWS_MAX: Final = 6000  # ten minutes at 10 Hz
PAIRS_MAX: Final = 200_000  # of vehicles, in all the rows that a snapshot looks back at: a second's work
ROWS_LEAST: Final = 20
ROWS_PENDING: Final = 64
EVENTS_MAX: Final = 1000
BUFFER_BYTES: Final = 1 << 17  # that wait in this process for a slow viewer, besides its newest rows
PING_S: Final = 20.0  # a viewer that does not answer for twice so long is let go
OPEN_S: Final = 5.0  # for a whole request, however it drips in, and its answer
LAST_WORD_S: Final = 2.0  # that viewers have to take the end of the flight
PAGE_PATH, STREAM_PATH = "/", "/live"
TRY_AGAIN_LATER: Final = 1013  # close code of RFC 6455's registry


class MapServer:
    """Server of a live map. What the flight reports comes by `end`; what viewers ask for goes back there."""

    def __init__(self, end: socket.socket) -> None:
        self._end = end
        self._port = 0
        self._begin: dict[str, Any] = {}
        self._feed: Feed | None = None
        self._viewers: dict[ServerConnection, Viewer] = {}
        self._rows: deque[bytes] = deque(maxlen=ROWS_MAX)
        self._pending: deque[bytes] = deque(maxlen=ROWS_PENDING)  # of them, those that are not drawn yet
        self._said: deque[dict[str, Any]] = deque(maxlen=EVENTS_MAX)
        self._faults: deque[dict[str, Any]] = deque(maxlen=EVENTS_MAX)
        self._newest: dict[str, Any] = {}  # of what only the last value counts of
        self._wake = asyncio.Event()
        self._over = asyncio.Event()
        self._connections = Connections[ServerConnection](of_address=OF_ADDRESS_MAX)

    async def run(self, listener: socket.socket) -> None:
        """Until the flight is over and its viewers have been told."""
        self._port = listener.getsockname()[1]
        loop = asyncio.get_running_loop()
        loop.add_reader(self._end, self._read_link)
        artist, over = asyncio.create_task(self._draw()), asyncio.create_task(self._over.wait())
        async with serve(
            self._meet,
            sock=listener,
            process_request=self._answer,
            create_connection=bounded(self._connections),
            open_timeout=OPEN_S,
            compression=None,  # costs more than it saves on this machine's own loopback
            max_size=guests.COMMAND_MAX_BYTES,
            max_queue=4,
            write_limit=BUFFER_BYTES,
            ping_interval=PING_S,
            ping_timeout=PING_S,
            close_timeout=LAST_WORD_S,
            server_header=None,
        ):
            await asyncio.wait({artist, over}, return_when=asyncio.FIRST_COMPLETED)
            if artist.done():  # it never ends by itself: its error ends this process, and the flight tells
                artist.result()
            deadline_s = loop.time() + LAST_WORD_S
            while any(viewer.busy for viewer in self._viewers.values()) and loop.time() < deadline_s:
                await asyncio.sleep(0.02)
            for connection in list(self._viewers):
                connection.transport.abort() if self._viewers[connection].busy else await connection.close()
        artist.cancel()

    # the flight

    def _read_link(self) -> None:
        try:
            for data in wire.received(self._end):
                self._store_datagram(data)
        except wire.GoneError:
            asyncio.get_running_loop().remove_reader(self._end)
            self._over.set()

    def _store_datagram(self, data: bytes) -> None:
        if data.startswith(b'{"row":'):  # the most; read where it is drawn
            self._rows.append(data)
            if self._viewers:
                self._pending.append(data)
                self._wake.set()
            return
        told = json.loads(data)
        if "begin" in told:
            self._begin = told["begin"]
            size = self._begin["size"]
            most = PAIRS_MAX // max(1, size * (size - 1) // 2)
            self._rows = deque(self._rows, maxlen=max(ROWS_LEAST, min(ROWS_MAX, most)))
            self._wake.set()
        elif "event" in told:
            self._said.append(told["event"])
            for viewer in self._viewers.values():
                viewer.event(told["event"])
        elif "fault" in told:
            self._faults.append(told["fault"])
        else:
            self._newest.update(told)
            for viewer in self._viewers.values():
                viewer.update_values(told)

    def _tell_flight(self, message: dict[str, Any]) -> None:
        with contextlib.suppress(wire.GoneError):
            wire.send(self._end, message)

    # viewers

    async def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """The page, a refusal, or None: a WebSocket may be opened."""
        self._connections.mark_asked(connection)
        host = request.headers.get_all("Host")
        if len(host) != 1 or not guests.is_ours(host[0], self._port):
            return connection.respond(HTTPStatus.FORBIDDEN, "This server answers to its address only.\n")
        path = request.path.partition("?")[0]
        if path == STREAM_PATH:
            origin = request.headers.get("Origin")
            if not guests.is_from_here(origin, host[0]):
                return connection.respond(HTTPStatus.FORBIDDEN, "Not from another page.\n")
            return None
        if path != PAGE_PATH:
            return connection.respond(HTTPStatus.NOT_FOUND, "There is one page here: /\n")
        body, policy = await asyncio.to_thread(self._page, host[0])
        headers = Headers(
            [
                ("Content-Type", "text/html; charset=utf-8"),
                ("Content-Length", str(len(body))),
                ("Content-Security-Policy", policy),
                ("X-Content-Type-Options", "nosniff"),
                ("Referrer-Policy", "no-referrer"),
                ("Cache-Control", "no-store"),
                ("Connection", "close"),
            ]
        )
        return Response(HTTPStatus.OK, "OK", headers, body)

    def _page(self, host: str) -> tuple[bytes, str]:
        """The page and its policy; of a flight that is over its replay, which shows more than what was streamed."""
        from sim_bridge.judge.page.html import POLICY, live_page, live_policy

        report = self._newest.get("over", {}).get("report")
        if report is not None:
            with contextlib.suppress(OSError):  # it has been moved: then what was streamed
                return Path(report).read_bytes(), f"{POLICY}; frame-ancestors 'none'"
        return live_page(self._begin.get("title", "")).encode(), live_policy(host)

    async def _meet(self, connection: ServerConnection) -> None:
        if len(self._viewers) >= VIEWERS_MAX:
            await connection.close(TRY_AGAIN_LATER, "too many viewers")
            return
        peer = connection.remote_address
        here = bool(peer) and guests.is_loopback(peer[0])
        viewer = self._viewers[connection] = Viewer(may_interfere=here)
        self._tell_flight({"viewers": len(self._viewers)})
        self._wake.set()
        sender = asyncio.create_task(_send(connection, viewer))
        try:
            async for data in connection:
                allowed = self._begin.get("controls", []) if viewer.may_interfere else []
                asked = guests.command(data, allowed)
                if asked is not None:
                    self._tell_flight(asked)
        except ConnectionClosed:
            pass
        finally:
            sender.cancel()
            del self._viewers[connection]
            self._tell_flight({"viewers": len(self._viewers)})

    # drawing

    async def _draw(self) -> None:
        """One thing after the other, in a thread beside this one, which goes on reading and sending."""
        current = False  # the feed has seen every row up to now
        while True:
            await self._wake.wait()
            self._wake.clear()
            if not self._viewers or not self._begin:
                self._pending.clear()
                current = False
                continue
            if self._feed is None:
                self._feed = await asyncio.to_thread(_feed, self._begin)
            if not current:
                self._pending.clear()
                await asyncio.to_thread(self._feed.catch_up, list(self._rows))
                current = True
            await self._draw_rows(self._feed)
            if any(not viewer.begun for viewer in self._viewers.values()):
                await self._begin_viewers(self._feed)

    async def _draw_rows(self, feed: Feed) -> None:
        while self._pending:
            row = self._pending.popleft()
            drawn, happened = await asyncio.to_thread(feed.drawn, row, list(self._faults))
            for viewer in self._viewers.values():
                viewer.row(drawn)
                for event in happened:
                    viewer.event(event)

    async def _begin_viewers(self, feed: Feed) -> None:
        """Sends a snapshot. What comes while it is made waits in `pending`, which is drawn next."""
        new = [viewer for viewer in self._viewers.values() if not viewer.begun]
        rows, said, faults = list(self._rows), list(self._said), list(self._faults)
        self._pending.clear()
        await asyncio.to_thread(feed.catch_up, rows)
        replay = await asyncio.to_thread(feed.snapshot, rows, said, faults)
        for viewer in new:
            controls = self._begin["controls"] if viewer.may_interfere else []
            first = {"format": FORMAT, "version": VERSION, "replay": replay, "controls": controls}
            viewer.begin({**first, **self._newest})


def _feed(begin: dict[str, Any]) -> Feed:
    from sim_bridge.judge.live.feed import Feed

    return Feed(Path(begin["mission"]), begin["title"], Path(begin["stems_in"]))


async def _send(connection: ServerConnection, viewer: Viewer) -> None:
    with contextlib.suppress(ConnectionClosed):
        while True:
            await connection.send(await viewer.message())


def serve_map(listener: socket.socket, end: socket.socket) -> None:
    """Until the flight is over."""
    asyncio.run(MapServer(end).run(listener))
