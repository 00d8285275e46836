"""Live maps for tests: a map in this process that a viewer looks at, and rows to feed it with."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from mission.document.load import dump_mission
from sim_bridge.judge.live import wire
from sim_bridge.judge.live.server import MapServer
from sim_bridge.judge.recording import Recorder
from tests.flights import short_mission
from tests.unit.judge.tick_kit import a_tick

CONTROLS = ["pause", "kill"]


class Served:
    """A map, and the flight's end of it."""

    def __init__(self, end: socket.socket, listener: socket.socket) -> None:
        self.end = end
        self.port: int = listener.getsockname()[1]
        self.host = f"127.0.0.1:{self.port}"
        self.stream = f"ws://{self.host}/live"
        self._recorder = Recorder()

    def begin(self, folder: Path, n: int = 3) -> None:
        (folder / "mission.toml").write_text(dump_mission(short_mission(swarm={"size": n})), encoding="utf-8")
        files = {"mission": str(folder / "mission.toml"), "stems_in": str(folder)}
        wire.send(self.end, {"begin": {**files, "title": "short", "size": n, "controls": CONTROLS}})

    def row(self, time_s: float, *, n: int = 3, **changes: Any) -> bool:
        """False: there was no room for it."""
        self._recorder.add(a_tick(time_s, n=n, **changes))
        values: list[Any] = [None] * n
        return wire.send(self.end, {"row": self._recorder.last, "yaw_deg": [90.0] * n, "beacon_age_s": values})

    async def asked(self) -> list[dict[str, Any]]:
        """The next messages to the flight."""
        while True:
            found = [json.loads(data) for data in wire.received(self.end)]
            if found:
                return found
            await asyncio.sleep(0.001)


@asynccontextmanager
async def served() -> AsyncIterator[Served]:
    """A map on a free port; at the end the flight is over, and it must end by itself."""
    ours, theirs = wire.pair()
    with ours, theirs, socket.create_server(("127.0.0.1", 0)) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)  # of its connections: a slow viewer is seen soon
        task = asyncio.create_task(MapServer(theirs).run(listener))
        try:
            yield Served(ours, listener)
        finally:
            ours.close()
            await asyncio.wait_for(task, 30.0)
