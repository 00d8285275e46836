"""The ground truth of a flight in its run folder: `recording.npz`, compressed."""

from __future__ import annotations

import dataclasses
import json
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from companion.core.types import SwarmPhase
from mission.cli import EXIT_BAD_FILE
from mission.faults import FaultKind
from sim_bridge.faults import FILE_NAME as FAULTS_NAME
from sim_bridge.faults import Struck
from sim_bridge.metrics import with_columns
from sim_bridge.ports import StartError
from sim_bridge.recording import COLUMNS, Recording

FILE_NAME = "recording.npz"
BYTES_MAX = 2**30  # unpacked: 50 vehicles for 80 minutes
LARGEST = 1e7  # m, m/s, s: beyond, it is no flight of ours, and a picture of it cannot be drawn
VECTORS = ("pos_ned_m", "vel_ned_mps")


class RunFolderError(StartError):
    """There is no recording of a flight, or it is damaged; the message names the file."""

    def __init__(self, message: str) -> None:
        super().__init__(message, EXIT_BAD_FILE)


def save(recording: Recording, folder: Path) -> Path:
    """Write `recording` into the existing `folder`, over an older one; returns the file. OSError as the file system."""
    path = folder / FILE_NAME
    arrays = {field.name: getattr(recording, field.name) for field in dataclasses.fields(recording)}
    np.savez_compressed(path, **arrays)
    return path


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
            missing = [name for name in COLUMNS if name not in archive.files]
            if missing:
                raise ValueError(f"has no {', '.join(missing)}")
            arrays = {name: archive[name] for name in COLUMNS}
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
    if (np.diff(arrays["time_s"]) < 0.0).any():
        raise ValueError("time_s runs backwards")
    for name, least, most in (("phase", -1, max(SwarmPhase)), ("leader", 0, n)):
        values = arrays[name]
        if values.size and not least <= values.min() <= values.max() <= most:
            raise ValueError(f"{name} has {values.min()} to {values.max()}: must be {least} to {most}")


def load_faults(folder: Path) -> tuple[Struck, ...]:
    """What happened in the flight of `folder`; empty: no fault. RunFolderError for a damaged file."""
    path = folder / FAULTS_NAME
    if not path.exists():
        return ()
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        return tuple(_struck(row) for row in rows if row["at_s"] is not None)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise RunFolderError(f"{path}: must be the faults of a flight: {error!r}") from None


def _struck(row: Mapping[str, Any]) -> Struck:
    vehicles = tuple(int(k) for k in row["vehicles"])
    until_s, late_s = (None if row[key] is None else float(row[key]) for key in ("until_s", "late_s"))
    struck = Struck(FaultKind(row["kind"]), vehicles, float(row["at_s"]), until_s, late_s, str(row["asked"]))
    if (
        not vehicles
        or min(vehicles) < 1
        or not all(math.isfinite(value or 0.0) for value in (struck.at_s, until_s, late_s))
    ):
        raise ValueError(f"{struck}")
    return struck
