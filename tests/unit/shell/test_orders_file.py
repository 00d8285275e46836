"""The file of a vehicle's orders: whole or as before, newest last, and nobody waits for it who must not."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from companion.shell import orders
from companion.shell.orders import FileMarks, OldOrdersError, orders_path, write_durably
from companion.shell.service import STATE


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
