"""Fusion in flight, as a child of a companion that leads: `python -m companion.stand.in_flight MISSION RECORDS`.

A line on stdin asks for one; a line on stdout answers: the time of a processor that it took, s, and the body of the
summary, hexadecimal; or `!` and why there is none. It ends when its stdin does, and gives way to everything else on
its computer.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import IO, Final

from companion.records.summary import encode_summary
from companion.stand.fusion.fuse import TooManyError
from companion.stand.records import RecordsError, read_records
from companion.stand.summarise import summarise
from mission.document.load import load_mission
from mission.document.model import Mission

NICE: Final = 19
OOM_SCORE: Final = 1000
SAID_CHARS: Final = 60


def answer(mission: Mission, records: Path) -> str:
    """The line that answers one request."""
    began_s = time.process_time()
    try:
        summary = summarise(read_records(records), mission)
    except (RecordsError, TooManyError) as error:
        return f"! {str(error).rpartition(': ')[2][:SAID_CHARS]}"  # without the file's name
    return f"{time.process_time() - began_s:.3f} {encode_summary(summary).hex()}"


def yield_to_others() -> str:
    """Takes the lowest priority, and is the first to go when memory is short; why not, or empty.

    A service's companion runs at a high priority, which its children inherit.
    """
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
        Path("/proc/self/oom_score_adj").write_text(f"{OOM_SCORE}\n", encoding="ascii")
    except OSError as error:
        return f"priority cannot be lowered: {error.strerror}"
    return ""


def serve(mission: Mission, records: Path, asked: IO[str], told: IO[str]) -> None:
    """Answers until `asked` ends; nothing is fused at another's cost."""
    refused = yield_to_others()
    for _ in asked:
        print(f"! {refused}" if refused else answer(mission, records), file=told, flush=True)


if __name__ == "__main__":
    serve(load_mission(sys.argv[1]), Path(sys.argv[2]), sys.stdin, sys.stdout)
