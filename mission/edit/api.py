"""Requests of the page, checked, in the order in which they come: each changes the draft, or is refused in words."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from mission.common.files import os_words
from mission.common.problems import MissionError, printable
from mission.edit.draft import SaveError
from mission.edit.editor import Editor
from mission.edit.flight import Flight
from mission.edit.toml_text import Change, ChangeError

MOST_CHANGES: Final = 200


class RefusalError(Exception):
    """A request that is not done: its status, and why, for the page to show."""

    def __init__(self, status: HTTPStatus, why: str, **more: Any) -> None:
        super().__init__(why)
        self.status = status
        self.body: dict[str, Any] = {"refused": why, **more}


class _Request(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class _AtRevision(_Request):
    """Of a text that the page shows."""

    revision: int


class _Changes(_AtRevision):
    changes: Annotated[tuple[Change, ...], Field(min_length=1, max_length=MOST_CHANGES)]


class _Save(_AtRevision):
    over: bool = False


class _Stems(_AtRevision):
    name: Annotated[str, Field(min_length=1, max_length=80)]


class Api:
    """The editor and its flights, one request at a time."""

    def __init__(self, editor: Editor, flight: Flight) -> None:
        self._editor, self._flight = editor, flight
        self._lock = threading.Lock()
        self._done: Mapping[str, tuple[type[_AtRevision], Callable[[Any], dict[str, Any]]]] = {
            "/change": (_Changes, self._change),
            "/undo": (_AtRevision, self._undo),
            "/redo": (_AtRevision, self._redo),
            "/save": (_Save, self._save),
            "/reload": (_AtRevision, self._reload),
            "/stems": (_Stems, self._stems),
            "/fly": (_AtRevision, self._fly),
            "/stop": (_AtRevision, self._stop),
        }

    def view(self, path: str) -> bytes | None:
        """JSON at `path`: changes nothing. None: there is none."""
        with self._lock:
            if path == "/stand":
                return self._editor.ground.data
            if path == "/state":
                self._editor.look_again()
                return json.dumps(self._editor.describe()).encode()
            if path == "/flight":
                return json.dumps(self._flight.describe()).encode()
        return None

    def report(self) -> bytes | None:
        """Replay of the last flight."""
        return self._flight.report()

    def do(self, path: str, body: bytes) -> dict[str, Any]:
        """Does what the page asks for; returns what it shows then. RefusalError."""
        if path not in self._done:
            raise RefusalError(HTTPStatus.NOT_FOUND, "there is nothing here")
        model, act = self._done[path]
        try:
            asked = model.model_validate_json(body)
        except ValidationError as error:
            first = error.errors(include_url=False, include_input=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise RefusalError(HTTPStatus.BAD_REQUEST, printable(f"{where}: {first['msg']}", 200)) from None
        with self._lock:
            if asked.revision != self._editor.draft.revision and path not in ("/stop",):
                why = "the mission has been changed in another window meanwhile: this shows it as it is now"
                raise RefusalError(HTTPStatus.CONFLICT, why, state=self._editor.describe())
            return self._told(act, asked)

    def upload(self, name: str, data: bytes) -> dict[str, Any]:
        """Puts a stem map beside the mission, which flies in it. RefusalError."""
        with self._lock:
            return self._told(lambda _: self._take_stems(name, data), None)

    def _told(self, act: Callable[[Any], dict[str, Any]], asked: object) -> dict[str, Any]:
        try:
            more = act(asked)
        except (ChangeError, MissionError) as error:
            raise RefusalError(HTTPStatus.UNPROCESSABLE_ENTITY, str(error), state=self._editor.describe()) from None
        except SaveError as error:
            raise RefusalError(HTTPStatus.CONFLICT, str(error), state=self._editor.describe()) from None
        return {"state": self._editor.describe(), **more}

    def _change(self, asked: _Changes) -> dict[str, Any]:
        self._editor.change(asked.changes)
        return {}

    def _undo(self, _: _AtRevision) -> dict[str, Any]:
        self._editor.draft.undo()
        return {}

    def _redo(self, _: _AtRevision) -> dict[str, Any]:
        self._editor.draft.redo()
        return {}

    def _save(self, asked: _Save) -> dict[str, Any]:
        kept = self._editor.draft.save(over=asked.over)
        name = self._editor.draft.path.name
        also = f"; what the other program wrote is in {kept.name}" if kept is not None else ""
        return {"said": f"saved: {name}{also}"}

    def _reload(self, _: _AtRevision) -> dict[str, Any]:
        self._editor.draft.reload()
        return {}

    def _stems(self, asked: _Stems) -> dict[str, Any]:
        return self._take_stems(asked.name, None)

    def _take_stems(self, name: str, data: bytes | None) -> dict[str, Any]:
        self._editor.take_stems(name, data)
        return {"said": f"{name} is beside the mission" if data is not None else ""}

    def _fly(self, _: _AtRevision) -> dict[str, Any]:
        draft = self._editor.draft
        try:
            self._flight.start(draft.path.name, draft.text, self._editor.stem_file(), draft.revision)
        except OSError as error:
            raise RefusalError(
                HTTPStatus.SERVICE_UNAVAILABLE, f"cannot fly: {printable(os_words(error), 200)}"
            ) from None
        return {"flight": self._flight.describe()}

    def _stop(self, _: _AtRevision) -> dict[str, Any]:
        self._flight.stop()
        return {"flight": self._flight.describe()}
