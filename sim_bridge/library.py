"""`fly`: one flight from Python, and what it shows. `from sim_bridge import fly`."""

from __future__ import annotations

import html
import io
import os
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from companion.core.model.states import SwarmPhase
from mission.document import simulator
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.schema.check import validated
from mission.stand.resolve import resolve_stand
from sim_bridge.drive import fly as lockstep
from sim_bridge.judge import run_folder
from sim_bridge.judge.metrics import Metrics
from sim_bridge.judge.page import page
from sim_bridge.judge.page.replay import Verdict, replay
from sim_bridge.judge.progress import Progress
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.tick import TOUCHED
from sim_bridge.world.world import DEFAULT_ORIGIN

if TYPE_CHECKING:
    import pandas

HEIGHT_PX = 760  # of the replay in a notebook: the map, the time bar and the first plots


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """A flight that is over. In a notebook it shows its replay."""

    mission: Mission  # as flown
    metrics: Metrics  # docs/reference/metrics.md
    summary: dict[str, Any]  # what metrics.json of a run folder holds: the figures, verdict, trace_hash and so on
    succeeded: bool
    recording: Recording  # ground truth of every tick: docs/reference/recording.md
    _title: str
    _document: dict[str, Any] = field(repr=False)

    def frame(self) -> pandas.DataFrame:
        """The recording as a table: a row for each vehicle in each tick (20 a second), in the order of time.

        Places are ENU metres about the mission's origin. ModuleNotFoundError without pandas, an extra.
        """
        try:
            import pandas
        except ModuleNotFoundError:
            raise ModuleNotFoundError(
                "pandas is not installed: in the checkout, pip install -e '.[sim,pandas]'", name="pandas"
            ) from None
        recording = self.recording
        ticks, n = recording.on_ground.shape
        columns: dict[str, Any] = {
            "time_s": np.repeat(recording.time_s, n),
            "vehicle": np.tile(np.arange(1, n + 1), ticks),
        }
        for name, values, unit in (("", recording.pos_ned_m, "m"), ("vel_", recording.vel_ned_mps, "mps")):
            north, east, down = values.reshape(-1, 3).T
            columns |= {f"{name}east_{unit}": east, f"{name}north_{unit}": north, f"{name}up_{unit}": -down}
        for name in ("on_ground", "armed", "agent_alive", "range_m", "acting", "leader"):
            columns[name] = getattr(recording, name).ravel()
        phases = {-1: "", **{phase.value: phase.name.lower() for phase in SwarmPhase}}
        columns["phase"] = [phases[number] for number in recording.phase.ravel().tolist()]
        columns["touched"] = [TOUCHED[number] or "" for number in recording.touched.ravel().tolist()]
        return pandas.DataFrame(columns)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the page that replays the flight, one HTML file; its path. OSError where that cannot be written."""
        file = Path(path)
        run_folder.write(file, self._page().encode())
        return file

    def _page(self) -> str:
        return page(self._document, self._title)

    def _repr_html_(self) -> str:
        """The replay, in a frame that can reach neither the notebook nor any network."""
        return (
            f'<iframe sandbox="allow-scripts" title="{html.escape(self._title)}" srcdoc="{html.escape(self._page())}" '
            f'style="width: 100%; height: {HEIGHT_PX}px; border: 0"></iframe>'
        )

    def __repr__(self) -> str:
        return f"<{self._title}: {self.summary['verdict']}>"


def fly(
    mission: Mission | Mapping[str, Any] | str | os.PathLike[str], *, folder: str | os.PathLike[str] | None = None
) -> Result:
    """Fly `mission` (a file, a Mission, or a mission's tables as a dict) on JSBSim in lockstep, in this process.

    It is the flight of `sim-bridge fly` to the bit. `folder`: new or empty, keeps the logs of the flight, as a run
    folder; else nothing is kept but what the result holds. A stem map (forest.file) is looked for beside the file, else
    in the current folder. MissionError: the mission is wrong, or not for the simulator. FileExistsError: `folder` holds
    something. KeyboardInterrupt ends the flight, and is passed on.
    """
    beside = Path.cwd() / "mission"
    if isinstance(mission, str | os.PathLike):
        beside = Path(mission)
        mission = load_mission(mission)
    elif not isinstance(mission, Mission):
        mission = validated(Mission, dict(mission), "mission")
    simulator.check(mission, beside.name)
    stems = mission.forest.file
    if stems is not None:
        resolve_stand(mission, beside)
    mission = mission if mission.origin else mission.with_origin(DEFAULT_ORIGIN)
    title = mission.name or beside.stem
    with tempfile.TemporaryDirectory(prefix="understory-") as thrown_away:
        place = Path(folder or thrown_away)
        if place.exists() and any(place.iterdir()):
            raise FileExistsError(f"{place}: exists and is not an empty folder")
        place.mkdir(parents=True, exist_ok=True)
        if stems is not None:
            shutil.copyfile(beside.parent / stems, place / stems)
        with Progress(io.StringIO()) as nobody:
            outcome = lockstep.fly(mission, place, nobody, in_process=True)
        if outcome.ended == "interrupted":
            raise KeyboardInterrupt
        if outcome.unwritten:
            raise OSError("; ".join(outcome.unwritten))
        recording = run_folder.load(place)
        document = replay(
            recording,
            mission,
            place,
            title=title,
            metrics=outcome.metrics,
            verdict=Verdict(outcome.summary["verdict"], outcome.succeeded, outcome.ended),
            figures=outcome.summary,
            faults=run_folder.load_faults(place),
        )
    return Result(mission, outcome.metrics, outcome.summary, outcome.succeeded, recording, title, document)
