"""The book of orders of a real vehicle, with its file."""

from __future__ import annotations

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


def orders_path(log: str | None, vehicle_id: int) -> Path:
    """Beside the flight log, or where the service keeps its state; the same for all missions: counts only grow."""
    folder = Path(log).parent if log is not None else Path(os.environ.get(STATE, "."))
    return folder / f"orders-{vehicle_id}"
