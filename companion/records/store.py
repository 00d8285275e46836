"""Records on one disk: an SQLite file in WAL mode, `synchronous=FULL`. What `write` has returned survives a power cut.

(`synchronous=NORMAL` would lose the last commits at a power cut: https://sqlite.org/pragma.html#pragma_synchronous.)
The primary key makes duplicates impossible, and what is there is never overwritten.
"""

from __future__ import annotations

import contextlib
import errno
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final

from companion.records.holdings import Holding
from companion.records.record import BASE_ID, Draft, LogKey, Record, RecordKind
from companion.records.signed import stored
from companion.records.signed.keys import RecordKeys
from companion.records.store_file import connect, foreign_reason, set_aside

RECORDS_MAX: Final = 200_000  # of a vehicle: two days of eight vehicles at one record in 7 s; about 60 MB
BASE_RECORDS_MAX: Final = 5_000_000  # of the base station: about 1.5 GB
ROOM: Final = 256  # records more than are needed that go with them, so that not each write has to make room
FORMAT: Final = 1  # of the file
MEMORY: Final = ":memory:"  # for a path: a store that is gone with the process
SAID_CHARS: Final = 60  # of SQLite's reason
ENVIRONMENT: Final = frozenset(  # of its errors, those that say nothing of the file
    {
        sqlite3.SQLITE_AUTH,
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_FULL,
        sqlite3.SQLITE_IOERR,
        sqlite3.SQLITE_LOCKED,
        sqlite3.SQLITE_NOMEM,
        sqlite3.SQLITE_PERM,
        sqlite3.SQLITE_READONLY,
    }
)
_TABLES: Final = """
CREATE TABLE IF NOT EXISTS meta (name TEXT PRIMARY KEY, value) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS record (
  vehicle_id INTEGER NOT NULL, log_id INTEGER NOT NULL, number INTEGER NOT NULL,
  kind INTEGER NOT NULL, made_s REAL NOT NULL, body BLOB NOT NULL,
  PRIMARY KEY (vehicle_id, log_id, number)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS log (
  vehicle_id INTEGER NOT NULL, log_id INTEGER NOT NULL, given_up INTEGER NOT NULL, acked INTEGER NOT NULL,
  PRIMARY KEY (vehicle_id, log_id)) WITHOUT ROWID;
"""
_INSERT: Final = (
    "INSERT OR IGNORE INTO record (vehicle_id, log_id, number, kind, made_s, body{}) VALUES (?, ?, ?, ?, ?, ?{})"
)
_ACK: Final = "INSERT INTO log VALUES (?1, ?2, 0, ?3) ON CONFLICT (vehicle_id, log_id) DO UPDATE SET acked = ?3"
_GIVE_UP: Final = (
    "INSERT INTO log VALUES (?1, ?2, ?3, 0) ON CONFLICT (vehicle_id, log_id) DO UPDATE SET given_up = max(given_up, ?3)"
)
_DELIVERED: Final = (
    "SELECT vehicle_id, log_id, number FROM record JOIN log USING (vehicle_id, log_id) WHERE number <= acked "
    "ORDER BY vehicle_id = ?, number LIMIT ?"
)
_OTHERS: Final = (
    "SELECT vehicle_id, log_id, number FROM record WHERE (vehicle_id, log_id) <> (?, ?) ORDER BY number LIMIT ?"
)


class StoreError(Exception):
    """A file that cannot be opened, read or written; the message says why, in a few words."""

    def __init__(self, why: str, *, is_damaged: bool = False, is_foreign: bool = False) -> None:
        """`is_damaged`: another file in its place would do. `is_foreign`: it is no store of this node and mission."""
        super().__init__(why)
        self.is_damaged = is_damaged
        self.is_foreign = is_foreign


@dataclass(frozen=True, slots=True)
class Batch:
    """Changes that are written at once: all of them are on the disk then, or none."""

    own: Sequence[Draft] = ()
    others: Sequence[Record] = ()
    acked: Mapping[LogKey, int] = field(default_factory=dict)  # what the base station has, where that has changed
    epoch: int = 0  # of the base station's file; another than before: all that was acknowledged is forgotten
    given_up: Mapping[LogKey, int] = field(default_factory=dict)
    begins_log: bool = False  # the own log goes on in a new one, with what this process has written of it


@dataclass(frozen=True, slots=True)
class Written:
    """Outcome of a batch."""

    own_log: LogKey
    own: Sequence[Record] = ()  # with their numbers, as in the batch
    others: Sequence[Record] = ()  # those for which there was room
    given_up: Mapping[LogKey, int] = field(default_factory=dict)  # what made room, too
    refused: int = 0  # own ones for which there was none
    moved: int = 0  # own ones that were numbered anew, in a log that was begun


class RecordStore:
    """One node's file. `write` may be called from another thread than the rest, one thread alone."""

    def __init__(
        self,
        path: Path | str,
        me: int,
        draw: Callable[[], int],
        *,
        records_max: int | None = None,
        is_synced: bool = True,
        mission_hash: int | None = None,
        keys: RecordKeys | None = None,
    ) -> None:
        """`draw`: a random uint32. StoreError for a file that cannot be opened, is damaged, or is no store.

        `is_synced` False: of a vehicle that is simulated, as this computer's own power is not at stake.
        `mission_hash`: of the mission whose records alone belong here; None: of any, to read them.
        `keys`: of a swarm with keys: own records are signed, and what nobody has signed is set apart.
        """
        self.set_apart = 0  # records that are no more among the others
        self._keys = keys
        self._insert = _INSERT.format(", signature", ", ?") if keys else _INSERT.format("", "")
        self._me = me
        self._draw = draw
        self._mission_hash = mission_hash
        self._keeps_all = me == BASE_ID
        self._max = records_max or (BASE_RECORDS_MAX if self._keeps_all else RECORDS_MAX)
        with contextlib.ExitStack() as opened:
            try:
                why = "" if path == MEMORY else foreign_reason(Path(path))
                if why:
                    raise StoreError(why, is_foreign=True)
                self._writing = opened.enter_context(contextlib.closing(connect(path, is_synced)))
                self._reading = self._writing
                if path != MEMORY:
                    self._reading = opened.enter_context(contextlib.closing(connect(path, is_synced)))
                self._prepare()
            except (ValueError, TypeError) as error:  # numbers that are none
                raise StoreError("damaged", is_damaged=True) from error
            except (sqlite3.Error, OSError) as error:
                raise StoreError(_reason(error), is_damaged=_is_damage(error)) from error
            opened.pop_all()

    def _prepare(self) -> None:
        with self._transaction():
            for statement in _TABLES.split(";"):
                self._writing.execute(statement)
            version = self._meta("format", FORMAT)
            if version != FORMAT:
                raise StoreError(f"is of format {version}, not {FORMAT}", is_foreign=True)
            me = self._meta("vehicle_id", self._me)
            if me != self._me:
                raise StoreError(f"holds the records of vehicle {me}, not {self._me}", is_foreign=True)
            mission_hash = self._mission_hash
            if mission_hash is not None and self._meta("mission_hash", mission_hash) != mission_hash:
                raise StoreError("holds the records of another mission", is_foreign=True)
            self.own_log = LogKey(self._me, self._meta("own_log", self._draw()))
            if self._keys is None:
                stored.forget_keys(self._writing)
            else:
                self.set_apart = stored.prepare(self._writing, self._keys, self.own_log)
        if self._writing.execute("PRAGMA quick_check(1)").fetchone() != ("ok",):
            raise ValueError("damaged")
        self.holdings(), self.acked()  # can be read
        self._last = self._opened_last = self._last_of(self.own_log)
        self._count: int = self._writing.execute("SELECT count(*) FROM record").fetchone()[0]

    @property
    def base_epoch(self) -> int:
        """Of the base station's file that `acked` is about; 0: none."""
        found = self._reading.execute("SELECT value FROM meta WHERE name = 'base_epoch'").fetchone()
        return 0 if found is None else int(found[0])

    def count_start(self) -> int:
        """Count of the times that the file was opened to be used, with this one."""
        with self._transaction():
            count = self._meta("starts", 0) + 1
            self._writing.execute("UPDATE meta SET value = ? WHERE name = 'starts'", (count,))
        return count

    def made(self, epoch_s: int) -> int:
        """Time at which this file was made: `epoch_s` where it is new. Of the base station."""
        with self._transaction():
            return int(self._meta("made_s", epoch_s))

    def holdings(self) -> dict[LogKey, Holding]:
        """The numbers that are here, log by log; the own log is always among them."""
        rows = self._reading.execute("SELECT vehicle_id, log_id, given_up FROM log")
        found = {LogKey(vehicle_id, log_id): Holding(given_up) for vehicle_id, log_id, given_up in rows}
        for vehicle_id, log_id, number in self._reading.execute(
            "SELECT vehicle_id, log_id, number FROM record ORDER BY vehicle_id, log_id, number"
        ):
            found.setdefault(LogKey(vehicle_id, log_id), Holding()).add(number)
        if not self._keeps_all:
            found.setdefault(self.own_log, Holding())
        return found

    def acked(self) -> dict[LogKey, int]:
        """Up to which number the base station has all, log by log."""
        rows = self._reading.execute("SELECT vehicle_id, log_id, acked FROM log WHERE acked > 0")
        return {LogKey(vehicle_id, log_id): acked for vehicle_id, log_id, acked in rows}

    def find_record(self, key: LogKey, number: int) -> Record | None:
        """One record; None: it is not here (any more), or cannot be read."""
        try:
            row = self._reading.execute(
                f"SELECT kind, made_s, body, {'signature' if self._keys else 'NULL'} FROM record "
                "WHERE vehicle_id = ? AND log_id = ? AND number = ?",
                (*key, number),
            ).fetchone()
            if row is None:
                return None
            return Record(*key, number, RecordKind(row[0]), float(row[1]), bytes(row[2]), bytes(row[3] or b""))
        except (sqlite3.Error, ValueError, TypeError):
            return None

    def records(self, kind: RecordKind) -> Iterator[tuple[int, int, float, bytes]]:
        """All of one kind, log by log, in the order of their numbers: vehicle, number, when it was made, body."""
        yield from self._reading.execute(
            "SELECT vehicle_id, number, made_s, body FROM record WHERE kind = ? ORDER BY vehicle_id, log_id, number",
            (int(kind),),
        )

    def rows(self) -> list[tuple[int, int, int, int, float, bytes]]:
        """All records: vehicle, log, number, kind, when it was made, body."""
        chosen = "SELECT vehicle_id, log_id, number, kind, made_s, body FROM record ORDER BY vehicle_id, log_id, number"
        return self._reading.execute(chosen).fetchall()

    def write(self, batch: Batch) -> Written:
        """Put a batch on the disk; returns when it is there. StoreError: nothing has changed, as on a full disk."""
        before = self.own_log, self._last, self._opened_last, self._count
        try:
            with self._transaction():
                return self._write(batch)
        except (sqlite3.Error, OSError, ValueError, TypeError) as error:
            self.own_log, self._last, self._opened_last, self._count = before
            raise StoreError(_reason(error)) from error

    def _write(self, batch: Batch) -> Written:
        moved = self._begin_log() if batch.begins_log else 0
        if batch.epoch:
            self._note_epoch(batch.epoch)
        self._writing.executemany(_ACK, [(*key, number) for key, number in batch.acked.items()])
        self._writing.executemany(_GIVE_UP, [(*key, number) for key, number in batch.given_up.items()])
        given_up = dict(batch.given_up)
        room = self._make_room(len(batch.own), len(batch.others), given_up)
        own = [
            Record(*self.own_log, self._last + k, draft.kind, draft.made_s, draft.body)
            for k, draft in enumerate(batch.own[:room], start=1)
        ]
        if self._keys is not None:
            own = [self._keys.sign(record) for record in own]
        others = batch.others[: max(0, room - len(own))]
        before = self._writing.total_changes
        self._writing.executemany(self._insert, [self._row(record) for record in (*own, *others)])
        self._count += self._writing.total_changes - before
        self._last += len(own)
        return Written(self.own_log, own, others, given_up, len(batch.own) - len(own), moved)

    def _begin_log(self) -> int:
        """Another own log; what this process has written of the old one, and nobody has seen, goes over to it."""
        old, first = self.own_log, self._opened_last
        self.own_log = LogKey(self._me, self._draw())
        moved = self._writing.execute(
            "UPDATE record SET log_id = ?, number = number - ? WHERE vehicle_id = ? AND log_id = ? AND number > ?",
            (self.own_log.log_id, first, *old, first),
        ).rowcount
        if self._keys is not None:  # which number it has is signed, too
            self._writing.execute(
                "UPDATE record SET signature = NULL WHERE (vehicle_id, log_id) = (?, ?)", self.own_log
            )
            stored.sign_log(self._writing, self._keys, self.own_log)
        self._writing.execute("UPDATE meta SET value = ? WHERE name = 'own_log'", (self.own_log.log_id,))
        self._last, self._opened_last = moved, 0
        return moved

    def _note_epoch(self, epoch: int) -> None:
        if self._meta("base_epoch", 0) != epoch:
            self._writing.execute("UPDATE meta SET value = ? WHERE name = 'base_epoch'", (epoch,))
            self._writing.execute("UPDATE log SET acked = 0")

    def _make_room(self, own: int, others: int, given_up: dict[LogKey, int]) -> int:
        """Deletes what may go; the number of records that there is room for then.

        First what the base station has; then, for own records alone, copies of others'. Nothing else ever.
        """
        lacking = self._count + own + others - self._max
        if lacking > 0 and not self._keeps_all:
            lacking -= self._delete(_DELIVERED, (self._me, lacking + ROOM), given_up)
            lacking = min(lacking, self._count + own - self._max)
            if lacking > 0:
                self._delete(_OTHERS, (*self.own_log, lacking + ROOM), given_up)
        return max(0, self._max - self._count)

    def _delete(self, chosen: str, arguments: tuple[int, ...], given_up: dict[LogKey, int]) -> int:
        rows = self._writing.execute(chosen, arguments).fetchall()
        self._writing.executemany("DELETE FROM record WHERE (vehicle_id, log_id, number) = (?, ?, ?)", rows)
        for vehicle_id, log_id, number in rows:
            key = LogKey(vehicle_id, log_id)
            given_up[key] = max(given_up.get(key, 0), number)
        self._writing.executemany(_GIVE_UP, [(*key, number) for key, number in given_up.items()])
        self._count -= len(rows)
        return len(rows)

    def close(self) -> None:
        """Let go of the file; never raises."""
        for connection in (self._reading, self._writing):
            with contextlib.suppress(sqlite3.Error):
                connection.close()

    def _last_of(self, key: LogKey) -> int:
        """The number of the last record that this log was ever given here."""
        row = self._writing.execute(
            "SELECT max(number) FROM record WHERE vehicle_id = ?1 AND log_id = ?2 "
            "UNION SELECT given_up FROM log WHERE vehicle_id = ?1 AND log_id = ?2",
            tuple(key),
        ).fetchall()
        return max((number for (number,) in row if number is not None), default=0)

    def _meta(self, name: str, default: int) -> int:
        """A number that is kept; `default` is, where there is none."""
        self._writing.execute("INSERT OR IGNORE INTO meta VALUES (?, ?)", (name, default))
        return int(self._writing.execute("SELECT value FROM meta WHERE name = ?", (name,)).fetchone()[0])

    def _row(self, record: Record) -> tuple[object, ...]:
        named = (record.vehicle_id, record.log_id, record.number, int(record.kind), record.made_s, record.body)
        return named if self._keys is None else (*named, record.signature)

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._writing.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._writing.execute("COMMIT")
        except BaseException:
            with contextlib.suppress(sqlite3.Error):
                self._writing.execute("ROLLBACK")
            raise


def open_store(
    path: Path,
    me: int,
    draw: Callable[[], int],
    *,
    is_synced: bool = True,
    mission_hash: int | None = None,
    keys: RecordKeys | None = None,
) -> tuple[RecordStore, str]:
    """The store in `path`, and a line where a file, or records, were set aside. StoreError where there can be none."""
    open_it = partial(RecordStore, path, me, draw, is_synced=is_synced, mission_hash=mission_hash, keys=keys)
    try:
        store = open_it()
        return store, f"{store.set_apart} that nobody has signed: set apart" if store.set_apart else ""
    except StoreError as error:
        if not error.is_damaged:
            raise
    try:
        aside = set_aside(path)
        return open_it(), f"{path.name} was damaged: set aside as {aside}"
    except OSError as error:
        raise StoreError(_reason(error)) from error


def _is_damage(error: Exception) -> bool:
    """SQLite found the file wrong, and not that it cannot be reached, or written to."""
    code = getattr(error, "sqlite_errorcode", None)
    return code is not None and code & 0xFF not in ENVIRONMENT


def _reason(error: Exception) -> str:
    code = getattr(error, "sqlite_errorcode", None)
    if (code is not None and code & 0xFF == sqlite3.SQLITE_FULL) or getattr(error, "errno", None) == errno.ENOSPC:
        return "disk full"
    text = (isinstance(error, OSError) and error.strerror) or str(error)
    return text[:SAID_CHARS]
