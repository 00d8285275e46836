"""Rows about this computer: key, disk, monotonic clock; and its time."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from pathlib import Path

from companion.keys.fingerprints import summary
from companion.keys.key_file import KeyFileError, load_keyring, owner_name
from companion.keys.process import harden_process
from companion.preflight.report import Check, Now, Verdict
from mission.common.problems import printable

DISK_FREE_MIN_BYTES = 500_000_000  # a flight log is small; what else runs on this board is not known
RESOLUTION_MAX_S = 1e-3  # a tick is 50 ms
COMMAND_S = 5.0
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
BOOT_ID_NAME = "UNDERSTORY_BOOT_ID"  # in the environment of the service, which does not see that file


def check_key(path: str | None, owner: int | None, size: int = 0) -> Check:
    """A key file that is this user's alone, and `owner`'s (None: whoever's); no secret of it is shown.

    `size`: of the mission's swarm; vehicles of it that have no key, as after one was revoked, are a warning.
    """
    whose = "a" if owner is None else f"{owner_name(owner)}'s"
    wanted = f"{whose} key file, mode 0600, this user's"
    if path is None:
        fix = "without one a companion does not start, or flies UNSIGNED (--unsigned): docs/how-to/keys.md"
        return Check(name="key", verdict=Verdict.WARN, found="none given (--key)", wanted=wanted, fix=fix)
    harden_process()
    try:
        keyring = load_keyring(path, owner)
    except KeyFileError as error:
        fix = "docs/how-to/keys.md: `companion key new` makes a fleet's files, each vehicle has its own"
        return Check(name="key", verdict=Verdict.FAIL, found=str(error), wanted=wanted, fix=fix)
    without = ", ".join(str(vehicle) for vehicle in range(1, size + 1) if vehicle not in keyring.vehicles)
    return Check(
        name="key",
        verdict=Verdict.WARN if without else Verdict.PASS,
        found=summary(keyring) + (f"; no key of vehicle {without}" if without else ""),
        wanted=wanted,
        fix="revoked, or of another fleet: what they send is not accepted" if without else "",
    )


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


def told_by(*command: str) -> str | None:
    """Output of a command; None when it is not there or fails."""
    if shutil.which(command[0]) is None:
        return None
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_S, check=False)
    except subprocess.TimeoutExpired:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def is_clock_set() -> bool | None:
    """The wall clock is synchronised; None: nobody tells."""
    told = told_by("timedatectl", "show", "--property=NTPSynchronized", "--value")
    return {"yes": True, "no": False}.get(told or "")


def now() -> Now:
    """This moment."""
    try:
        boot_id = BOOT_ID.read_text()
    except OSError:
        boot_id = os.environ.get(BOOT_ID_NAME, "")
    boot_s = time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))  # macOS has none, nor boot ids
    return Now(time.time(), boot_id.strip().replace("-", ""), boot_s)  # systemd writes it without
