"""A store of signed records: what was in it before there were keys, and those of another fleet."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from companion.keys.crypto import public_key
from companion.keys.keyring import Keyring
from companion.records.record import Draft, LogKey, Record, RecordKind
from companion.records.signed.keys import RecordKeys
from companion.records.store import Batch, RecordStore, open_store
from tests.unit.mavlink.signing_kit import keyring, seed
from tests.unit.records.signed_kit import keys_of

OTHER = LogKey(2, 0xBEEF)


@pytest.fixture
def draw() -> Callable[[], int]:
    numbers: Iterator[int] = count(100)
    return lambda: next(numbers)


def other(number: int, *, signed: bool) -> Record:
    record = Record(*OTHER, number, RecordKind.STEM, 1.0, b"other %d" % number)
    return keys_of(2).sign(record) if signed else record


def opened(path: Path, draw: Callable[[], int], keys: RecordKeys | None) -> RecordStore:
    return open_store(path / "a.db", 1, draw, keys=keys)[0]


def drafts(*names: str) -> list[Draft]:
    return [Draft(RecordKind.STEM, 1.23456789, name.encode()) for name in names]


def test_own_records_are_signed_as_they_are_written_and_stay_so(tmp_path: Path, draw: Callable[[], int]) -> None:
    keys = keys_of(1)
    store = opened(tmp_path, draw, keys)
    (own,) = store.write(Batch(own=drafts("a"), others=[other(1, signed=True)])).own
    assert keys.proves(own)
    store.close()
    again = opened(tmp_path, draw, keys)
    for key in (again.own_log, OTHER):
        kept = again.find_record(key, 1)
        assert kept is not None
        assert keys.proves(kept)
    assert again.set_apart == 0


def test_file_of_a_flight_without_keys(tmp_path: Path, draw: Callable[[], int]) -> None:
    """The own log is signed; what others' records are nobody can say, nor who acknowledged."""
    store = opened(tmp_path, draw, None)
    own = store.own_log
    store.write(Batch(own=drafts("a", "b"), others=[other(1, signed=False)], acked={own: 2, OTHER: 1}, epoch=5))
    lost = LogKey(1, 77)  # of this vehicle before it lost its disk, as somebody sent it
    store.write(Batch(others=[Record(*lost, 1, RecordKind.STEM, 1.0, b"mine?")]))
    store.close()
    store, said = open_store(tmp_path / "a.db", 1, draw, keys=keys_of(1))
    assert said == "2 that nobody has signed: set apart"
    assert {key: holding.upto for key, holding in store.holdings().items() if holding.upto} == {own: 2}
    assert store.acked() == {}
    kept = store.find_record(own, 2)
    assert kept is not None
    assert keys_of(1).proves(kept)
    store.write(Batch(others=[other(1, signed=True)], acked={own: 2}))
    store.close()
    store, said = open_store(tmp_path / "a.db", 1, draw, keys=keys_of(1))
    assert (said, store.acked()) == ("", {own: 2})
    found = store.find_record(OTHER, 1)
    assert found is not None
    assert keys_of(1).proves(found)
    with sqlite3.connect(tmp_path / "a.db") as database:
        assert database.execute("SELECT body FROM unproven ORDER BY body").fetchall() == [(b"mine?",), (b"other 1",)]


def test_acknowledgements_of_a_flight_without_keys_in_between_count_no_more(
    tmp_path: Path, draw: Callable[[], int]
) -> None:
    opened(tmp_path, draw, keys_of(1)).close()
    store = opened(tmp_path, draw, None)
    own = store.own_log
    store.write(Batch(own=drafts("a"), acked={own: 1}, epoch=5))
    store.close()
    assert opened(tmp_path, draw, keys_of(1)).acked() == {}


def test_what_an_earlier_fleets_keys_signed_proves_nothing(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = opened(tmp_path, draw, keys_of(1))
    store.write(Batch(own=drafts("a"), others=[other(1, signed=True)]))
    own = store.own_log
    store.close()
    ring = keyring(1, 6)
    fleet = {k: public_key(seed(k + 100)) for k in ring.vehicles}
    newer: Keyring = replace(ring, seed=seed(101), vehicles=fleet)
    store, said = open_store(tmp_path / "a.db", 1, draw, keys=keys_of(1, ring=newer))
    assert said == "1 that nobody has signed: set apart"
    kept = store.find_record(own, 1)
    assert kept is not None
    assert keys_of(1, ring=newer).proves(kept)
    assert not keys_of(1).proves(kept)


def test_records_of_one_that_is_revoked_stay_where_they_are(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = opened(tmp_path, draw, keys_of(1))
    store.write(Batch(others=[other(1, signed=True)]))
    store.close()
    ring = keyring(1, 6)
    without = replace(ring, vehicles={k: public for k, public in ring.vehicles.items() if k != 2})
    store, said = open_store(tmp_path / "a.db", 1, draw, keys=keys_of(1, ring=without))
    assert (said, store.find_record(OTHER, 1)) == ("", other(1, signed=True))


def test_record_that_goes_over_to_a_new_log_is_signed_for_it(tmp_path: Path, draw: Callable[[], int]) -> None:
    store = opened(tmp_path, draw, keys_of(1))
    store.write(Batch(own=drafts("a")))
    before = store.own_log
    store.close()
    store = opened(tmp_path, draw, keys_of(1))
    store.write(Batch(own=drafts("b")))
    assert store.write(Batch(own=drafts("c"), begins_log=True)).moved == 1
    assert store.own_log != before
    for key, number in ((before, 1), (store.own_log, 1), (store.own_log, 2)):
        kept = store.find_record(key, number)
        assert kept is not None
        assert keys_of(1).proves(kept)


def test_file_of_records_without_keys_is_as_it_was(tmp_path: Path, draw: Callable[[], int]) -> None:
    opened(tmp_path, draw, None).close()
    with sqlite3.connect(tmp_path / "a.db") as database:
        tables = {name for (name,) in database.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
        columns = [row[1] for row in database.execute("PRAGMA table_info(record)")]
        names = {name for (name,) in database.execute("SELECT name FROM meta")}
    assert tables == {"meta", "record", "log"}
    assert columns == ["vehicle_id", "log_id", "number", "kind", "made_s", "body"]
    assert names == {"format", "vehicle_id", "own_log"}
