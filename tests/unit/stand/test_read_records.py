"""Files that `companion stand` reads records from, and those that it refuses."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from companion.cli import main
from companion.records.record import BASE_ID, Record, RecordKind
from companion.records.store import Batch, RecordStore
from companion.stand import records as records_module
from companion.stand.products.write import write_products
from companion.stand.records import RecordsError, StoredRecord, read_records
from tests.unit.records.signed_kit import keys_of
from tests.unit.stand.test_products import ORIGIN, TEXT, mission, stored


@pytest.mark.parametrize(
    ("content", "said_there"),
    [(None, "no such file"), (b"no database at all, but long enough to be one" * 9, "cannot be read as a store")],
)
def test_a_store_that_is_none_is_refused(
    content: bytes | None, said_there: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.toml").write_text(TEXT)
    if content is not None:
        (tmp_path / "base.db").write_bytes(content)
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(["stand", str(tmp_path / "base.db"), *arguments]) == 2
    error = capsys.readouterr().err
    assert said_there in error
    assert str(tmp_path / "base.db") in error


@pytest.mark.parametrize("row", [(1, "stem", 0.0, b""), (1, 1, 0.0, "text"), (1, 1, None, b""), (1, 1, "noon", b"")])
def test_rows_that_are_no_records_are_refused(
    row: tuple[object, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.toml").write_text(TEXT)
    with sqlite3.connect(tmp_path / "base.db") as database:
        database.execute("CREATE TABLE record (vehicle_id, log_id, number, kind, made_s, body)")
        database.execute("INSERT INTO record VALUES (?, 7, 1, ?, ?, ?)", row)
    database.close()
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(["stand", str(tmp_path / "base.db"), *arguments]) == 2
    assert "is no record" in capsys.readouterr().err


@pytest.mark.parametrize("is_touched", [False, True], ids=["as it was", "opened by a base station"])
def test_a_database_of_something_else_is_refused_by_its_name(
    is_touched: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.toml").write_text(TEXT)
    write_products([], mission(origin=ORIGIN), tmp_path)
    (tmp_path / "stems.gpkg").rename(tmp_path / "mine.gpkg")
    if is_touched:
        stored([], tmp_path / "mine.gpkg")
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(["stand", str(tmp_path / "mine.gpkg"), *arguments]) == 2
    assert f"{tmp_path / 'mine.gpkg'}: " in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_store_without_records_yet_is_no_foreign_one(tmp_path: Path) -> None:
    RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7).close()
    assert read_records(tmp_path / "base.db") == []


def test_a_store_of_more_records_than_the_bound_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    records = [StoredRecord(1, 7, number, 3, 0.0, b"") for number in range(1, 12)]
    monkeypatch.setattr(records_module, "MAX_RECORDS", 10)
    with pytest.raises(RecordsError, match="more than 10 records"):
        read_records(stored(records, tmp_path / "base.db"))


def test_who_signed_a_record_is_told_and_what_nobody_signed_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a base station's file that was in use before the fleet had keys."""
    before = RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7)
    old = [Record(1, 5, number, RecordKind.PAYLOAD, 0.0, b"old") for number in (1, 2)]
    before.write(Batch(others=old))
    before.close()
    keys = keys_of(BASE_ID)
    store = RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7, keys=keys)
    store.write(Batch(others=[keys_of(2).sign(Record(2, 6, 1, RecordKind.PAYLOAD, 0.0, b"new"))]))
    store.close()
    assert read_records(tmp_path / "base.db") == [StoredRecord(2, 6, 1, 3, 0.0, b"new", proven=True)]
    (tmp_path / "m.toml").write_text(TEXT)
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(["stand", str(tmp_path / "base.db"), *arguments]) == 0
    said = capsys.readouterr().out
    assert "left out: 2 records that were there before the swarm had keys" in said
    assert json.loads((tmp_path / "out" / "stand.json").read_text())["logs"][0]["proven"] == 1
    assert json.loads((tmp_path / "out" / "records.jsonl").read_text())["proven"] is True
    assert (
        "1 record of 1 vehicle, each signed by the one that made it." in (tmp_path / "out" / "report.html").read_text()
    )


def test_records_of_whom_some_are_signed_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a base station that ran without its key later."""
    RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7, keys=keys_of(BASE_ID)).close()
    store = RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7)
    store.write(Batch(others=[Record(1, 5, 1, RecordKind.PAYLOAD, 0.0, b"unsigned")]))
    store.close()
    with sqlite3.connect(tmp_path / "base.db") as database:
        database.execute("INSERT INTO record VALUES (2, 6, 1, 3, 0.0, x'00', x'01')")
    database.close()
    (tmp_path / "m.toml").write_text(TEXT)
    arguments = ["--mission", str(tmp_path / "m.toml"), "--out", str(tmp_path / "out")]
    assert main(["stand", str(tmp_path / "base.db"), *arguments]) == 0
    assert "; 1 of 2 records are signed by nobody" in capsys.readouterr().out
    assert "1 of 2 records are signed by nobody" in (tmp_path / "out" / "report.html").read_text()
