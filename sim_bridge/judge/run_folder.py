"""A flight in its run folder: ground truth in `recording.npz`, compressed; why it ended, and its faults."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from companion.core.model.states import SwarmPhase
from mission.cli.main import EXIT_BAD_FILE
from mission.common.problems import printable
from mission.schema.fault_kinds import FORMS, PARAMETERS
from mission.schema.faults import FaultKind, Lie
from sim_bridge.errors import StartError
from sim_bridge.judge.fault_events import FILE_NAME as FAULTS_NAME
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import with_columns
from sim_bridge.judge.recording import COLUMNS, Recording
from sim_bridge.judge.tick import TOUCHED

MISSION_NAME = "mission.toml"  # as it was flown
FILE_NAME = "recording.npz"
METRICS_NAME = "metrics.json"
STAND_FOLDER = "stand"  # of a flight that surveyed: what `companion stand` makes
STAND_REPORT = f"{STAND_FOLDER}/report.html"
BEACONS_LOST = "beacons_lost"  # its key for the share of beacons that each vehicle lost
FLOWN_BY = "flown_by"  # its key for what flew in place of ours
END_S = "end_s"  # its key for when the mission was over; what was recorded then may be more
BYTES_MAX = 2**30  # unpacked: 50 vehicles for 80 minutes
LARGEST = 1e7  # m, m/s, s: beyond, it is no flight of ours
ENDED_MAX_CHARS = 1000  # "all landed but" 249 ids
LATER = ("touched",)  # arrays that older recordings have not got: zeros
VECTORS = ("pos_ned_m", "vel_ned_mps")


class RunFolderError(StartError):
    """There is no recording of a flight, or it is damaged; the message names the file."""

    def __init__(self, message: str) -> None:
        super().__init__(message, EXIT_BAD_FILE)


def save(recording: Recording, folder: Path) -> Path:
    """Write `recording` into the existing `folder`, over an older one; returns the file. OSError as `write`."""
    path = folder / FILE_NAME
    arrays = {field.name: getattr(recording, field.name) for field in dataclasses.fields(recording)}
    packed = io.BytesIO()  # an archive that fails half-way cannot be closed either
    np.savez_compressed(packed, **arrays)
    write(path, packed.getbuffer())
    return path


def write(path: Path, data: bytes | memoryview) -> None:
    """All of a file of the run folder. OSError that names `path`; then nothing is left of it."""
    try:
        path.write_bytes(data)
    except OSError as error:
        with contextlib.suppress(OSError):
            path.unlink()
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from error


def keep_file(path: Path, data: bytes, say: Callable[[str], None]) -> None:
    """As `write`; that it cannot be written is said, with its name: a flight on a full disk still has its verdict."""
    try:
        write(path, data)
    except OSError as error:
        say(f"{error.filename}: {error.strerror}")


def load(folder: Path) -> Recording:
    """The recording in `folder`. RunFolderError when there is none, or it is damaged."""
    path = folder / FILE_NAME
    if not path.is_file():
        raise RunFolderError(f"{path}: no such file: {folder} must be the folder of a flight")
    try:
        arrays = _arrays(path)
        return _shaped(arrays)
    except (ValueError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError, MemoryError) as error:
        raise RunFolderError(f"{path}: must be the recording of a flight: {error}") from error


def _arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The file's arrays by name, each of the type that it should have. Whatever zipfile and numpy raise."""
    with path.open("rb") as file:  # numpy does not close a damaged archive that it opened itself
        if not zipfile.is_zipfile(file):
            raise ValueError("is no npz archive, or a part of one")
        _check_archive(file)
        file.seek(0)
        with np.load(file, allow_pickle=False) as archive:
            missing = [name for name in COLUMNS if name not in (*archive.files, *LATER)]
            if missing:
                raise ValueError(f"has no {', '.join(missing)}")
            arrays = {name: archive[name] for name in COLUMNS if name in archive.files}
    for name in LATER:
        arrays.setdefault(name, np.zeros(arrays["on_ground"].shape, COLUMNS[name]))
    for name, array in arrays.items():
        if array.dtype != COLUMNS[name]:
            raise ValueError(f"{name} is {array.dtype}: must be {np.dtype(COLUMNS[name])}")
    return arrays


def _check_archive(file: BinaryIO) -> None:
    """ValueError for an archive that `save` did not write, or that unpacks to more than there is memory for."""
    with zipfile.ZipFile(file) as archive:
        members = archive.infolist()
    if any(member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for member in members):
        raise ValueError("is compressed in a way that ours are not: must be deflated")
    size = sum(member.file_size for member in members)
    if size > BYTES_MAX:
        raise ValueError(f"unpacks to {size / 2**20:.0f} MiB: must be at most {BYTES_MAX / 2**20:.0f} MiB")


def _shaped(arrays: dict[str, NDArray[Any]]) -> Recording:
    """The arrays as a recording. ValueError unless their shapes agree."""
    time_s, on_ground = arrays["time_s"], arrays["on_ground"]
    if time_s.shape == (0,) and not any(array.size for array in arrays.values()):
        return with_columns(Recording(**arrays), on_ground.shape[-1])
    ticks, n = time_s.size, on_ground.shape[-1] if on_ground.ndim else 0
    for name, array in arrays.items():
        wanted = (ticks,) if name == "time_s" else (ticks, n, 3) if name in VECTORS else (ticks, n)
        if array.shape != wanted:
            raise ValueError(f"{name} has the shape {array.shape}: must be {wanted} as the other arrays")
    _check_values(arrays, n)
    return Recording(**arrays)


def _check_values(arrays: dict[str, NDArray[Any]], n: int) -> None:
    """ValueError for what no flight has."""
    for name in ("time_s", "range_m", *VECTORS):
        if not (np.abs(arrays[name]) <= LARGEST).all():  # false for NaN
            raise ValueError(f"{name} has a value that is not finite, or beyond {LARGEST:g}")
    if (arrays["range_m"] < 0.0).any():
        raise ValueError(f"range_m has {arrays['range_m'].min():g}: must be at least 0")
    if (np.diff(arrays["time_s"]) < 0.0).any():
        raise ValueError("time_s runs backwards")
    limits = (("phase", -1, max(SwarmPhase)), ("leader", 0, n), ("touched", 0, len(TOUCHED) - 1))
    for name, least, most in limits:
        values = arrays[name]
        if values.size and not least <= values.min() <= values.max() <= most:
            raise ValueError(f"{name} has {values.min()} to {values.max()}: must be {least} to {most}")


def load_faults(folder: Path, n: int | None = None) -> tuple[FaultEvent, ...]:
    """Faults of the flight of `folder`; empty: no fault. RunFolderError for a damaged file.

    `n`: how many vehicles there are, where that is known.
    """
    path = folder / FAULTS_NAME
    if not path.exists():
        return ()
    try:
        rows = _json(path)
        if not isinstance(rows, list):
            raise ValueError(f"is {_shown(rows)}: must be an array")
        tables = [(f"[{index}]", row) for index, row in enumerate(rows)]
        return tuple(_event(row, place, n) for place, row in tables if _get(row, "at_s", place) is not None)
    except ValueError as error:
        raise RunFolderError(f"{path}: must be the faults of a flight: {error}") from None


@dataclass(frozen=True, slots=True)
class End:
    """End of a flight, which the recording does not have."""

    ended: str  # why it was over
    mission_sha256: str | None  # of mission.toml as flown
    by_estimates: str = ""  # what of its positions external autopilots believed, and no simulator told
    flown_by: str = ""  # what was not ours
    end_s: float | None = None  # None: with its recording


def load_end(folder: Path) -> End | None:
    """From metrics.json in `folder`; None where there is none. RunFolderError for a damaged file."""
    path = folder / METRICS_NAME
    if not path.exists():
        return None
    try:
        figures = _json(path)
        ended, sha256 = _get(figures, "ended"), figures.get("mission_sha256")
        by_estimates, flown_by = figures.get("positions_by_estimates", ""), figures.get(FLOWN_BY, "")
        texts = {"ended": ended, "mission_sha256": sha256 or "", "positions_by_estimates": by_estimates}
        texts[FLOWN_BY] = flown_by
        for key, value in texts.items():
            if not isinstance(value, str):
                raise ValueError(f"{key} = {_shown(value)}: must be text")
        believed, flew = [printable(note, ENDED_MAX_CHARS) for note in (by_estimates, flown_by)]
        end_s = _number_or_none({END_S: figures.get(END_S)}, END_S)  # older files have none
        return End(printable(ended, ENDED_MAX_CHARS), sha256, believed, flew, end_s)
    except ValueError as error:
        raise RunFolderError(f"{path}: must be the figures of a flight: {error}") from None


def load_beacons_lost(folder: Path, n: int) -> list[float | None]:
    """Of each of n vehicles the share of beacons that it lost, from metrics.json; None where that does not say so."""
    path = folder / METRICS_NAME
    try:
        shares = _json(path).get(BEACONS_LOST) if path.exists() else None
    except (ValueError, AttributeError):  # `load_end` tells what is wrong there
        shares = None
    if not isinstance(shares, list) or len(shares) != n:
        return [None] * n
    return [share if type(share) in (int, float) and 0.0 <= share <= 1.0 else None for share in shares]


def mission_sha256(text: bytes) -> str:
    """Digest of mission.toml, as metrics.json keeps it."""
    return hashlib.sha256(text).hexdigest()


def _json(path: Path) -> Any:
    """ValueError in words for what is no JSON."""
    if not path.is_file():  # a named pipe would be waited for
        raise ValueError("is a folder" if path.is_dir() else "is no regular file")
    try:
        return json.loads(path.read_bytes())
    except RecursionError:
        raise ValueError("is nested too deep") from None
    except UnicodeDecodeError:
        raise ValueError("is no UTF-8 text") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"line {error.lineno}: is no JSON") from None


def _event(row: Any, place: str, n: int | None) -> FaultEvent:
    """ValueError names the key and what is allowed."""
    kind, vehicles, asked = (_get(row, key, place) for key in ("kind", "vehicles", "asked"))
    if kind not in list(FaultKind):
        raise ValueError(f"{place}.kind = {_shown(kind)}: must be one of {', '.join(FaultKind)}")
    if not isinstance(vehicles, list) or not vehicles or not all(_is_id(k, n) for k in vehicles):
        most = "at least 1" if n is None else f"1 to {n}"
        raise ValueError(f"{place}.vehicles = {_shown(vehicles)}: must be ids, each {most}")
    if not isinstance(asked, str):
        raise ValueError(f"{place}.asked = {_shown(asked)}: must be text")
    at_s, until_s = (_number_or_none(row, key, place) for key in ("at_s", "until_s"))
    assert at_s is not None
    parameters = {name: _parameter(row, name, place) for name in FORMS[kind].parameters}
    lie = row.get("lie")  # older files have none
    if lie is not None and lie not in list(Lie):
        raise ValueError(f"{place}.lie = {_shown(lie)}: must be one of {', '.join(Lie)}, or null")
    return FaultEvent(
        FaultKind(kind), tuple(vehicles), at_s, until_s, asked, lie=None if lie is None else Lie(lie), **parameters
    )


def _parameter(row: Any, name: str, place: str) -> Any:
    """A number of a fault, or its east and north."""
    form = PARAMETERS[name]
    reported = _get(row, name, place)
    numbers = reported if form.level else [reported]
    if (
        not isinstance(numbers, list)
        or len(numbers) != form.count
        or not all(type(value) in (int, float) and form.allows(value) for value in numbers)
    ):
        what = "two numbers" if form.level else "a number"
        raise ValueError(f"{place}.{name} = {_shown(reported)}: must be {what}, {form.least:g} to {form.most:g}")
    return (float(numbers[0]), float(numbers[1])) if form.level else float(numbers[0])


def _is_id(value: Any, n: int | None) -> bool:
    return type(value) is int and value >= 1 and (n is None or value <= n)


def _number_or_none(row: dict[str, Any], key: str, place: str = "") -> float | None:
    value = _get(row, key, place)
    if value is None:
        return None
    if type(value) not in (int, float) or not abs(value) <= LARGEST:  # false for NaN
        name = f"{place}.{key}".lstrip(".")
        raise ValueError(f"{name} = {_shown(value)}: must be a number, at most {LARGEST:g}, or null")
    return float(value)


def _get(table: Any, key: str, place: str = "") -> Any:
    if not isinstance(table, dict):
        raise ValueError(f"{place} is {_shown(table)}: must be an object".lstrip())
    if key not in table:
        raise ValueError(f"{place} has no {key}".lstrip())
    return table[key]


def _shown(value: Any) -> str:
    """As JSON, shortened."""
    try:
        return printable(json.dumps(value))
    except RecursionError:
        return "nested too deep"
