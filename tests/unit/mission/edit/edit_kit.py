"""A server of `mission edit`, and requests to it as its page sends them, or as somebody else would."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mission.edit.api import Api
from mission.edit.draft import Draft, open_draft
from mission.edit.editor import Editor
from mission.edit.flight import Finder, Flight, find_program
from mission.edit.server import EditServer

GOOD = """\
schema = 1
name = "mine" # as it is called
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 3.0
"""
JSON = "application/json"


class Client:
    """Of one server. `revision`: of the last state that it was told."""

    def __init__(self, server: EditServer, draft: Draft, flight: Flight) -> None:
        self.server, self.draft, self.flight = server, draft, flight
        self.revision = 0
        self.cookie = f"{server.cookie}={server.token}"

    def ask(
        self, method: str, path: str, body: bytes | None = None, **headers: str | None
    ) -> tuple[int, http.client.HTTPMessage, bytes]:
        """As the page; `headers`: other ones, None: left out. Underscores are hyphens."""
        own = {"Cookie": self.cookie, "Origin": f"http://{self.server.host}", "Host": self.server.host}
        told = {**own, **{name.replace("_", "-"): value for name, value in headers.items()}}
        connection = http.client.HTTPConnection(*self.server.server_address[:2], timeout=20)
        try:
            connection.putrequest(method, path, skip_host=True)
            if body is not None and "Content-Length" not in told:
                told["Content-Length"] = str(len(body))
            for name, value in told.items():
                if value is not None:
                    connection.putheader(name, value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def state(self) -> dict[str, Any]:
        """What the page shows."""
        status, _, data = self.ask("GET", "/state")
        assert status == 200
        told: dict[str, Any] = json.loads(data)
        self.revision = told["revision"]
        return told

    def do(self, path: str, **keys: Any) -> tuple[int, dict[str, Any]]:
        """A request of the page, at the revision that it knows."""
        body = json.dumps({"revision": self.revision, **keys}).encode()
        status, _, data = self.ask("POST", path, body, Content_Type=JSON)
        told: dict[str, Any] = json.loads(data)
        self.revision = told.get("state", {}).get("revision", self.revision)
        return status, told

    def change(self, *changes: tuple[str, tuple[str | int, ...], Any]) -> tuple[int, dict[str, Any]]:
        """(do, path, value), each."""
        return self.do("/change", changes=[{"do": do, "path": path, "value": value} for do, path, value in changes])


@contextmanager
def editing(path: Path, text: str | None = GOOD, find: Finder = find_program) -> Iterator[Client]:
    """A server for the mission file `path`, which `text` is written into first."""
    if text is not None:
        path.write_text(text)
    draft = open_draft(path)
    flight = Flight(find)
    with EditServer(Api(Editor(draft), flight)) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        try:
            yield Client(server, draft, flight)
        finally:
            server.shutdown()
            thread.join()
            flight.close()
