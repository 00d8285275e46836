"""The file of a store: told from any other before SQLite touches it, opened, set aside; what is not ours is left."""

from __future__ import annotations

import contextlib
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final

APPLICATION_ID: Final = int.from_bytes(b"Urec", "big")  # of the file's header: https://sqlite.org/fileformat2.html
TABLES: Final = frozenset({"meta", "record", "log"})
HEADER_BYTES: Final = 100
_MAGIC: Final = b"SQLite format 3\0"
_ID_AT: Final = slice(68, 72)
_WAL_MAGIC: Final = frozenset({b"\x37\x7f\x06\x82", b"\x37\x7f\x06\x83"})


def foreign_reason(path: Path) -> str:
    """Reason why the file is not to be touched; "": it is new, empty, or a store of records, damaged or not.

    OSError and sqlite3.Error where it cannot be read.
    """
    if not path.exists():
        return ""
    if not path.is_file():
        return "is no file"
    with path.open("rb") as file:
        header = file.read(HEADER_BYTES)
    application_id = int.from_bytes(header[_ID_AT], "big")
    if not header or application_id == APPLICATION_ID:
        return ""
    if not header.startswith(_MAGIC):
        return "" if _has_wal(path) else "is no store of records, and no database"
    if application_id:
        return f"is another program's database (application_id 0x{application_id:08x})"
    return _foreign_tables(path)


def _foreign_tables(path: Path) -> str:
    """As `foreign_reason`, of a database without an application_id: stores had none at first."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            rows = database.execute("SELECT name FROM sqlite_schema WHERE type = 'table' ORDER BY name").fetchall()
    except sqlite3.DatabaseError as error:
        if getattr(error, "sqlite_errorcode", 0) & 0xFF not in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise
        return "" if _has_wal(path) else "is a damaged database, not known to be a store of records"
    found = {name for (name,) in rows}
    if not found or found == TABLES:
        return ""
    return f"is a database of something else (table {min(found - TABLES, default=min(found))})"


def _has_wal(path: Path) -> bool:
    """SQLite's log lies beside it: whatever the file looks like now, it was a database in use."""
    try:
        with path.with_name(f"{path.name}-wal").open("rb") as file:
            return file.read(4) in _WAL_MAGIC
    except FileNotFoundError:
        return False


def set_aside(path: Path) -> str:
    """Renames a damaged file, and what belongs to it: somebody may save what is in it."""
    for count in range(1, 100):
        aside = path.with_name(f"{path.name}.damaged-{count}")
        if not aside.exists():
            break
    path.rename(aside)
    for ending in ("-wal", "-shm"):
        with contextlib.suppress(FileNotFoundError):
            path.with_name(path.name + ending).rename(aside.with_name(aside.name + ending))
    return aside.name


def connect(path: Path | str, is_synced: bool) -> sqlite3.Connection:
    """A connection to a store. sqlite3.Error."""
    connection = sqlite3.connect(path, timeout=1.0, isolation_level=None, check_same_thread=False)
    connection.execute(f"PRAGMA synchronous = {'FULL' if is_synced else 'OFF'}")
    if connection.execute("PRAGMA application_id").fetchone() != (APPLICATION_ID,):
        connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")  # in the file itself, before there is a WAL
    connection.execute("PRAGMA journal_mode = WAL")
    return connection
