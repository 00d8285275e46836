"""Records after a power cut at any write: what a write returned is there, in order, and the file opens again."""

from __future__ import annotations

import random
import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from companion.records.record import Draft, RecordKind
from companion.records.store import Batch, RecordStore, open_store

SEED = 20
WRITER = """
import sys
from companion.records.record import Draft, RecordKind
from companion.records.store import Batch, RecordStore

store = RecordStore(sys.argv[1], 1, lambda: 7)
while True:
    written = store.write(Batch(own=[Draft(RecordKind.STEM, 0.0, b"x" * 200)] * 3))
    print(written.own[-1].number, flush=True)
"""


def numbers(path: Path) -> list[int]:
    store, said = open_store(path, 1, lambda: 7)
    assert said == ""
    found = [number for _, number, _, _ in store.records(RecordKind.STEM)]
    store.close()
    return found


@pytest.mark.parametrize("kills", [6])
def test_a_process_that_is_killed_while_it_writes_loses_nothing_that_it_was_told_of(tmp_path: Path, kills: int) -> None:
    rng = random.Random(SEED)
    path = tmp_path / "a.db"
    for _ in range(kills):
        with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True) as writer:
            assert writer.stdout is not None
            told = 0
            for _ in range(rng.randint(1, 25)):
                told = int(writer.stdout.readline())
            writer.send_signal(signal.SIGKILL)
            rest = writer.stdout.read().split()
            told = max([told, *(int(word) for word in rest if word.isdigit())])
        found = numbers(path)
        assert found == list(range(1, len(found) + 1))
        assert len(found) >= told
        assert len(found) % 3 == 0  # a batch is there whole, or not at all


def written(folder: Path, batches: int) -> Path:
    """A file as a power cut leaves it: the database, and a WAL that nobody has put into it yet."""
    folder.mkdir()
    store = RecordStore(folder / "live.db", 1, lambda: 7)
    for count in range(batches):
        store.write(Batch(own=[Draft(RecordKind.STEM, float(count), b"%d" % count)]))
    for ending in ("", "-wal"):
        shutil.copyfile(folder / f"live.db{ending}", folder / f"a.db{ending}")
    store.close()
    return folder / "a.db"


@pytest.mark.parametrize("seed", range(12))
def test_a_wal_that_is_cut_anywhere_leaves_the_log_up_to_there(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    path = written(tmp_path / "a", 30)
    wal = path.with_name("a.db-wal")
    wal.write_bytes(wal.read_bytes()[: rng.randrange(wal.stat().st_size)])
    store, _ = open_store(path, 1, lambda: 7)
    found = [number for _, number, _, _ in store.records(RecordKind.STEM)]
    assert found == list(range(1, len(found) + 1))
    following = store.write(Batch(own=[Draft(RecordKind.STEM, 0.0, b"next")])).own
    assert [record.number for record in following] == [len(found) + 1]


@pytest.mark.parametrize("seed", range(12))
def test_a_wal_with_a_wrong_byte_anywhere_leaves_the_log_up_to_there(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    path = written(tmp_path / "a", 30)
    wal = path.with_name("a.db-wal")
    data = bytearray(wal.read_bytes())
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    wal.write_bytes(bytes(data))
    store, _ = open_store(path, 1, lambda: 7)
    found = [number for _, number, _, _ in store.records(RecordKind.STEM)]
    assert found == list(range(1, len(found) + 1))


@pytest.mark.parametrize("seed", range(40))
def test_a_database_with_wrong_bytes_is_read_or_set_aside_and_never_raises(tmp_path: Path, seed: int) -> None:
    rng = random.Random(seed)
    path = written(tmp_path / "a", 30)
    with sqlite3.connect(path) as connection:  # the WAL goes into the database
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()
    data = bytearray(path.read_bytes())
    for _ in range(40):
        data[rng.randrange(len(data))] = rng.randrange(256)
    data[68:72] = b"Urec"  # by these it is known as a store of ours
    path.write_bytes(bytes(data))
    store, said = open_store(path, 1, lambda: 8)
    assert store.write(Batch(own=[Draft(RecordKind.STEM, 0.0, b"next")])).own
    assert said == "" or "set aside" in said
