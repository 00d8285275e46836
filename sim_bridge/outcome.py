"""What comes out of a flight, however it was flown: its figures, its files, its verdict."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.model import Mission
from sim_bridge.metrics import Metrics, measure
from sim_bridge.recording import Recorder
from sim_bridge.report import print_figures, run_folder


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight that is over."""

    metrics: Metrics
    summary: dict[str, Any]  # what metrics.json holds
    ended: str
    succeeded: bool


def conclude(
    recorder: Recorder,
    mission: Mission,
    folder: Path,
    ended: str,
    *,
    flown_s: float,
    wall_s: float,
    trace_hash: str | None,
) -> Outcome:
    """Measure the flight, and save figures and recording into its run folder."""
    recording = recorder.recording()
    metrics = measure(recording, mission)
    summary = {
        **metrics.as_dict(),
        "seed": mission.sim.seed,
        "ended": ended,
        "wall_time_s": round(wall_s, 3),
        "real_time_factor": round(metrics.sim_time_s / flown_s, 2),
        "trace_hash": trace_hash,
    }
    (folder / "metrics.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    run_folder.save(recording, folder)
    complete = ended in ("coverage complete", "all landed")
    return Outcome(metrics, summary, ended, complete and metrics.arrived and metrics.contacts == 0)


def print_verdict(summary: dict[str, Any], folder: Path, *, succeeded: bool) -> None:
    """The metrics, one a line, and the verdict."""
    print_figures(summary)
    print(f"  run folder                     {folder}")
    print("ARRIVED" if succeeded else f"FAILED: {failure(summary)}")


def failure(summary: dict[str, Any]) -> str:
    """Why a flight does not count."""
    if not summary["arrived"]:
        return f"not all arrived ({summary['ended']})"
    if summary["contacts"]:
        return f"{summary['contacts']} contacts"
    return str(summary["ended"])
