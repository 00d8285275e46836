"""One flight of the search: a drawn mission, flown by the whole stack, judged on ground truth, as a row."""

from __future__ import annotations

import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from mission.document.model import Mission
from mission.schema.faults import Fault
from sim_bridge.drive import fly
from sim_bridge.drive.entrant.stages import BY_OURS, Entrant
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.verdict import BAD_FIRST, Grade
from sim_bridge.judge.verdict import CAUSES as VERDICT_CAUSES
from sim_bridge.lab.search.draw import VERSION
from sim_bridge.lab.search.invariants import INVARIANTS
from sim_bridge.lab.search.kept_records import MEANS as RECORDS_MEAN
from sim_bridge.lab.search.kept_records import RECORDS, find_lacking_records
from sim_bridge.lab.study.backends.agents import fly_stack
from sim_bridge.lab.study.case import Backend, Case
from sim_bridge.lab.study.jobs import Done

CRASHED = "program error"
CAUSES: Final = {  # a verdict's, and those that the search looks for besides
    **VERDICT_CAUSES,
    CRASHED: "the program ended with an error",
    RECORDS: RECORDS_MEAN,
    **{invariant.cause: invariant.means for invariant in INVARIANTS},
}


@dataclass(frozen=True, slots=True)
class SearchCase(Case):
    """A drawn mission, as a case of the study engine."""

    mission: Mission
    entrant: Entrant = BY_OURS
    signed: bool = False
    attacker: str = ""  # see `Drawn`


def fly_cases(cases: Sequence[SearchCase]) -> Done:
    """The job of a worker: its flights, to rows."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    rows = tuple(
        {"version": VERSION, "signed": case.signed, "attacker": case.attacker}
        | fly_to_row(case.mission, on_jsbsim=case.backend is Backend.JSBSIM, entrant=case.entrant, signed=case.signed)
        for case in cases
    )
    return Done(rows, time.process_time() - cpu_s, time.perf_counter() - wall_s)


def fly_to_row(
    mission: Mission,
    *,
    on_jsbsim: bool,
    folder: Path | None = None,
    entrant: Entrant = BY_OURS,
    signed: bool = False,
) -> dict[str, Any]:
    """Grade, causes and figures. An error of the program is a finding: UNSAFE, with its last line.

    KeyboardInterrupt: it was interrupted.
    """
    invariants = [invariant(mission) for invariant in INVARIANTS]
    happened: Counter[str] = Counter()
    struck: list[FaultEvent] = []

    def watch(flight: fly.Flight) -> None:
        for invariant in invariants:
            invariant.check_flight(flight)
        struck[:] = flight.faults.happened
        happened.clear()
        happened.update(_name(event) for event in flight.faults.happened)

    asked = [_name(fault) for fault in mission.sim.faults]
    try:
        outcome = fly_stack(mission, folder, on_jsbsim=on_jsbsim, watch=watch, entrant=entrant, signed=signed)
    except Exception as error:  # noqa: BLE001 - whatever it is, it is what is looked for
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = f"UNSAFE: {type(error).__name__}: {error} ({Path(place.filename).name}:{place.lineno})"
        found = {"grade": Grade.UNSAFE.value, "causes": [CRASHED], "verdict": text, "arrived": False}
        return found | {"faults": dict(happened), "asked": asked}
    if outcome.ended == fly.INTERRUPTED:  # a flight that was cut off shows nothing
        raise KeyboardInterrupt
    summary = outcome.summary
    lacking = find_lacking_records(summary, mission, struck)
    if lacking:
        _add_problem(summary, Grade.INCOMPLETE, RECORDS, lacking)
    for broken in reversed([invariant for invariant in invariants if invariant.violation]):
        _add_problem(summary, broken.grade, broken.cause, broken.violation)
    return summary | {"faults": dict(happened), "asked": asked}


def _add_problem(summary: dict[str, Any], grade: Grade, cause: str, what: str) -> None:
    """One more that does not hold; the first cause is one of the grade."""
    worst = min(grade, Grade(summary["grade"]), key=BAD_FIRST.index)
    summary["verdict"] = f"{worst}: {what}; {summary['verdict']}"
    summary["grade"] = worst.value
    summary["causes"] = [cause, *summary["causes"]] if worst is grade else [*summary["causes"], cause]


def _name(fault: Fault | FaultEvent) -> str:
    """Of a kind; of an insider with its lie."""
    return fault.kind.value if fault.lie is None else f"{fault.kind.value} {fault.lie.value}"
