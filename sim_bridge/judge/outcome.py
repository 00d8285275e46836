"""Outcome of a flight, however it was flown: its figures, its files, its verdict."""

from __future__ import annotations

import contextlib
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mission.cli.main import EXIT_ENVIRONMENT
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.judge import page, run_folder
from sim_bridge.judge.estimate_errors import ErrorFigures
from sim_bridge.judge.estimate_recorder import EstimateFigures
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Metrics, measure
from sim_bridge.judge.metrics.stems import StemFigures
from sim_bridge.judge.page.limits import limits
from sim_bridge.judge.page.names import named
from sim_bridge.judge.page.replay import Verdict as Judged
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.verdict import judge, with_notes

NAME_CHARS = 42  # of the longest name of a figure


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight that is over."""

    metrics: Metrics
    summary: dict[str, Any]  # what metrics.json holds
    ended: str
    succeeded: bool
    mission: Mission  # as flown
    unwritten: tuple[str, ...] = ()  # files that are missing in the run folder, and why


def conclude(
    recording: Recording,
    mission: Mission,
    folder: Path | None,
    ended: str,
    *,
    flown_s: float,
    wall_s: float,
    trace_hash: str | None,
    faults: Sequence[FaultEvent] = (),
    end_s: float | None = None,
    stand: Stand | None = None,
    estimates: EstimateFigures | ErrorFigures | None = None,
    stems: StemFigures | None = None,
    entrant: Mapping[str, Any] = MappingProxyType({}),
    records: Mapping[str, Any] = MappingProxyType({}),
) -> Outcome:
    """Measure the flight, and save figures and recording into its run folder, where it has one.

    `faults`, `end_s`, `stand`: as for `measure`; `estimates`: of the vehicles, where recorded;
    `stems`: of a survey, `records`: made and delivered by it.
    `entrant`: what flew in place of ours, by the keys that metrics.json has of it. A verdict says so, and whether it
    rests on the estimates of external autopilots.
    What cannot be written (disk full) is named in the outcome.
    """
    metrics = measure(recording, mission, stand, faults, end_s)
    verdict = judge(metrics, mission, ended, faults=faults, end_s=end_s)
    by = estimates.positions_by_estimates if isinstance(estimates, ErrorFigures) else ""
    summary = {
        **metrics.as_dict(),
        **(estimates.as_dict() if estimates is not None else {}),
        **(stems.as_dict() if stems is not None else {}),
        **records,
        "seed": mission.sim.seed,
        "ended": ended,
        run_folder.END_S: metrics.sim_time_s if end_s is None else end_s,
        "verdict": with_notes(verdict.text, by, entrant.get(run_folder.FLOWN_BY, "")),
        **entrant,
        "grade": verdict.grade.value,
        "causes": list(verdict.causes),
        "wall_time_s": round(wall_s, 3),
        "real_time_factor": round(metrics.sim_time_s / flown_s, 2),
        "trace_hash": trace_hash,
        "mission_sha256": run_folder.mission_sha256(dump_mission(mission).encode()),
    }
    unwritten: list[str] = []
    if folder is not None:
        figures = (json.dumps(summary, indent=2) + "\n").encode()
        with _noting_unwritten(unwritten):
            run_folder.write(folder / run_folder.METRICS_NAME, figures)
        with _noting_unwritten(unwritten):
            run_folder.save(recording, folder)
    return Outcome(metrics, summary, ended, verdict.succeeded, mission, tuple(unwritten))


def write_page(outcome: Outcome, folder: Path, title: str, progress: Progress) -> list[str]:
    """Write the page that replays the flight in `folder`; which files are missing there, and why."""
    unwritten = list(outcome.unwritten)
    if not (folder / run_folder.FILE_NAME).exists():
        return [*unwritten, f"{folder / page.PAGE_NAME}: not made: there is no {run_folder.FILE_NAME}"]
    recording, faults = run_folder.load(folder), run_folder.load_faults(folder)
    with _noting_unwritten(unwritten), progress.working("writing its replay"):
        page.write_flight(
            recording,
            outcome.mission,
            folder,
            title=title,
            metrics=outcome.metrics,
            verdict=Judged(outcome.summary["verdict"], outcome.succeeded, outcome.ended),
            figures=outcome.summary,
            faults=faults,
        )
    return unwritten


def present(outcome: Outcome, folder: Path, unwritten: Sequence[str], *, as_json: bool, verbose: bool = False) -> int:
    """Print where the flight is to be seen, its verdict, and what could not be written; `verbose`: all its figures.

    The program's exit code: 0, 1 the mission failed, 3 a file is missing.
    """
    if as_json:
        print(json.dumps(outcome.summary))
    else:
        if verbose:
            print_figures({key: value for key, value in outcome.summary.items() if key != "verdict"})
        shown = folder / page.PAGE_NAME
        print(f"replay: {shown}" if shown.exists() else f"run folder: {folder}")
        print(_in_a_line(outcome))
    for line in unwritten:
        with contextlib.suppress(OSError):  # nobody reads it
            print(f"sim-bridge: {line}", file=sys.stderr)
    return EXIT_ENVIRONMENT if unwritten else 0 if outcome.succeeded else 1


def print_figures(figures: Mapping[str, Any]) -> None:
    """One a line, by the name that people see; metrics.json has all digits."""
    for name, value in named(figures):
        print(f"  {name:<{NAME_CHARS}} {_shown(value)}")


def _shown(value: Any) -> str:
    """With the digits that mean something."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(map(_shown, value)) or "none"
    return "-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)


def _in_a_line(outcome: Outcome) -> str:
    """The verdict; of a flight that succeeded with what the mission sets limits to."""
    verdict: str = outcome.summary["verdict"]
    if not outcome.succeeded:
        return verdict
    flown = [f"{limit.name} {limit.flown}" for limit in limits(outcome.metrics, outcome.mission) if limit.allowed]
    return f"{verdict}: {', '.join(flown)}"


def describe_end(outcome: Outcome, folder: Path) -> dict[str, Any]:
    """The end of a flight, as viewers of its live map get it: see docs/reference/live.md."""
    return {
        "verdict": {"text": outcome.summary["verdict"], "succeeded": outcome.succeeded},
        "limits": [limit.as_dict() for limit in limits(outcome.metrics, outcome.mission)],
        "figures": {name: value for name, value in outcome.summary.items() if name != "verdict"},
        "ended": outcome.ended,
        "report": str(folder / page.PAGE_NAME) if (folder / page.PAGE_NAME).exists() else None,
    }


@contextlib.contextmanager
def _noting_unwritten(unwritten: list[str]) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        unwritten.append(f"{error.filename}: {error.strerror}")
