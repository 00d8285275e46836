"""`companion key`: makes a fleet's keys, shows what may be shown of them, rotates and revokes."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from companion.keys.autopilot_link import link_passphrase
from companion.keys.fingerprints import describe, file_fingerprint, summary
from companion.keys.fleet_folder import Fleet, change_fleet, file_name, make_fleet
from companion.keys.key_file import PLACE_CHARS, KeyFileError, load_keyring
from companion.keys.keyring import OPERATOR, SECRET_BYTES, Keyring
from companion.keys.process import harden_process
from companion.keys.rotation import Step, advance, finish, revoke, step_of
from mission.common.durable_files import write_durably
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.problems import printable

EXIT_NOT_YET = 1  # an earlier step had to be completed first
STEPS = {
    Step.REST: "the old secret is gone: the rotation is finished",
    Step.NEW_ACCEPTED: "step 1 of 3: all sign with the old secret, and accept the new one",
    Step.NEW_ACTIVE: "step 2 of 3: all sign with the new secret, and accept the old one",
}


def key(arguments: argparse.Namespace) -> int:
    """The exit code."""
    harden_process()
    commands: dict[str, Callable[[argparse.Namespace], int]] = {
        "new": _make,
        "show-id": _show,
        "autopilot": _write_passphrase,
        "rotate": _rotate,
        "revoke": _revoke,
    }
    try:
        return commands[arguments.key_command](arguments)
    except KeyFileError as error:
        print(f"companion: {error}", file=sys.stderr)
        return EXIT_BAD_FILE
    except BrokenPipeError:  # of standard output alone, once all files are written: the program's to end by
        raise
    except OSError as error:
        where = printable(str(error.filename or getattr(arguments, "folder", "output")), PLACE_CHARS)
        print(f"companion: {where}: {os.strerror(error.errno or 0)}", file=sys.stderr)
        return EXIT_ENVIRONMENT


def _make(arguments: argparse.Namespace) -> int:
    fleet = make_fleet(Path(arguments.folder), arguments.vehicles)
    print(f"made {_shown(arguments.folder)}: keep it where nobody else reads it, and a copy of it")
    _print_files(fleet)
    print("next: put each file on its vehicle, and operator.key where orders are given (docs/how-to/keys.md)")
    return EXIT_DONE


def _show(arguments: argparse.Namespace) -> int:
    print("\n".join(describe(load_keyring(arguments.file, None))))
    return EXIT_DONE


def _write_passphrase(arguments: argparse.Namespace) -> int:
    keyring = load_keyring(arguments.file, None)
    if keyring.owner == OPERATOR:
        raise KeyFileError(f"{_shown(arguments.file)}: owner: is the operator: must be a vehicle")
    if os.path.lexists(arguments.out):
        raise KeyFileError(f"{_shown(arguments.out)}: is there already: it is never overwritten")
    write_durably(Path(arguments.out), f"{link_passphrase(keyring)}\n".encode())
    print(f"wrote {_shown(arguments.out)}: the passphrase of the autopilot link of vehicle {keyring.owner}")
    return EXIT_DONE


def _rotate(arguments: argparse.Namespace) -> int:
    change = finish if arguments.finish else advance
    fleet, was_interrupted = change_fleet(
        Path(arguments.folder), lambda operator: change(operator, os.urandom(SECRET_BYTES))
    )
    if was_interrupted:
        print("completed what was interrupted, and nothing else")
    elif arguments.finish:
        print("vehicles with a file from before do not hear those with this one: install it on all before any flies")
    _print_step(arguments.folder, fleet)
    is_done = not (was_interrupted and arguments.finish and step_of(fleet.operator) is not Step.REST)
    return EXIT_DONE if is_done else EXIT_NOT_YET


def _revoke(arguments: argparse.Namespace) -> int:
    vehicle: int = arguments.vehicle
    given_up: list[Step] = []

    def change(operator: Keyring) -> Keyring:
        given_up.append(step_of(operator))
        others = sorted(operator.vehicles.keys() - {vehicle})
        if vehicle not in operator.vehicles:
            raise KeyFileError(
                f"{_shown(arguments.folder)}: VEHICLE = {vehicle}: must be one of {', '.join(map(str, others))}"
            )
        if not others:
            raise KeyFileError(f"{_shown(arguments.folder)}: vehicle {vehicle} is the last: make a new fleet instead")
        return revoke(operator, vehicle, os.urandom(SECRET_BYTES))

    fleet, _ = change_fleet(Path(arguments.folder), change, leaving=vehicle)
    if vehicle in fleet.operator.vehicles:
        print(f"completed what was interrupted; vehicle {vehicle} is NOT revoked yet")
        _print_step(arguments.folder, fleet)
        return EXIT_NOT_YET
    print(f"vehicle {vehicle} is revoked: its file is deleted, its signature is worth nothing where the new files are")
    print("with the swarm's secret it can still sign frames as one of the swarm, until the third step is installed")
    if given_up == [Step.NEW_ACTIVE]:
        print(
            "WARNING: a rotation was in its second step: vehicles that have not got those files do not hear the new "
            "ones; give them these before any flies"
        )
    _print_step(arguments.folder, fleet)
    return EXIT_DONE


def _print_step(folder: str, fleet: Fleet) -> None:
    """The step that the folder is at, its files, and what to do with them."""
    step = step_of(fleet.operator)
    print(STEPS[step])
    print(summary(fleet.operator))
    _print_files(fleet)
    print("next: install these files on every vehicle, and operator.key where orders are given, in any order")
    if step is not Step.REST:
        print(f"when all have them: companion key rotate {_shown(folder)}")


def _print_files(fleet: Fleet) -> None:
    for owner, keyring in _keyrings(fleet):
        print(f"  {file_name(owner):16}{file_fingerprint(keyring)}")


def _keyrings(fleet: Fleet) -> Iterator[tuple[int, Keyring]]:
    yield OPERATOR, fleet.operator
    for vehicle in sorted(fleet.operator.vehicles):
        yield vehicle, fleet.keyring_of(vehicle)


def _shown(path: str) -> str:
    return printable(path, PLACE_CHARS)
