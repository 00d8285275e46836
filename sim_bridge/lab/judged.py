"""A flight out of its run folder, measured and judged anew."""

from __future__ import annotations

import contextlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mission.document.load import load_mission
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge import page, run_folder
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics import Metrics, measure
from sim_bridge.judge.page.replay import Verdict, replay
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.run_folder import MISSION_NAME
from sim_bridge.judge.verdict import judge, with_notes


@dataclass(frozen=True, slots=True)
class Judged:
    """A flight out of its run folder, measured and judged anew."""

    folder: Path
    title: str
    recording: Recording
    mission: Mission
    stand: Stand
    faults: tuple[FaultEvent, ...]
    metrics: Metrics
    figures: dict[str, Any]
    verdict: Verdict

    def document(self) -> dict[str, Any]:
        """The document that a page replays."""
        return replay(
            self.recording,
            self.mission,
            self.folder,
            title=self.title,
            metrics=self.metrics,
            verdict=self.verdict,
            figures=self.figures,
            faults=self.faults,
            stand=self.stand,
        )


def judged(folder: Path) -> Judged:
    """The flight in `folder`. RunFolderError or MissionError: it is not that of a flight."""
    recording = run_folder.load(folder)
    mission = load_mission(folder / MISSION_NAME)
    n = recording.on_ground.shape[1]
    if n != mission.swarm.size and len(recording.time_s):
        place = f"{folder / MISSION_NAME}: swarm.size = {mission.swarm.size}"
        raise run_folder.RunFolderError(f"{place}: must be {n}, as many vehicles as {run_folder.FILE_NAME} has")
    faults = run_folder.load_faults(folder, mission.swarm.size)
    end = run_folder.load_end(folder)
    if (folder / page.PAGE_NAME).is_dir():
        raise run_folder.RunFolderError(f"{folder / page.PAGE_NAME}: is a folder: must be a file, or nothing")
    stand = stand_of(mission, folder)
    end_s = None if end is None else end.end_s
    metrics = measure(recording, mission, stand, faults, end_s)
    figures = metrics.as_dict()
    verdict = Verdict(None, None)
    if end is None:
        _note(
            f"{folder / run_folder.METRICS_NAME}: missing: why the flight ended is not known, and there is no verdict"
        )
    else:
        if end.mission_sha256 not in (None, run_folder.mission_sha256((folder / MISSION_NAME).read_bytes())):
            _note(f"{folder / MISSION_NAME}: was changed after the flight: what follows is by what it says now")
        found = judge(metrics, mission, end.ended, faults=faults, end_s=end_s)
        text = with_notes(found.text, end.by_estimates, end.flown_by)
        verdict = Verdict(text, found.succeeded, end.ended)
        figures |= {"ended": end.ended, "verdict": text, "grade": found.grade.value, "causes": list(found.causes)}
    title = mission.name or folder.resolve().name
    return Judged(folder, title, recording, mission, stand, faults, metrics, figures, verdict)


def _note(text: str) -> None:
    with contextlib.suppress(OSError):  # nobody reads it
        print(f"sim-bridge: {text}", file=sys.stderr)
