"""Options of the command line: `companion run --black-box`, `companion replay`."""

from __future__ import annotations

import argparse
import math

from mission.common.problems import printable

REPLAY = """\
Runs the flights of a black box again, from the log alone, and compares every datagram and every decision of every
tick with what was recorded, bit for bit. Verifies the chain of the log first to last. Tells what the safety filter
has cut and why, and which beacons were heard.
"""

REPLAY_MORE = """\
The log needs no key, no disk and no network: what the keys said then is in it. It ends where power was lost; a gap,
where the disk was full, ends what can be run again. docs/how-to/replay-a-companion.md has more.

exit codes: 0 every tick is the same and the chain is whole, 1 a tick differs, the chain is broken, or not all could
be run again, 2 there is no black box, no tick of any flight is between --from and --to, or wrong usage, 3 a flight
with a survey needs numpy
"""


def add_black_box_option(run: argparse.ArgumentParser) -> None:
    """To `companion run`."""
    run.add_argument(
        "--black-box",
        metavar="FOLDER",
        help="record every input and output there, for `companion replay`; `none`: do not; default: black-box in "
        "$STATE_DIRECTORY, as the service has it, else none",
    )


def add_replay_command(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """`companion replay`."""
    replay = commands.add_parser(
        "replay",
        help="run recorded flights again, and compare bit for bit",
        description=REPLAY,
        epilog=REPLAY_MORE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    replay.add_argument("log", metavar="LOG", help="a folder of black boxes, or a segment of the flight")
    replay.add_argument(
        "--from",
        dest="from_s",
        type=_seconds,
        metavar="S",
        help="count and print ticks from so many seconds after the first tick of the box on; those before are run, too",
    )
    replay.add_argument(
        "--to", dest="to_s", type=_seconds, metavar="S", help="run no tick later after the first than so"
    )
    replay.add_argument("--ticks", action="store_true", help="print a line for each of these ticks")


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{printable(text)!r}: must be a number of seconds")
    return value
