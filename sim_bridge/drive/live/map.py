"""The flight's end of its live map: a process of its own serves the page, and this end never waits for it."""

from __future__ import annotations

import contextlib
import json
import math
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from mission.cli.main import EXIT_ENVIRONMENT
from mission.common.network.own_addresses import reached_at
from sim_bridge.drive.children import end as end_child
from sim_bridge.drive.children import start
from sim_bridge.drive.links.ports import LOOPBACK, Address
from sim_bridge.errors import StartError
from sim_bridge.judge.live import wire

PROGRAM: Final = (sys.executable, "-P", "-m", "sim_bridge.judge.live")
ROWS_HZ: Final = 10.0  # while somebody looks
UNSEEN_HZ: Final = 2.0  # while nobody does: for the past that a viewer who comes later may look back at
EARLY_S: Final = 1e-6
CLOSE_LIMIT_S: Final = 4.0  # more than viewers are given to take the last message
BACKLOG: Final = 16


class Map:
    """One flight's. `begin` it, `row` and `event` as it goes, `over` at its end; `asked` in every tick."""

    def __init__(self, address: Address, controls: Sequence[str]) -> None:
        """Listening from now on; `controls`: what viewers may ask for. StartError where the address cannot be had."""
        listener = _listener(address)
        self.urls = _urls(listener)  # the first is for this machine
        self.viewers = 0
        self.gone: str | None = None  # why nothing is served any more
        self._controls = list(controls)
        self._last_s = -math.inf
        self._told: dict[str, Any] = {}
        self._end, theirs = wire.pair()
        self._ready = select.poll()  # asking costs a third of a read that finds nothing
        self._ready.register(self._end, select.POLLIN)
        with listener, theirs:
            fds = (listener.fileno(), theirs.fileno())
            self._child = start(
                [*PROGRAM, *map(str, fds)],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                orphaned=signal.SIGKILL,
                keep=fds,
            )

    @property
    def pid(self) -> int:
        """Of the process that serves it."""
        return self._child.pid

    def begin(self, mission_file: Path, title: str, size: int, stems_in: Path | None = None) -> None:
        """Announces a flight. The stem map, if any, is in the folder `stems_in`, or else beside `mission_file`."""
        files = {"mission": str(mission_file.absolute()), "stems_in": str((stems_in or mission_file.parent).absolute())}
        self._send({"begin": {**files, "title": title, "size": size, "controls": self._controls}})

    def due(self, now_s: float) -> bool:
        """True if a row is due at simulated `now_s`, which then counts as sent."""
        every_s = 1.0 / (ROWS_HZ if self.viewers else UNSEEN_HZ)
        if self.gone is not None or now_s - self._last_s < every_s - EARLY_S:
            return False
        self._last_s = now_s
        return True

    def row(self, row: Sequence[Any], yaws_deg: Sequence[float | None], ages_s: Sequence[float | None]) -> None:
        """A row as `Recorder.last`; of each vehicle its heading, and the age of its last beacon."""
        self._send({"row": row, "yaw_deg": yaws_deg, "beacon_age_s": ages_s})

    def event(self, time_s: float, text: str) -> None:
        """Something happened, as people are told."""
        kind = "fault" if text.startswith("fault") else "contact" if "has run into" in text else "text"
        told = {"time_s": round(time_s, 2), "kind": kind, "vehicles": [], "text": text.removeprefix("fault: ")}
        self._send({"event": told})

    def fault(self, fault: Mapping[str, Any]) -> None:
        """A fault began; its fields."""
        self._send({"fault": fault})

    def send_changes(self, **values: Any) -> None:
        """Sends values that have changed; nothing where all were so already."""
        new = {key: value for key, value in values.items() if self._told.get(key) != value}
        if new and self._send(new):
            self._told.update(new)

    def asked(self, wait_s: float = 0.0) -> list[dict[str, Any]]:
        """Requests of viewers since the last call; waits for the first, at most `wait_s` of wall time."""
        if self.gone is not None or not self._ready.poll(1000.0 * wait_s):
            return []
        found: list[dict[str, Any]] = []
        try:
            for data in wire.received(self._end):
                told = json.loads(data)
                if "viewers" in told:
                    self.viewers = told["viewers"]
                else:
                    found.append(told)
        except wire.GoneError as error:
            self._lose(error)
        return found

    def close(self) -> None:
        """Nothing more is told; viewers keep what they have."""
        self._end.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(CLOSE_LIMIT_S)
        end_child([self._child])

    def _send(self, message: Mapping[str, Any]) -> bool:
        if self.gone is not None:
            return False
        try:
            return wire.send(self._end, message)
        except wire.GoneError as error:
            self._lose(error)
            return False

    def _lose(self, error: wire.GoneError) -> None:
        self.gone, self.viewers = f"the map is gone: {error}", 0


def _listener(where: Address) -> socket.socket:
    family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(where)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise StartError(f"--map {where[0]}:{where[1]}: {error.strerror}", EXIT_ENVIRONMENT) from None
    return listener


def _urls(listener: socket.socket) -> list[str]:
    host, port = listener.getsockname()[:2]
    # On all addresses: loopback first, from where alone a viewer may interfere
    local = {"0.0.0.0": [LOOPBACK], "::": ["::1"]}.get(host, [])
    return [f"http://[{at}]:{port}/" if ":" in at else f"http://{at}:{port}/" for at in [*local, *reached_at(host)]]
