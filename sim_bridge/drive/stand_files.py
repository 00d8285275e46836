"""Stem map, stand table and report of a flight that surveyed, made of what has reached its base station."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from companion.cloud.returns_log import SUFFIX
from companion.cloud.returns_reader import ReturnsFileError
from companion.stand.fusion.fuse import TooManyError
from companion.stand.products.write import Products, describe_products, write_products
from companion.stand.records import RecordsError, read_records
from mission.document.model import Mission
from sim_bridge.drive.lockstep.harvest import BASE_FILE, COMPANIONS
from sim_bridge.judge.run_folder import STAND_FOLDER
from sim_bridge.world.world import DEFAULT_ORIGIN

PLACED: Final = "no [origin]: placed at the simulator's default origin"


class StandWritten(NamedTuple):
    """Lines for people, and which files are missing, and why."""

    lines: list[str]
    unwritten: list[str]


def write_stand(mission: Mission, folder: Path) -> StandWritten:
    """Writes them into the run folder of a mission that keeps records."""
    records = folder / BASE_FILE
    placed, note, said = mission, "", ""
    if mission.origin is None:
        placed, note, said = mission.with_origin(DEFAULT_ORIGIN), f" ({PLACED})", f"; {PLACED}"
    try:
        written = write_products(read_records(records), placed, folder / STAND_FOLDER, origin_note=note)
    except (RecordsError, TooManyError) as error:
        return StandWritten([f"stand: not written: {error}"], [])
    except OSError as error:
        return StandWritten([], [f"{error.filename or STAND_FOLDER}: {error.strerror}"])
    lines = [f"stand: {describe_products(written)}{said}"]
    files = sorted((folder / COMPANIONS).glob(f"*{SUFFIX}"))
    unwritten = []
    if files:
        try:
            lines.append(f"stand: {_write_cloud(files, written, placed, folder / STAND_FOLDER)}")
        except OSError as error:
            unwritten.append(f"{error.filename or STAND_FOLDER}: {error.strerror}")
    return StandWritten([*lines, f"stand: report and files in {folder / STAND_FOLDER}"], unwritten)


def _write_cloud(files: Sequence[Path], written: Products, mission: Mission, out: Path) -> str:
    """The point cloud of the vehicles' returns; a line for people. OSError."""
    try:
        from companion.stand.cloud.write import describe_cloud, read_files, write_cloud
    except ModuleNotFoundError as error:
        return f"cloud: not written: {error.name} is not installed"
    try:
        return describe_cloud(write_cloud(read_files(files), written, mission, out))
    except ReturnsFileError as error:
        return f"cloud: not written: {error}"
