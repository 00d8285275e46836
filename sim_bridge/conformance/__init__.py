"""`sim-bridge conformance`: what the client sent in recorded flights, sent to our autopilots; the answers compared."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from mission.common.files import os_words
from sim_bridge.conformance import table
from sim_bridge.conformance.compare import compare
from sim_bridge.conformance.explained import judge
from sim_bridge.conformance.recording import RecordingError, load
from sim_bridge.conformance.replay import replay
from sim_bridge.conformance.report import Flight, Report
from sim_bridge.conformance.steps import rows

RECORDINGS = Path(__file__).parents[2] / "tests" / "recordings"
DONE, FAILED, USAGE = 0, 1, 2


def run(args: argparse.Namespace) -> int:
    """Exit code 1 when a difference is not explained, or an explained one no longer occurs."""
    paths = args.recordings or recordings()
    if not paths:
        print(f"sim-bridge: no recordings in {RECORDINGS}: name some", file=sys.stderr)
        return USAGE
    try:
        report = conformance(paths)
    except RecordingError as error:
        print(f"sim-bridge: {error}", file=sys.stderr)
        return USAGE
    except OSError as error:
        print(f"sim-bridge: {os_words(error)}", file=sys.stderr)
        return USAGE
    if args.json:
        print(json.dumps(report.as_dict()))
    else:
        table.show(report)
    if args.write:
        args.write.write_text(table.markdown(report), encoding="utf-8")
    return DONE if report.holds else FAILED


def recordings() -> list[Path]:
    """The project's own."""
    return sorted(RECORDINGS.glob("*.tlog.xz"))


def conformance(paths: Sequence[Path]) -> Report:
    """Every recording flown and compared. RecordingError or OSError for a file that is none."""
    flights = []
    recorded, ours = [], []
    for path in paths:
        was, now = replay(load(path))
        checks = compare(was, now)
        flights.append(Flight(was.name, was.personality, tuple(checks), judge(was.personality, was.name, checks)))
        recorded.append(was)
        ours.append(now)
    return Report(tuple(flights), tuple(rows(recorded, ours)), complete=set(paths) >= set(recordings()))
