"""Records of a survey: read from a store's file, and decoded; each once, in an order that is not that of arrival."""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple, Protocol

from companion.payload.sample import PAYLOAD_KIND, PayloadSample, decode_sample
from companion.records.signed.keys import mission_hash
from companion.survey.observation import STEM_KIND, StemObservation, decode
from companion.survey.track import TRACK_KIND, TrackPoint, decode_track
from mission.document.model import Mission

MAX_RECORDS: Final = 250_000  # 12 vehicles for an hour: 21,600 of the track, and 19 observations of each of 5,000 stems
ASTRAY_M: Final = 3_000.0  # from the median of all positions: no swarm surveys so far apart
TABLES: Final = frozenset({"meta", "record", "log", "unproven", "writer"})  # of a store
RESTART_S: Final = 5.0  # made so much before an earlier number of its log: the writer's clock has started anew
Key = tuple[int, int, int]  # vehicle_id, log_id, number
Session = tuple[int, int, int]  # vehicle_id, log_id, how often the clock had started anew
Placed = StemObservation | TrackPoint | PayloadSample


class RecordLike(Protocol):
    """A record, by whatever class: identity, kind, time and body."""

    @property
    def vehicle_id(self) -> int: ...
    @property
    def log_id(self) -> int: ...
    @property
    def number(self) -> int: ...
    @property
    def kind(self) -> int: ...
    @property
    def made_s(self) -> float: ...
    @property
    def body(self) -> bytes: ...
    @property
    def proven(self) -> bool: ...


class StoredRecord(NamedTuple):
    """A row of a store's table `record`."""

    vehicle_id: int
    log_id: int
    number: int
    kind: int
    made_s: float
    body: bytes
    proven: bool = False  # signed by its writer: the store has taken it for that alone


class KeyedObservation(NamedTuple):
    """An observation, and the identity of its record."""

    key: Key
    observation: StemObservation
    session: Session  # within it times compare


class KeyedPoint(NamedTuple):
    """A point of a track, and the identity of its record."""

    key: Key
    point: TrackPoint
    session: Session


class KeyedSample(NamedTuple):
    """A value of another sensor, the identity of its record, and when that was made."""

    key: Key
    sample: PayloadSample
    session: Session
    made_s: float


class LogCount(NamedTuple):
    """Records of one log that are here, of those that its highest number says there are at least."""

    vehicle_id: int
    log_id: int
    records: int
    at_least: int
    proven: int  # of `records`, those that their writer has signed

    @property
    def missing(self) -> int:
        """Numbers below the highest that are not here."""
        return self.at_least - self.records


class Harvest(NamedTuple):
    """A survey's records: sorted, each once."""

    observations: tuple[KeyedObservation, ...]
    track: tuple[KeyedPoint, ...]
    refused: int  # records of these kinds whose body is malformed, or whose position is none of this survey
    records: tuple[RecordLike, ...]  # all, of whatever kind
    payload: tuple[KeyedSample, ...] = ()

    def counted(self) -> tuple[LogCount, ...]:
        """Of each log, by vehicle: numbers start at 1 and have no gap, so one that is not here is missing."""
        found: dict[tuple[int, int], LogCount] = {}
        for r in self.records:  # sorted
            before = found.get((r.vehicle_id, r.log_id))
            here = 1 if before is None else before.records + 1
            proven = r.proven + (0 if before is None else before.proven)
            found[r.vehicle_id, r.log_id] = LogCount(r.vehicle_id, r.log_id, here, max(here, r.number), proven)
        return tuple(found.values())

    def unproven_line(self) -> str | None:
        """Line for people where some are signed and some not; None: all are, or none, as in a swarm without keys."""
        unproven = sum(not r.proven for r in self.records)
        if unproven in (0, len(self.records)):
            return None
        return f"{unproven} of {len(self.records)} records are signed by nobody"

    def missing_line(self) -> str | None:
        """Line for people on records that are missing; None: none that is known of."""
        logs = self.counted()
        missing = sum(log.missing for log in logs)
        if not missing:
            return None
        vehicles = sorted({log.vehicle_id for log in logs if log.missing})
        who = f"vehicle{'s' * (len(vehicles) > 1)} {', '.join(map(str, vehicles))}"
        return f"{missing} of at least {sum(log.at_least for log in logs)} records are missing, of {who}"


class RecordsError(Exception):
    """A file that holds no records; the message names it."""


def check_mission(path: Path, mission: Mission) -> str:
    """Check that a store holds the records of this mission (RecordsError); the doubt that is left, in words, or "".

    A mission without an origin may have been flown with one, as the simulator does.
    """
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            found = database.execute("SELECT value FROM meta WHERE name = 'mission_hash'").fetchone()
    except sqlite3.Error:
        return ""  # as it was before stores had one
    if found is None or found[0] == mission_hash(mission):
        return ""
    if mission.origin is None:
        return (
            "whether these are records of this mission cannot be told: it has no [origin], and they were made with one"
        )
    raise RecordsError(
        f"{path}: holds the records of another mission: the name, or [origin], of this one ({mission.name!r}) differs"
    )


def read_records(path: Path) -> list[StoredRecord]:
    """All records of the store in `path`. RecordsError: it cannot be read."""
    if not path.is_file():
        raise RecordsError(f"{path}: no such file")
    foreign = ""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
            columns = {row[1] for row in database.execute("PRAGMA table_info(record)")}
            proven = "signature IS NOT NULL" if "signature" in columns else "0"
            rows = database.execute(
                f"SELECT vehicle_id, log_id, number, kind, made_s, body, {proven} FROM record LIMIT ?",
                (MAX_RECORDS + 1,),
            ).fetchall()
            if not rows:  # a database of something else, in which a base station once looked
                names = {
                    str(name) for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
                }
                foreign = min((n for n in names - TABLES if not n.startswith("sqlite_")), default="")
    except sqlite3.Error as error:
        raise RecordsError(f"{path}: cannot be read as a store of records: {error}") from None
    if foreign:
        raise RecordsError(f"{path}: no store of records: it holds none, and the table {foreign}")
    if len(rows) > MAX_RECORDS:
        raise RecordsError(f"{path}: holds more than {MAX_RECORDS} records")
    found = [StoredRecord._make((*row[:6], row[6] == 1)) for row in rows]
    for record in found:
        is_whole = all(isinstance(field, int) for field in record[:4]) and isinstance(record.made_s, int | float)
        if not (is_whole and isinstance(record.body, bytes)):
            raise RecordsError(f"{path}: record {record[:3]} is no record")
    return found


def read_stores(paths: Sequence[Path]) -> list[StoredRecord]:
    """The records of several stores, each once; of two that are alike the one that its writer has signed."""
    found: dict[Key, StoredRecord] = {}
    for path in paths:
        for record in read_records(path):
            key = (record.vehicle_id, record.log_id, record.number)
            if key not in found or record.proven:
                found[key] = record
    if len(found) > MAX_RECORDS:
        raise RecordsError(f"{', '.join(map(str, paths))}: hold more than {MAX_RECORDS} records")
    return list(found.values())


def count_set_apart(path: Path) -> int:
    """Records of the store in `path` that nobody has signed, and that it keeps apart since it has keys."""
    with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as database:
        try:
            (count,) = database.execute("SELECT count(*) FROM unproven").fetchone()
        except sqlite3.Error:  # of a swarm without keys
            return 0
    return int(count)


def harvest_of(records: Iterable[RecordLike]) -> Harvest:
    """`records` decoded; any order and any duplicates give the same."""
    unique = {(record.vehicle_id, record.log_id, record.number): record for record in records}
    sessions = _sessions(unique)
    observations, points, samples, refused = [], [], [], 0
    for key in sorted(unique):
        record = unique[key]
        if record.kind == STEM_KIND:
            stem = decode(record.body, record.vehicle_id)
            if stem is not None:
                observations.append(KeyedObservation(key, stem, sessions[key]))
            refused += stem is None
        elif record.kind == TRACK_KIND:
            point = decode_track(record.body, record.vehicle_id)
            if point is not None:
                points.append(KeyedPoint(key, point, sessions[key]))
            refused += point is None
        elif record.kind == PAYLOAD_KIND:
            sample = decode_sample(record.body, record.vehicle_id)
            if sample is not None:
                samples.append(KeyedSample(key, sample, sessions[key], record.made_s))
            refused += sample is None
    measured: list[Placed] = [*(o.observation for o in observations), *(p.point for p in points)]
    near = _near_median(measured or [s.sample for s in samples])
    kept = tuple(o for o in observations if near(o.observation))
    way = tuple(p for p in points if near(p.point))
    payload = tuple(s for s in samples if near(s.sample))
    refused += len(observations) - len(kept) + len(points) - len(way) + len(samples) - len(payload)
    return Harvest(kept, way, refused, tuple(unique[key] for key in sorted(unique)), payload)


def _sessions(unique: Mapping[Key, RecordLike]) -> dict[Key, Session]:
    """Of each record. A log outlives a flight and a reboot, its writer's clock does not: it starts at 0 again."""
    found: dict[Key, Session] = {}
    session, latest_s = (-1, -1, 0), -math.inf
    for key in sorted(unique):
        made_s = unique[key].made_s
        if key[:2] != session[:2]:
            session, latest_s = (*key[:2], 0), made_s
        elif made_s < latest_s - RESTART_S:
            session, latest_s = (*key[:2], session[2] + 1), made_s
        latest_s = max(latest_s, made_s)
        found[key] = session
    return found


def _near_median(places: Sequence[Placed]) -> Callable[[Placed], bool]:
    """Tells those that are not astray: one wild position would be most of the map."""
    if not places:
        return lambda _: True
    north_m, east_m = median(p.north_m for p in places), median(p.east_m for p in places)
    return lambda p: math.hypot(p.north_m - north_m, p.east_m - east_m) <= ASTRAY_M
