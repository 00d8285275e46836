"""Files that `companion stand` reads records from, and those that it refuses."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from companion.cli import main
from companion.records.record import BASE_ID, Record, RecordKind
from companion.records.signed.keys import mission_hash
from companion.records.store import Batch, RecordStore
from companion.stand import records as records_module
from companion.stand.products.write import write_products
from companion.stand.records import RecordsError, StoredRecord, read_records, read_stores
from mission.document.load import dump_mission
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


def test_records_of_another_mission_are_refused_and_of_one_without_an_origin_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flown = mission(origin=ORIGIN)
    RecordStore(tmp_path / "base.db", BASE_ID, lambda: 7, mission_hash=mission_hash(flown)).close()
    moved = ORIGIN | {"lat_deg": -ORIGIN["lat_deg"]}
    for name, other, code in (("flown", flown, 0), ("open", mission(), 0), ("moved", mission(origin=moved), 2)):
        file = tmp_path / f"{name}.toml"
        file.write_text(dump_mission(other))
        assert main(["stand", str(tmp_path / "base.db"), "--mission", str(file), "--out", str(tmp_path / name)]) == code
        said = capsys.readouterr()
        assert ("cannot be told: it has no [origin]" in said.out) == (name == "open")
        assert ("base.db: holds the records of another mission" in said.err) == (name == "moved")
        assert (tmp_path / name).exists() == (code == 0)


def test_stores_are_joined_each_record_once(tmp_path: Path) -> None:
    made = [StoredRecord(vehicle, 7, number, 1, 0.5, b"body") for vehicle in (1, 2) for number in (1, 2, 3)]
    stores = [stored(made[first:last], tmp_path / f"{first}.db") for first, last in ((0, 4), (2, 6))]
    assert sorted(read_stores(stores)) == made
    assert sorted(read_stores([*stores, *stores])) == made


def test_a_record_that_is_signed_in_one_store_is_proven(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plain = StoredRecord(1, 7, 1, 1, 0.5, b"body")
    held = {tmp_path / "a.db": [plain], tmp_path / "b.db": [plain._replace(proven=True)]}
    monkeypatch.setattr(records_module, "read_records", held.__getitem__)
    assert [record.proven for record in read_stores([*held])] == [True]
    assert [record.proven for record in read_stores([*held][::-1])] == [True]
    monkeypatch.setattr(records_module, "MAX_RECORDS", 0)
    with pytest.raises(RecordsError, match="hold more than 0 records"):
        read_stores([*held])


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
