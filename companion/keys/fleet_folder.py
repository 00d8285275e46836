"""The operator's folder of a fleet: its own key file and each vehicle's, made and rewritten so that a power cut at any
write leaves the files before or those after, and the same command, run again, goes on to the end.

The operator's file is written first and says what all are to be: files that differ from it are of an interrupted step,
if it is newer than they are. One that is older, or has lost a vehicle, is refused.
"""

from __future__ import annotations

import fcntl
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from companion.keys.crypto import public_key
from companion.keys.key_file import (
    PLACE_CHARS,
    DamagedKeyError,
    KeyFileError,
    load_keyring,
    owner_name,
    render_keyring,
)
from companion.keys.keyring import OPERATOR, SECRET_BYTES, Keyring
from companion.keys.rotation import is_newer, is_revocation
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
    `leaving` may be missing or damaged. KeyFileError, OSError.
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
        for vehicle in set(_vehicles_in(folder)) - fleet.operator.vehicles.keys():
            os.unlink(folder / file_name(vehicle))
        os.fsync(folder_fd)
    return fleet, was_interrupted


def _load_fleet(folder: Path, leaving: int | None) -> Fleet:
    """All files of the folder, which must be of one fleet. KeyFileError."""
    operator = load_keyring(folder / OPERATOR_FILE, OPERATOR, may_lack_vehicles=True)  # the others say which
    found = _load_vehicles(folder, leaving)
    for vehicle, keyring in found.items():
        known = operator.vehicles.get(vehicle, keyring.vehicles[vehicle])
        if (keyring.operator, keyring.vehicles[vehicle]) != (operator.operator, known):
            raise KeyFileError(
                f"{_place(folder, vehicle)}: is of another fleet than {OPERATOR_FILE}: take it out of the folder"
            )
    operator = _with_leaving(operator, found, leaving)
    for keyring in found.values():
        _check_newer(folder, operator, keyring, found.keys() - {leaving})
    for vehicle in operator.vehicles.keys() - found.keys() - {leaving}:
        raise KeyFileError(
            f"{_place(folder, vehicle)}: is missing: without {owner_name(vehicle)}'s private key its file cannot be "
            "written anew. Put it back (every vehicle has its own)"
        )
    fleet = Fleet(operator, {vehicle: keyring.seed for vehicle, keyring in found.items()}, frozenset())
    stale = {
        vehicle
        for vehicle in _vehicles_in(folder)
        if vehicle not in operator.vehicles or (vehicle in found and found[vehicle] != fleet.keyring_of(vehicle))
    }
    return replace(fleet, stale=frozenset(stale))


def _load_vehicles(folder: Path, leaving: int | None) -> dict[int, Keyring]:
    """By vehicle; without the one that is `leaving`, if its file is damaged. KeyFileError."""
    found = {}
    for vehicle in _vehicles_in(folder):
        try:
            found[vehicle] = load_keyring(folder / file_name(vehicle), vehicle)
        except DamagedKeyError as error:
            if vehicle != leaving:
                raise KeyFileError(
                    f"{error}. Put it back (the vehicle has its own), or take vehicle {vehicle} out of the fleet: "
                    f"{_revoke_words(folder, vehicle)}"
                ) from None
    return found


def _with_leaving(operator: Keyring, found: Mapping[int, Keyring], leaving: int | None) -> Keyring:
    """The operator's keyring; a vehicle that its file has lost is put back if it is `leaving`: to be revoked."""
    if leaving is None or leaving in operator.vehicles:
        return operator
    for keyring in found.values():
        if leaving in keyring.vehicles and _has_same_secrets(operator, keyring):
            return replace(operator, vehicles={**operator.vehicles, leaving: keyring.vehicles[leaving]})
    return operator


def _check_newer(folder: Path, operator: Keyring, keyring: Keyring, kept: Set[int]) -> None:
    """Refuses an operator's file that is older than this vehicle's `keyring`, or has lost a vehicle that it has.

    `kept`: vehicles that nobody asks to revoke; only an interrupted revocation may delete their files. KeyFileError.
    """
    gone = sorted(keyring.vehicles.keys() - operator.vehicles.keys())
    is_same = _has_same_secrets(operator, keyring)
    place, other = _place(folder, OPERATOR), file_name(keyring.owner)
    if not is_same and not is_newer(operator, keyring):
        raise KeyFileError(
            f"{place}: is older than {other}, or of another copy of the folder: {_epochs(operator)} in it, "
            f"{_epochs(keyring)} in {other}. Put back the {OPERATOR_FILE} that was made with {other}"
        )
    # A revocation always brings a secret that the files before it have not
    lost = gone if is_same else [] if is_revocation(operator, keyring) else [one for one in gone if one in kept]
    if lost:
        raise KeyFileError(
            f"{place}: vehicles.{lost[0]}: is missing, and {other} has it: vehicle {lost[0]} would be struck "
            f"out, and its private key deleted. Put back the {OPERATOR_FILE} that has it, or take the vehicle "
            f"out of the fleet: {_revoke_words(folder, lost[0])}"
        )


def _has_same_secrets(one: Keyring, other: Keyring) -> bool:
    return (one.secrets, one.active) == (other.secrets, other.active)


def _epochs(keyring: Keyring) -> str:
    names = (f"{epoch} (active)" if epoch == keyring.active else str(epoch) for epoch in sorted(keyring.secrets))
    return f"epoch {' and '.join(names)}"


def _revoke_words(folder: Path, vehicle: int) -> str:
    return f"companion key revoke {printable(str(folder), PLACE_CHARS)} {vehicle}"


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
