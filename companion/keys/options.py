"""`companion key` on the command line: its commands and options, without what they need."""

from __future__ import annotations

import argparse

from mission.common.problems import printable
from mission.schema.kinds import MAX_VEHICLES

_ABOUT = """\
Keys of a fleet: a file for each vehicle and one for the operator. With them vehicles sign what they send and know one
another; the operator's alone signs orders.
"""

_MORE = """\
docs/how-to/keys.md goes through all of it: make, install, rotate, revoke, and what to do about a lost vehicle.

exit codes: 0 done, 1 an interrupted step was completed first: run it again, 2 wrong usage or a file or folder that is
refused, 3 a file that cannot be written
"""

_NEW = """\
Makes the keys of the vehicles 1 to N and of the operator, and a secret of the swarm. Nothing is ever overwritten.
"""

_NEW_MORE = """\
exit codes: 0 made, 2 wrong usage, or FOLDER is there, 3 a file that cannot be written
"""

_SHOW = """\
Shows whose a key file is, and fingerprints of what it holds, nothing of which is secret: compare them by eye between
boards.
"""

_SHOW_MORE = """\
exit codes: 0 shown, 2 wrong usage, or FILE is refused
"""

_ROTATE = """\
Replaces the swarm's secret in three steps: each run makes the files of the next one, and says what to do with them.
Vehicles that have the files of one step hear those that have the next one's.
"""

_ROTATE_MORE = """\
Install a step's files on every vehicle before you run it again. A run that was interrupted is completed by the next
one, which then does nothing else.

exit codes: 0 done, 1 an interrupted step was completed, and --finish not done: run it again, 2 wrong usage or a file
that is refused, 3 a file that cannot be written
"""

_REVOKE = """\
Takes a vehicle out of the fleet: a lost one, or one that somebody had in his hands. Its key is struck out of all files,
and a rotation begins, in which it gets none.
"""

_REVOKE_MORE = """\
`companion key rotate` goes on with the rotation; after its last step nothing that the vehicle sends is accepted.

exit codes: 0 done, 1 an interrupted step was completed, and nothing revoked: run it again, 2 wrong usage or a file that
is refused, 3 a file that cannot be written
"""

_AUTOPILOT = """\
Writes the passphrase of one vehicle's autopilot link to a file of its own (0600): for a ground station that is to speak
to that autopilot, which refuses who has no key. Companions make it of their own key file.
"""

_AUTOPILOT_MORE = """\
docs/how-to/sign-the-autopilot-link.md says how the autopilot gets the key.

exit codes: 0 written, 2 wrong usage, or FILE is refused, 3 a file that cannot be written
"""

_FOLDER = "the fleet's folder, that `companion key new` made"


def add_key_commands(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """`key` with its own commands."""
    key = _add(commands, "key", "make, show, rotate and revoke the keys of a fleet", _ABOUT, _MORE)
    inner = key.add_subparsers(dest="key_command", required=True, metavar="COMMAND")
    new = _add(inner, "new", "make the keys of a fleet", _NEW, _NEW_MORE)
    new.add_argument("folder", metavar="FOLDER", help="folder for the files; it is made, and must not be there")
    new.add_argument(
        "--vehicles",
        required=True,
        type=_vehicle_number,
        metavar="N",
        help=f"make keys of the vehicles 1 to N, at most {MAX_VEHICLES}",
    )
    show = _add(inner, "show-id", "show what may be shown of a key file", _SHOW, _SHOW_MORE)
    show.add_argument("file", metavar="FILE", help="key file of a vehicle or the operator")
    link = _add(inner, "autopilot", "write the passphrase of an autopilot's link", _AUTOPILOT, _AUTOPILOT_MORE)
    link.add_argument("file", metavar="FILE", help="key file of the vehicle")
    link.add_argument("--out", required=True, metavar="PASSPHRASE", help="file for the passphrase")
    rotate = _add(inner, "rotate", "replace the swarm's secret, step by step", _ROTATE, _ROTATE_MORE)
    rotate.add_argument("folder", metavar="FOLDER", help=_FOLDER)
    rotate.add_argument(
        "--finish",
        action="store_true",
        help="drop the old secret at once, for a fleet on the ground that gets its files before any vehicle flies",
    )
    revoke = _add(inner, "revoke", "take a vehicle out of the fleet", _REVOKE, _REVOKE_MORE)
    revoke.add_argument("folder", metavar="FOLDER", help=_FOLDER)
    revoke.add_argument("vehicle", type=_vehicle_number, metavar="VEHICLE", help="its number")


def _add(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, about: str, text: str, more: str
) -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    return commands.add_parser(name, help=about, description=text, epilog=more, formatter_class=raw)


def _vehicle_number(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 3 and 1 <= int(text) <= MAX_VEHICLES):
        raise argparse.ArgumentTypeError(f"{printable(text)!r}: must be from 1 to {MAX_VEHICLES}")
    return int(text)
