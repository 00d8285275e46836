"""The black box of a real flight: where it is kept, and how it is opened."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from companion.journal.channels import Json
from companion.journal.recorder import BlackBox, files_of
from companion.journal.segments import DirectWriter
from companion.shell.box.threaded_chunks import ThreadedChunks
from companion.shell.service import STATE

FOLDER_NAME = "black-box"
NONE = "none"


def box_folder(given: str | None) -> Path | None:
    """`given`, or a folder where the service keeps its state; None: `none` is given, or there is no service."""
    if given is not None:
        return None if given == NONE else Path(given)
    state = os.environ.get(STATE)
    return None if state is None else Path(state) / FOLDER_NAME


def file_in_the_way(folder: Path) -> Path | None:
    """`folder`, or the nearest above it that is there, if that is not a folder. None where the disk cannot be asked."""
    nearest = next((path for path in (folder, *folder.parents) if os.path.exists(path)), None)
    return nearest if nearest is not None and not nearest.is_dir() else None


def open_black_box(folder: Path, start: Json, *, beside_loop: bool) -> BlackBox:
    """`beside_loop`: written by a thread and synced, else while the loop waits, as in a simulation. Never fails."""
    files = files_of(folder, start, waits_for_disk=beside_loop)
    return BlackBox(ThreadedChunks(files) if beside_loop else DirectWriter(files), start)


def read_mission_file(path: str) -> tuple[str, str]:
    """Text of the mission's file and its SHA-256; empty where it cannot be read any more."""
    try:
        data = Path(path).read_bytes()
    except OSError:
        return "", ""
    return data.decode(errors="replace"), hashlib.sha256(data).hexdigest()
