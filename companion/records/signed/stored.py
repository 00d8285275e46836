"""Signatures in a store: a column of its records. What nobody has signed is set apart, in a table of its own."""

from __future__ import annotations

import sqlite3
from typing import Final

from companion.records.record import LogKey, Record, RecordKind
from companion.records.signed.keys import RecordKeys

_TABLES: Final = """
CREATE TABLE IF NOT EXISTS unproven (
  vehicle_id INTEGER NOT NULL, log_id INTEGER NOT NULL, number INTEGER NOT NULL,
  kind INTEGER NOT NULL, made_s REAL NOT NULL, body BLOB NOT NULL,
  PRIMARY KEY (vehicle_id, log_id, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS writer (vehicle_id INTEGER PRIMARY KEY, public_key BLOB NOT NULL);
"""
_ACKED_BY_KEY: Final = "acked_by_key"  # in `meta`, 1: `acked` is the base station's signed word


def prepare(database: sqlite3.Connection, keys: RecordKeys, own_log: LogKey) -> int:
    """In a transaction: makes a store one of signed records; the number of those that were set apart.

    The own log, which nobody else writes, is signed where it is not, as of a flight without keys. A record of another
    counts by the key that its writer has now, or had last; acknowledgements by whoever said so count no more.
    """
    if "signature" not in {row[1] for row in database.execute("PRAGMA table_info(record)")}:
        database.execute("ALTER TABLE record ADD COLUMN signature BLOB")
    for statement in _TABLES.split(";"):
        database.execute(statement)
    known = dict(database.execute("SELECT vehicle_id, public_key FROM writer"))
    for vehicle_id, verifier in keys.verifiers.items():
        if known.get(vehicle_id, verifier.public) != verifier.public:  # another fleet's: what it signed proves nothing
            database.execute("UPDATE record SET signature = NULL WHERE vehicle_id = ?", (vehicle_id,))
        database.execute("INSERT OR REPLACE INTO writer VALUES (?, ?)", (vehicle_id, verifier.public))
    sign_log(database, keys, own_log)
    moved = database.execute(
        "INSERT OR REPLACE INTO unproven SELECT vehicle_id, log_id, number, kind, made_s, body FROM record "
        "WHERE signature IS NULL"
    ).rowcount
    database.execute("DELETE FROM record WHERE signature IS NULL")
    if database.execute("SELECT value FROM meta WHERE name = ?", (_ACKED_BY_KEY,)).fetchone() != (1,):
        database.execute("UPDATE log SET acked = 0")
        database.execute("INSERT OR REPLACE INTO meta VALUES (?, 1)", (_ACKED_BY_KEY,))
    return moved


def forget_keys(database: sqlite3.Connection) -> None:
    """In a transaction: the store is used without keys; what is acknowledged from now on is anybody's word."""
    database.execute("UPDATE meta SET value = 0 WHERE name = ?", (_ACKED_BY_KEY,))


def sign_log(database: sqlite3.Connection, keys: RecordKeys, log: LogKey) -> None:
    """In a transaction: signs what is not signed of an own log."""
    rows = database.execute(
        "SELECT number, kind, made_s, body FROM record WHERE vehicle_id = ? AND log_id = ? AND signature IS NULL",
        tuple(log),
    ).fetchall()
    signed = (
        keys.sign(Record(*log, number, RecordKind(kind), made_s, bytes(body))) for number, kind, made_s, body in rows
    )
    database.executemany(
        "UPDATE record SET signature = ? WHERE vehicle_id = ? AND log_id = ? AND number = ?",
        ((record.signature, *log, record.number) for record in signed),
    )
