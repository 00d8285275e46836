"""Rows about this computer: key, disk, monotonic clock."""

from __future__ import annotations

import os
import shutil
import stat
import time
from pathlib import Path

from companion.preflight.report import Check, Verdict
from mission.common.problems import printable

KEY_BYTES = 32
DISK_FREE_MIN_BYTES = 500_000_000  # a flight log is small; what else runs on this board is not known
RESOLUTION_MAX_S = 1e-3  # a tick is 50 ms


def check_key(path: str | None) -> Check:
    """A file of 32 random bytes that is this user's alone. Its content is not shown."""
    wanted = f"{KEY_BYTES} random bytes, mode 0600, owned by this user"
    if path is None:
        return Check(
            name="key", verdict=Verdict.WARN, found="none given (--key)", wanted=wanted, fix="beacons are not signed"
        )
    wrong = _wrong_with_key(path)
    return Check(
        name="key",
        verdict=Verdict.FAIL if wrong else Verdict.PASS,
        found=wrong or "as wanted",
        wanted=wanted,
        fix=f"(umask 177; head -c {KEY_BYTES} /dev/urandom > KEY), the same on every vehicle" if wrong else "",
    )


def _wrong_with_key(path: str) -> str:
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        return f"{printable(path)}: {(isinstance(error, OSError) and error.strerror) or error}"
    try:
        status = os.fstat(fd)
        if not stat.S_ISREG(status.st_mode):
            return "not a regular file"
        if status.st_uid != os.geteuid():
            return f"owned by user {status.st_uid}, this is {os.geteuid()}"
        if stat.S_IMODE(status.st_mode) != 0o600:
            return f"mode {stat.S_IMODE(status.st_mode):04o}"
        if status.st_size != KEY_BYTES:
            return f"{status.st_size} bytes"
        if len(set(os.read(fd, KEY_BYTES))) < KEY_BYTES // 4:  # 32 random bytes have 30 different ones on average
            return "not random"
    finally:
        os.close(fd)
    return ""


def check_disk(folder: Path) -> Check:
    """Room for logs where `folder` is."""
    wanted = f"at least {DISK_FREE_MIN_BYTES / 1e6:.0f} MB"
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        return Check(name="disk", verdict=Verdict.FAIL, found=f"{error.strerror}", wanted=wanted, fix="does it exist?")
    enough = free >= DISK_FREE_MIN_BYTES
    return Check(
        name="disk",
        verdict=Verdict.PASS if enough else Verdict.FAIL,
        found=f"{free / 1e6:.0f} MB free in {printable(str(folder.resolve()), 80)}",
        wanted=wanted,
        fix="" if enough else "delete old logs",
    )


def check_monotonic() -> Check:
    """The clock that the flight goes by."""
    resolution_s = time.get_clock_info("monotonic").resolution
    good = resolution_s <= RESOLUTION_MAX_S and time.get_clock_info("monotonic").monotonic
    return Check(
        name="monotonic",
        verdict=Verdict.PASS if good else Verdict.FAIL,
        found=f"{resolution_s:g} s",
        wanted=f"steps of at most {RESOLUTION_MAX_S:g} s",
        fix="" if good else "a kernel with high-resolution timers",
    )
