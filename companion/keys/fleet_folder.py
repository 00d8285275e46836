"""The operator's folder of a fleet: its own key file and each vehicle's, made and rewritten so that a power cut at any
write leaves the files before or those after, and the same command, run again, goes on to the end.

The operator's file is written first and says what all are to be: files that differ from it are of an interrupted step.
"""

from __future__ import annotations

import fcntl
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from companion.keys.crypto import public_key
from companion.keys.key_file import PLACE_CHARS, KeyFileError, load_keyring, owner_name, render_keyring
from companion.keys.keyring import OPERATOR, SECRET_BYTES, Keyring
from mission.common.durable_files import replace_file, sync_folder
from mission.common.problems import printable

OPERATOR_FILE = "operator.key"
VEHICLE_FILE = re.compile(r"vehicle-([1-9][0-9]{0,2})\.key")
FIRST_EPOCH = 0


def file_name(owner: int) -> str:
    """Name of an owner's file in the folder."""
    return OPERATOR_FILE if owner == OPERATOR else f"vehicle-{owner}.key"


@dataclass(frozen=True, slots=True)
class Fleet:
    """Content of a folder. `stale`: vehicles whose files are not what the operator's says, or are to go."""

    operator: Keyring
    seeds: Mapping[int, bytes]
    stale: frozenset[int]

    def keyring_of(self, vehicle: int) -> Keyring:
        """The content that this vehicle's file is to have."""
        return replace(self.operator, owner=vehicle, seed=self.seeds[vehicle])


def make_fleet(folder: Path, size: int) -> Fleet:
    """New keys of the vehicles 1 to `size`, in a folder that is made. KeyFileError: it is there. OSError."""
    folder = Path(os.path.abspath(folder))
    place = printable(str(folder), PLACE_CHARS)
    with _locked(folder.parent) as parent_fd:
        if os.path.lexists(folder):
            raise KeyFileError(f"{place}: is there already: keys are never overwritten")
        part = folder.with_name(f".{folder.name}.new")
        _remove_unfinished(part)
        seeds = {owner: os.urandom(SECRET_BYTES) for owner in range(size + 1)}
        publics = {owner: public_key(seed) for owner, seed in seeds.items()}
        operator = Keyring(
            owner=OPERATOR,
            seed=seeds.pop(OPERATOR),
            secrets={FIRST_EPOCH: os.urandom(SECRET_BYTES)},
            active=FIRST_EPOCH,
            operator=publics.pop(OPERATOR),
            vehicles=publics,
        )
        fleet = Fleet(operator, seeds, frozenset())
        os.mkdir(part, 0o700)
        try:
            for keyring in (operator, *map(fleet.keyring_of, seeds)):
                _write(part, keyring)
            sync_folder(part)
            os.rename(part, folder)
        except OSError:
            _remove_unfinished(part)
            raise
        os.fsync(parent_fd)
    return fleet


def change_fleet(
    folder: Path, change: Callable[[Keyring], Keyring], *, leaving: int | None = None
) -> tuple[Fleet, bool]:
    """Rewrites all files: `change` makes the operator's new keyring of the one that is there.

    After an interrupted change it does no more than complete that one, and says so: True. The file of a vehicle that is
    `leaving` may be missing. KeyFileError, OSError.
    """
    with _locked(folder) as folder_fd:
        fleet = _load_fleet(folder, leaving)
        was_interrupted = bool(fleet.stale)
        if not was_interrupted:
            fleet = replace(fleet, operator=change(fleet.operator))
            _write(folder, fleet.operator)
            os.fsync(folder_fd)  # before the others: after a power cut they must not be ahead of it
        for vehicle in fleet.operator.vehicles.keys() & fleet.seeds.keys():
            _write(folder, fleet.keyring_of(vehicle))
        for vehicle in fleet.seeds.keys() - fleet.operator.vehicles.keys():
            os.unlink(folder / file_name(vehicle))
        os.fsync(folder_fd)
    return fleet, was_interrupted


def _load_fleet(folder: Path, leaving: int | None) -> Fleet:
    """All files of the folder, which must be of one fleet. KeyFileError."""
    operator = load_keyring(folder / OPERATOR_FILE, OPERATOR)
    found = {vehicle: load_keyring(folder / file_name(vehicle), vehicle) for vehicle in _vehicles_in(folder)}
    for vehicle, keyring in found.items():
        known = operator.vehicles.get(vehicle, keyring.vehicles[vehicle])
        if (keyring.operator, keyring.vehicles[vehicle]) != (operator.operator, known):
            raise KeyFileError(
                f"{_place(folder, vehicle)}: is of another fleet than {OPERATOR_FILE}: take it out of the folder"
            )
    for vehicle in operator.vehicles.keys() - found.keys() - {leaving}:
        raise KeyFileError(
            f"{_place(folder, vehicle)}: is missing: without {owner_name(vehicle)}'s private key its file cannot be "
            "written anew. Put it back (every vehicle has its own)"
        )
    fleet = Fleet(operator, {vehicle: keyring.seed for vehicle, keyring in found.items()}, frozenset())
    stale = {
        vehicle
        for vehicle, keyring in found.items()
        if vehicle not in operator.vehicles or keyring != fleet.keyring_of(vehicle)
    }
    return replace(fleet, stale=frozenset(stale))


def _vehicles_in(folder: Path) -> list[int]:
    try:
        names = os.listdir(folder)
    except OSError as error:
        raise KeyFileError(f"{printable(str(folder), PLACE_CHARS)}: {os.strerror(error.errno or 0)}") from None
    return sorted(int(match[1]) for name in names if (match := VEHICLE_FILE.fullmatch(name)))


def _place(folder: Path, owner: int) -> str:
    return printable(str(folder / file_name(owner)), PLACE_CHARS)


# --- writing ---


@contextmanager
def _locked(folder: Path) -> Iterator[int]:
    """An open descriptor of the folder, for one command at a time. KeyFileError."""
    place = printable(str(folder), PLACE_CHARS)
    try:
        fd = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        reason = os.strerror(error.errno or 0) if isinstance(error, OSError) else "is not a path"
        raise KeyFileError(f"{place}: {reason}") from None
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise KeyFileError(f"{place}: another `companion key` is at work there") from None
        yield fd
    finally:
        os.close(fd)


def _write(folder: Path, keyring: Keyring) -> None:
    replace_file(folder / file_name(keyring.owner), render_keyring(keyring).encode())


def _remove_unfinished(part: Path) -> None:
    """The folder of a `key new` that was interrupted, if there is one: our own files in it, and nothing else."""
    if not part.is_dir() or part.is_symlink():
        return
    for entry in os.scandir(part):
        name = entry.name.removeprefix(".").removesuffix(".new")
        is_ours = name == OPERATOR_FILE or VEHICLE_FILE.fullmatch(name)
        if is_ours and stat.S_ISREG(entry.stat(follow_symlinks=False).st_mode):
            os.unlink(entry.path)
    os.rmdir(part)
