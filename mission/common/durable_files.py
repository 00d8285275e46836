"""Files that are as they were, or as they are to be, whenever the power fails."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path


def replace_file(path: Path, data: bytes, *, mode: int | None = None) -> None:
    """`data` in place of what `path` holds. It is there for good once its folder is synchronised, too.

    mode: its permissions, where the file system has any; None: 0600.
    OSError: the file is as it was. What an interrupted one has left beside it is taken away.
    """
    part = path.with_name(f".{path.name}.new")
    with contextlib.suppress(FileNotFoundError):
        os.unlink(part)
    fd = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        try:
            left = memoryview(data)
            while left:
                left = left[os.write(fd, left) :]
            if mode is not None:
                with contextlib.suppress(PermissionError):  # FAT keeps none
                    os.fchmod(fd, mode)
            os.fsync(fd)
        finally:
            os.close(fd)
        os.replace(part, path)
    except OSError:
        os.unlink(part)
        raise


def sync_folder(folder: Path) -> None:
    """Puts the names in it on the disk: of files that were made, replaced or removed. OSError."""
    fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_durably(path: Path, data: bytes) -> None:
    """As `replace_file`; on the disk when this returns."""
    replace_file(path, data)
    sync_folder(path.parent)
