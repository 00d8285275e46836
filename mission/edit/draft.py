"""A mission's text while it is edited: undo and redo, what its file on the disk holds meanwhile, and saving."""

from __future__ import annotations

import os
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final

from mission.common.durable_files import replace_file, sync_folder
from mission.common.files import MAX_PLACE_CHARS, decoded, read_bytes
from mission.common.problems import MissionError, printable
from mission.document.load import MAX_FILE_BYTES, parse_toml
from mission.edit.toml_text import Change, ChangeError, change_text

MOST_TEXTS: Final = 300  # that undo goes back over
MOST_COPIES: Final = 100


class OnDisk(StrEnum):
    """The file, compared with what this program read or wrote last."""

    NEW = "new"  # not there yet
    SAME = "same"
    CHANGED = "changed"  # somebody else wrote it
    GONE = "gone"


class SaveError(Exception):
    """The file is as it was; the message says why."""


class Draft:
    """The text that is to stand in `path`. It is TOML at any time, whether it is a good mission or not."""

    def __init__(self, path: Path, text: str, known: bytes | None) -> None:
        """`known`: what the file holds; None: it is not there yet."""
        self.path = path
        self.revision = 0  # counts what happens to the text: who asks for a change says which text is meant
        self._texts = [(text, False)]  # each, and whether comments were lost on the way to it
        self._at = 0
        self._known = known
        self._saved = None if known is None else text

    @property
    def text(self) -> str:
        """As it is now."""
        return self._texts[self._at][0]

    @property
    def has_lost_comments(self) -> bool:
        """Comments that the file had are not in it."""
        return self._texts[self._at][1]

    @property
    def is_saved(self) -> bool:
        """It is what was read or written last."""
        return self.text == self._saved

    @property
    def can_undo(self) -> bool:
        """There is a text before it."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """There is one after it."""
        return self._at + 1 < len(self._texts)

    def change(self, changes: Sequence[Change]) -> None:
        """Makes all `changes`, or none: ChangeError."""
        text, lost = change_text(self.text, changes)
        size = len(text.encode())
        if size > MAX_FILE_BYTES:
            raise ChangeError(
                f"a mission file holds at most {MAX_FILE_BYTES // 1024} KiB: this makes {size / 1024:.1f}"
            )
        self._push(text, self.has_lost_comments or lost)

    def undo(self) -> None:
        """Back to the text before, if there is one."""
        if self.can_undo:
            self._at -= 1
            self.revision += 1

    def redo(self) -> None:
        """The text that was undone last, if there is one."""
        if self.can_redo:
            self._at += 1
            self.revision += 1

    def on_disk(self) -> OnDisk:
        """State of the file."""
        try:
            now = self._read_file()
        except MissionError:
            now = None
        if now is None and not self.path.exists():
            return OnDisk.NEW if self._known is None else OnDisk.GONE
        return OnDisk.SAME if now is not None and now == self._known else OnDisk.CHANGED

    def reload(self) -> None:
        """Takes over the text of the file; undo brings back what was here. MissionError: not TOML, or not there."""
        data = self._read_file()
        text = decoded(data, self._place())
        parse_toml(text, self._place())
        self._known, self._saved = data, text
        self._push(text)

    def save(self, *, over: bool = False) -> Path | None:
        """Writes the file, whole or not at all. SaveError: it cannot be written, or somebody else has changed it.

        `over`: what somebody else wrote is kept in a file beside it, which is returned, and then replaced.
        """
        kept = None
        if self.on_disk() is OnDisk.CHANGED:
            if not over:
                raise SaveError("the file on the disk is not what was opened here: another program has changed it")
            kept = self._keep_other()
        data = self.text.encode()
        target = Path(os.path.realpath(self.path))  # a link stays one
        try:
            replace_file(target, data, mode=_mode_of(target))
            sync_folder(target.parent)
        except OSError as error:
            raise SaveError(f"cannot write {self._place()}: {os.strerror(error.errno or 0)}") from None
        self._known, self._saved = data, self.text
        return kept

    def _push(self, text: str, has_lost_comments: bool = False) -> None:
        self.revision += 1
        if text == self.text:
            return
        self._texts = [*self._texts[: self._at + 1], (text, has_lost_comments)][-MOST_TEXTS:]
        self._at = len(self._texts) - 1

    def _keep_other(self) -> Path:
        """A copy of the file beside it, under a name that nothing has."""
        try:
            data = self.path.read_bytes()
            for count in range(1, MOST_COPIES):
                kept = self.path.with_name(f"{self.path.stem}.other-{count}{self.path.suffix}")
                try:
                    with kept.open("xb") as file:
                        file.write(data)
                except FileExistsError:
                    if kept.read_bytes() == data:
                        return kept
                else:
                    return kept
        except OSError as error:
            raise SaveError(f"cannot keep a copy of {self._place()}: {os.strerror(error.errno or 0)}") from None
        raise SaveError(f"cannot keep a copy of {self._place()}: there are {MOST_COPIES} already")

    def _read_file(self) -> bytes:
        return read_bytes(self.path, self._place(), MAX_FILE_BYTES)

    def _place(self) -> str:
        return printable(os.fsdecode(self.path), MAX_PLACE_CHARS)


def open_draft(path: Path) -> Draft:
    """The draft of a file that is there. MissionError: it cannot be read, or is not TOML."""
    place = printable(os.fsdecode(path), MAX_PLACE_CHARS)
    data = read_bytes(path, place, MAX_FILE_BYTES)
    text = decoded(data, place)
    parse_toml(text, place)
    return Draft(path, text, data)


def _mode_of(path: Path) -> int:
    """Permissions that the file has; of a new one, what others of this user have."""
    try:
        return path.stat().st_mode & 0o777
    except OSError:
        mask = os.umask(0o077)
        os.umask(mask)
        return 0o666 & ~mask
