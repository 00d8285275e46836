"""`companion replay`: black boxes verified, run again and told."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from companion.journal.channels import Json
from companion.journal.reading import BlackBoxError, Flight, find_flights
from companion.journal.replay import Replayed, replay_flight
from companion.journal.summary import summarise_flight
from mission import __version__
from mission.common.compiled import STATE
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT

EXIT_DIFFERS = 1


def replay(arguments: argparse.Namespace) -> int:
    """The exit code: 0 all is the same, 1 it is not, or could not all be run again, 2 a file, or no tick asked for."""
    are_same: list[bool | None] = []
    has_bad_file = False
    try:
        for flight in find_flights(Path(arguments.log)):
            try:
                are_same.append(_replay_told(flight, arguments))
            except BlackBoxError as error:  # the others are run all the same
                has_bad_file = _refused(error)
    except BlackBoxError as error:
        has_bad_file = _refused(error)
    except ModuleNotFoundError as error:  # of a flight with a survey
        print(f"companion: this flight has a survey, which needs {error.name}: the extra `survey`", file=sys.stderr)
        return EXIT_ENVIRONMENT
    if has_bad_file:
        return EXIT_BAD_FILE
    if False in are_same:
        return EXIT_DIFFERS
    return EXIT_DONE if True in are_same else EXIT_BAD_FILE


def _refused(error: BlackBoxError) -> bool:
    print(f"companion: {error}", file=sys.stderr)
    return True


def _replay_told(flight: Flight, arguments: argparse.Namespace) -> bool | None:
    """Replay one and print it. True: all is the same; None: no tick of this flight was asked for."""
    from_s, to_s = arguments.from_s, arguments.to_s
    replayed = replay_flight(
        flight,
        from_s=-math.inf if from_s is None else from_s,
        to_s=math.inf if to_s is None else to_s,
        show=_print_tick if arguments.ticks else lambda _body, _since_s: None,
    )
    options = " ".join(f"{name} {value:g}" for name, value in (("--from", from_s), ("--to", to_s)) if value is not None)
    if options and replayed.is_same and not replayed.summary.ticks:
        told = summarise_flight(flight).times() or ", none at all"
        which = f"vehicle {flight.vehicle_id}, flight {flight.number}"
        print(f"companion: {options}: no tick of {which}; it has ticks{told}", file=sys.stderr)
        return None
    print("\n".join(_lines(flight, replayed)))
    return replayed.is_same


def _lines(flight: Flight, replayed: Replayed) -> list[str]:
    start, ticks = replayed.start, replayed.summary.ticks
    found = [f"vehicle {flight.vehicle_id}, flight {flight.number}, {len(flight.segments)} segments"]
    if start:
        found.append(
            f"  companion {start.get('version')}, {start.get('compiled')}, {start.get('started_utc')}".rstrip(", ")
        )
        found.append(f"  mission {start.get('mission_sha256')}")
        if (start.get("version"), start.get("compiled")) != (__version__, STATE):
            found.append(f"  run again by {__version__}, {STATE}")
    found += replayed.summary.lines()
    found += [f"BROKEN CHAIN: {what}" for what in replayed.breaks]
    found.append(f"  ends: {replayed.ends or 'without a last entry'}")
    found.append(f"  head of the chain {replayed.head}")
    if replayed.difference:
        found += ["DIFFERENT:", *(f"  {line}" for line in replayed.difference)]
    if replayed.stopped:
        found.append(f"not run again from there on: {replayed.stopped}")
    verdict = "SAME" if replayed.is_same else "NOT THE SAME" if replayed.difference else "INCOMPLETE"
    cut_off = f"; {replayed.cut_off}" if replayed.cut_off else ""
    return [*found, f"{verdict}: {replayed.same} of {ticks} ticks, bit for bit{cut_off}"]


def _print_tick(body: Json, since_s: float) -> None:
    cuts = ", ".join(f"{cut['reason']} {cut['by_mps']}" for cut in body["cuts"])
    beacons = ", ".join(f"{fate} of {senders}" for fate, senders in body["beacons"].items() if fate != "KEPT")
    refused = ", ".join(f"{count} {why}" for why, count in body["refused"].items())
    said = "; ".join(say["text"] for say in body["said"])
    notes = [f"cut by {cuts}" if cuts else "", f"beacons {beacons}" if beacons else "", said]
    notes.insert(2, f"refused {refused}" if refused else "")
    velocity = " ".join("nan" if v is None else f"{v:.3f}" for v in body["setpoint_ned_mps"])
    print(f"{body['tick']:7} {since_s:10.3f} {body['state']:12} {velocity:24} {'; '.join(filter(None, notes))}")
