"""The book of orders of a real vehicle, and its file, in which they outlive the process, and a power cut.

Each operator has a file of its own, the same for all missions: counts only grow. Earlier releases kept one for all.

The file is written whole, or as it was before; in the air by a thread: a card that takes half a second to sync must not
keep a setpoint waiting, and an order to land not for the card.
"""

from __future__ import annotations

import contextlib
import errno
import os
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from companion.keys.fingerprints import public_fingerprint
from companion.keys.keyring import Keyring
from companion.mavlink.orders.book import OrderBook, with_higher_mark
from companion.shell.service import STATE
from mission.common.durable_files import write_durably

KEPT_MAX: Final = 4096  # more is none of ours
JOIN_S: Final = 2.0  # at the end, for the last write


def orders_of(
    keyring: Keyring, digest: bytes, size: int, boot: int, path: Path, opened: ExitStack, *, beside_loop: bool
) -> OrderBook:
    """A vehicle's. `digest`: the mission file's; `boot`: as its frames are signed with. OSError: no such folder.

    `path`: as `orders_path` gives it, for all operators. `beside_loop`: in the air the file is written by a thread.
    """
    marks = FileMarks(operators_path(path, keyring.operator), beside_loop=beside_loop)
    opened.callback(marks.close)
    kept = with_higher_mark(marks.kept, read_kept(path))  # in doubt whose, its mark stands: nothing old counts as new
    return OrderBook(
        operator=keyring.operator, digest=digest, me=keyring.owner, size=size, boot=boot, marks=marks, kept=kept
    )


def operators_path(path: Path, operator: bytes) -> Path:
    """The file of one operator's orders: two swarms on one computer count apart. `operator`: the public key."""
    return path.with_name(f"{path.name}-{public_fingerprint(operator).replace(':', '')}")


def read_kept(path: Path) -> bytes:
    """The file that was there, or nothing. OSError: it cannot be read."""
    with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        return file.read(KEPT_MAX)
    return b""


class OldOrdersError(Exception):
    """A file of an earlier release lies where it is not read any more; the message says what to do."""


def orders_path(log: str | None, vehicle_id: int) -> Path:
    """Beside the flight log, or where the service or this user keeps state: the file of earlier releases.

    Of all operators; each has one beside it, by `operators_path`. It is read, and never written.
    OldOrdersError; OSError: this user's folder cannot be made.
    """
    name = f"orders-{vehicle_id}"
    if log is not None:
        return Path(log).parent / name
    if STATE in os.environ:
        return Path(os.environ[STATE]) / name
    folder = _users_state()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if os.path.lexists(name) and Path.cwd() != folder.resolve():  # what it has seen must not count as new
        where = "one of both that is newer" if os.path.lexists(folder / name) else "file"
        raise OldOrdersError(
            f"{name}: here, where an earlier release kept which orders vehicle {vehicle_id} has seen: move the {where} "
            f"to {folder}"
        )
    return folder / name


def _users_state() -> Path:
    """By the XDG base directories. OSError."""
    given = os.environ.get("XDG_STATE_HOME", "")
    if os.path.isabs(given):
        return Path(given) / "understory"
    try:
        return Path.home() / ".local" / "state" / "understory"
    except RuntimeError:
        raise FileNotFoundError(errno.ENOENT, "no home folder: --log FILE keeps it beside FILE", "~") from None


class FileMarks:
    """`Marks` in a file of mode 0600; `kept` is what was there when it was opened."""

    def __init__(self, path: Path, *, beside_loop: bool = True) -> None:
        """`beside_loop`: what need not be waited for is written by a thread. OSError when the folder is not there."""
        self._path: Final = path
        self._folder: Final = path.parent
        if not self._folder.is_dir():
            raise FileNotFoundError(2, "no such folder", str(self._folder))
        self.kept: Final = read_kept(path)
        self._beside_loop: Final = beside_loop
        self._changed: Final = threading.Condition()
        self._disk: Final = threading.Lock()  # one write at a time
        self._latest: tuple[bytes, int] | None = None  # to be written by the thread
        self._count = self._written = 0  # states in their order: an older one never replaces a newer
        self._failed = False  # the last write of the thread
        self._closed = False
        self._thread: threading.Thread | None = None

    def save(self, state: bytes, *, wait: bool) -> bool:
        """As `Marks`; of what is not waited for: False when the write before it has failed."""
        with self._changed:
            self._count += 1
            count = self._count
            if not wait and self._beside_loop:
                self._latest = (state, count)
                if self._thread is None:
                    self._thread = threading.Thread(target=self._run, name="orders", daemon=True)
                    self._thread.start()
                self._changed.notify()
                return not self._failed
        return self._write(state, count)

    def close(self) -> None:
        """After what is under way."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._latest is not None or self._closed)
                latest, self._latest = self._latest, None
            if latest is None:
                return
            self._failed = not self._write(*latest)

    def _write(self, state: bytes, count: int) -> bool:
        with self._disk:
            if count < self._written:
                return True
            try:
                write_durably(self._path, state)
            except OSError:
                return False
            self._written = count
        return True
