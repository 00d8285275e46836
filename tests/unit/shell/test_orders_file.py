"""The file of a vehicle's orders: whole or as before, newest last, and nobody waits for it who must not."""

from __future__ import annotations

import os
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from companion.core.model.states import Order
from companion.keys.fleet_folder import make_fleet
from companion.keys.key_file import load_keyring
from companion.keys.keyring import OPERATOR
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.order import OrderKind
from companion.shell import orders
from companion.shell.orders import FileMarks, OldOrdersError, operators_path, orders_of, orders_path, write_durably
from companion.shell.service import STATE
from tests.unit.mavlink import orders_kit as kit


def test_file_is_beside_the_log_or_where_state_is_kept_and_never_where_one_happens_to_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert orders_path(str(tmp_path / "flight.log"), 3) == tmp_path / "orders-3"
    monkeypatch.setenv(STATE, "/var/lib/understory")
    assert orders_path(None, 3) == Path("/var/lib/understory/orders-3")
    monkeypatch.delenv(STATE)
    assert orders_path(None, 3) == tmp_path / "state" / "understory" / "orders-3"
    assert (tmp_path / "state" / "understory").stat().st_mode & 0o777 == 0o700
    monkeypatch.setenv("XDG_STATE_HOME", "state")  # must be absolute
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert orders_path(None, 3) == tmp_path / "home" / ".local" / "state" / "understory" / "orders-3"
    (tmp_path / "home" / ".local" / "state" / "understory").rmdir()
    (tmp_path / "home" / ".local" / "state" / "understory").touch()
    with pytest.raises(FileExistsError):
        orders_path(None, 3)


def test_file_that_an_earlier_release_left_here_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else an order that it has seen would count as new."""
    folder = tmp_path / "state" / "understory"
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(STATE, raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    (tmp_path / "orders-3").write_bytes(b"one")
    with pytest.raises(OldOrdersError, match=f"^orders-3: here, where .* seen: move the file to {folder}$"):
        orders_path(None, 3)
    assert orders_path(None, 2) == folder / "orders-2"
    (folder / "orders-3").write_bytes(b"two")
    with pytest.raises(OldOrdersError, match=f"move the one of both that is newer to {folder}$"):
        orders_path(None, 3)
    (tmp_path / "orders-3").unlink()
    assert orders_path(None, 3) == folder / "orders-3"
    monkeypatch.chdir(folder)
    assert orders_path(None, 3) == folder / "orders-3"


class Swarm:
    """Vehicle 1 of a fleet of its own, in the air; each `book` is of another start of its companion."""

    def __init__(self, folder: Path, path: Path) -> None:
        make_fleet(folder, 2)
        self.seed = load_keyring(folder / "operator.key", OPERATOR).seed
        self.keyring = load_keyring(folder / "vehicle-1.key", 1)
        self.path = path

    def book(self, boot: int) -> OrderBook:
        with ExitStack() as opened:
            return orders_of(self.keyring, kit.DIGEST, 2, boot, self.path, opened, beside_loop=False)

    def order(self, kind: OrderKind, counter: int) -> bytes:
        return kit.order(kind, counter, boots={1: 7}, size=2, seed=self.seed)

    def fly(self, hold: int) -> None:
        """Until it has obeyed a HOLD of this count, and the START before it."""
        book = self.book(boot=7)
        assert hear(book, self.order(OrderKind.START, hold - 1), airborne=False) == [Order.START]
        assert hear(book, self.order(OrderKind.HOLD, hold)) == [Order.HOLD]


def hear(book: OrderBook, *payloads: bytes, airborne: bool = True) -> list[Order]:
    for payload in payloads:
        assert book.receive(kit.frame(payload), 10.0)
    return [event.order for event in book.tick(10.0, airborne=airborne)]


def test_another_swarms_orders_on_this_computer_make_none_of_ours_old(tmp_path: Path) -> None:
    """Both keep state in one folder: who was started again refused the HOLD in force of its own swarm."""
    one, other = (Swarm(tmp_path / name, tmp_path / "orders-1") for name in ("one", "other"))
    one.fly(hold=6)
    other.fly(hold=101)
    book = one.book(boot=8)
    assert hear(book, one.order(OrderKind.HOLD, 6)) == [Order.HOLD]
    assert not book.refused
    assert hear(one.book(boot=9), one.order(OrderKind.START, 5), airborne=False) == []


def test_mark_that_an_earlier_release_kept_for_all_still_counts(tmp_path: Path) -> None:
    """Whosoever it is: forgotten, an old order would count as new."""
    one, other = (Swarm(tmp_path / name, tmp_path / "orders-1") for name in ("one", "other"))
    one.fly(hold=6)
    operators_path(one.path, one.keyring.operator).rename(one.path)
    assert hear(one.book(boot=8)) == [Order.HOLD]  # the carried order, too
    one.fly(hold=11)
    operators_path(one.path, one.keyring.operator).replace(one.path)
    one.fly(hold=21)  # now the own file is the newer one,
    assert hear(one.book(boot=8), one.order(OrderKind.HOLD, 20)) == [Order.HOLD]
    other.fly(hold=101)
    operators_path(other.path, other.keyring.operator).replace(other.path)
    book = one.book(boot=8)  # and now the earlier release's
    assert hear(book, one.order(OrderKind.HOLD, 100)) == []
    assert book.refused == {"replayed": 1}
    assert hear(book, one.order(OrderKind.HOLD, 102)) == [Order.HOLD]
    operators_path(one.path, one.keyring.operator).write_bytes(b"damaged")
    assert hear(one.book(boot=8), one.order(OrderKind.HOLD, 100)) == []


def test_what_was_saved_is_there_after_a_restart_and_the_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "orders"
    marks = FileMarks(path)
    assert marks.kept == b""
    assert marks.save(b"one", wait=True)
    marks.save(b"two", wait=False)
    marks.close()
    assert FileMarks(path).kept == b"two"
    assert path.stat().st_mode & 0o777 == 0o600
    assert [file.name for file in tmp_path.iterdir()] == ["orders"]


@pytest.mark.parametrize("call", ["open", "fsync", "replace"])
def test_write_that_fails_anywhere_leaves_the_file_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path = tmp_path / "orders"
    marks = FileMarks(path)
    marks.save(b"one", wait=True)

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, call, fail)
    assert not marks.save(b"two", wait=True)
    monkeypatch.undo()
    assert FileMarks(path).kept == b"one"
    assert [file.name for file in tmp_path.iterdir()] == ["orders"]


def test_write_that_is_not_waited_for_keeps_nobody_waiting_and_an_older_never_replaces_a_newer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, goes_on, written = threading.Event(), threading.Event(), []

    def slow(path: Path, data: bytes) -> None:
        begun.set()
        assert goes_on.wait(10.0)
        written.append(data)
        write_durably(path, data)

    monkeypatch.setattr(orders, "write_durably", slow)
    marks = FileMarks(tmp_path / "orders")
    marks.save(b"1", wait=False)
    assert begun.wait(10.0)
    for k in range(2, 10):
        assert marks.save(str(k).encode(), wait=False)  # at once, though the disk hangs
    goes_on.set()
    marks.save(b"last", wait=True)
    marks.close()
    assert written[0] == b"1"
    assert FileMarks(tmp_path / "orders").kept == b"last"


def test_without_a_thread_all_is_waited_for(tmp_path: Path) -> None:
    marks = FileMarks(tmp_path / "orders", beside_loop=False)
    assert marks.save(b"one", wait=False)
    assert (tmp_path / "orders").read_bytes() == b"one"


def test_folder_that_is_not_there_is_an_error_when_it_is_opened(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        FileMarks(tmp_path / "none" / "orders")
