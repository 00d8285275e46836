"""Studies for tests: a short mission, and files made of it."""

from __future__ import annotations

import io
import signal
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from sim_bridge.lab.study import engine
from sim_bridge.lab.study.case import Case, LoadedStudy
from sim_bridge.lab.study.jobs import Done, fly_batch
from sim_bridge.lab.study.load import load_study

MISSION = """\
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [30.0, 0.0, 8.0]
vel_leader_mps = 3.0
[swarm]
size = 3
[coverage]
duration_s = 2.0
"""
STUDY = """\
schema = 1
missions = ["mission.toml"]
seeds = 2
[cross]
swarm.size = [2, 3]
[[run]]
name = "ours"
"""


def study_file(folder: Path, text: str = STUDY) -> Path:
    """A study, and its mission beside it."""
    (folder / "mission.toml").write_text(MISSION, encoding="utf-8")
    file = folder / "study.toml"
    file.write_text(text, encoding="utf-8")
    return file


def study(folder: Path, text: str = STUDY) -> LoadedStudy:
    return load_study(study_file(folder, text))


def fly_but_die_at_seed_2(batch: tuple[Case, ...]) -> Done:
    """A worker that crashes as one in C does: without an exception."""
    if any(case.mission.sim.seed == 2 for case in batch):
        signal.raise_signal(signal.SIGKILL)
    return fly_batch(batch)


def fly_but_fail_at_seed_2(batch: tuple[Case, ...]) -> Done:
    if any(case.mission.sim.seed == 2 for case in batch):
        raise ValueError("no such flight")
    return fly_batch(batch)


def here(todo: Sequence[engine.Batch]) -> Iterator[tuple[engine.Batch, engine.Result]]:
    """Without processes."""
    return ((batch, fly_batch(batch)) for batch in todo)


def quiet() -> Console:
    return Console(file=io.StringIO())
