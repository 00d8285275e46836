"""What comes out of a flight, however it was flown: its figures, its files, its verdict."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.load import dump_mission
from mission.model import Mission
from sim_bridge.judge.metrics import Metrics, measure
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.report import print_figures, run_folder
from sim_bridge.judge.verdict import judge


@dataclass(frozen=True, slots=True)
class Outcome:
    """A flight that is over."""

    metrics: Metrics
    summary: dict[str, Any]  # what metrics.json holds
    ended: str
    succeeded: bool


def conclude(
    recording: Recording,
    mission: Mission,
    folder: Path | None,
    ended: str,
    *,
    flown_s: float,
    wall_s: float,
    trace_hash: str | None,
    silenced: Collection[int] = (),
) -> Outcome:
    """Measure the flight, and save figures and recording into its run folder, where it has one.

    `silenced`: as for `verdict.judge`.
    """
    metrics = measure(recording, mission)
    verdict = judge(metrics, mission, ended, silenced=silenced)
    summary = {
        **metrics.as_dict(),
        "seed": mission.sim.seed,
        "ended": ended,
        "verdict": verdict.text,
        "wall_time_s": round(wall_s, 3),
        "real_time_factor": round(metrics.sim_time_s / flown_s, 2),
        "trace_hash": trace_hash,
        "mission_sha256": run_folder.mission_sha256(dump_mission(mission).encode()),
    }
    if folder is not None:
        run_folder.save(recording, folder)
        (folder / run_folder.METRICS_NAME).write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    return Outcome(metrics, summary, ended, verdict.succeeded)


def print_verdict(summary: dict[str, Any], folder: Path) -> None:
    """The metrics, one a line, and the verdict."""
    print_figures({key: value for key, value in summary.items() if key != "verdict"})
    print(f"  run folder                     {folder}")
    print(summary["verdict"])
