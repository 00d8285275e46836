"""The book of orders of a real vehicle, with its file."""

from __future__ import annotations

import errno
import os
from contextlib import ExitStack
from pathlib import Path

from companion.keys.keyring import Keyring
from companion.mavlink.orders.book import OrderBook
from companion.shell.order_marks import FileMarks
from companion.shell.service import STATE


def orders_of(
    keyring: Keyring, digest: bytes, size: int, boot: int, path: Path, opened: ExitStack, *, beside_loop: bool
) -> OrderBook:
    """A vehicle's. `digest`: the mission file's; `boot`: as its frames are signed with. OSError: no such folder.

    `beside_loop`: in the air the file is written by a thread.
    """
    marks = FileMarks(path, beside_loop=beside_loop)
    opened.callback(marks.close)
    return OrderBook(
        operator=keyring.operator, digest=digest, me=keyring.owner, size=size, boot=boot, marks=marks, kept=marks.kept
    )


class OldOrdersError(Exception):
    """A file of an earlier release lies where it is not read any more; the message says what to do."""


def orders_path(log: str | None, vehicle_id: int) -> Path:
    """Beside the flight log, or where the service or this user keeps state.

    The same for all missions: counts only grow. OldOrdersError; OSError: this user's folder cannot be made.
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
