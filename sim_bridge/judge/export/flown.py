"""A flight out of its run folder, as exporters need it: ground truth, mission, stand, and when it was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path

import numpy as np

from mission.common.frames import LocalFrame, Wgs84, enu_to_ned
from mission.document.load import load_mission
from mission.document.model import Mission
from mission.stand.stand import Stand, stand_of
from sim_bridge.judge import run_folder
from sim_bridge.judge.export.telemetry import Telemetry, read_telemetry, started_us
from sim_bridge.judge.fault_events import FaultEvent
from sim_bridge.judge.metrics.arrays import Floats, Ints
from sim_bridge.judge.recording import Recording
from sim_bridge.judge.run_folder import MISSION_NAME


@dataclass(frozen=True)
class Flown:
    """One flight. Vehicle ids are 1..n, as columns of the recording."""

    folder: Path
    title: str
    mission: Mission  # as flown
    recording: Recording
    stand: Stand
    frame: LocalFrame
    faults: tuple[FaultEvent, ...]
    start_us: int  # Unix time of the recording's time 0; 0: no telemetry log has it

    @property
    def ids(self) -> range:
        """Of the vehicles."""
        return range(1, self.recording.on_ground.shape[1] + 1)

    def rows(self, rate_hz: float) -> Ints:
        """Ticks to show at about `rate_hz`; the first and the last are among them."""
        return rows_at(self.recording.time_s, rate_hz)

    def position(self, row: int, vehicle_id: int) -> Wgs84:
        """Position of a vehicle."""
        north, east, down = self.recording.pos_ned_m[row, vehicle_id - 1].tolist()
        return self.frame.to_wgs84((north, east, down))

    def at(self, row: int) -> datetime:
        """Time of a tick, UTC."""
        microseconds = self.start_us + round(float(self.recording.time_s[row]) * 1e6)
        return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=microseconds)

    def route_points(self) -> Iterator[tuple[str, Wgs84]]:
        """d1, the stops or the ends of lanes, d2, with their names."""
        for name, pos_enu_m in self.mission.named_places:
            yield name, self.frame.to_wgs84(enu_to_ned(pos_enu_m))

    def fence(self) -> list[Wgs84]:
        """The fence's vertices on the ground, as the mission has them; empty: it has none."""
        polygon = self.mission.fence.polygon_enu_m or ()
        return [self.on_ground(east_m, north_m) for east_m, north_m in polygon]

    def on_ground(self, east_m: float, north_m: float, up_m: float = 0.0) -> Wgs84:
        """A place `up_m` above the ground."""
        return self.frame.to_wgs84((north_m, east_m, -self.stand.ground_up_m(east_m, north_m) - up_m))

    @cached_property
    def telemetry(self) -> dict[int, Telemetry]:
        """Content of the telemetry logs, by vehicle."""
        return {k: read_telemetry(self.folder / f"vehicle-{k}.tlog", self.start_us) for k in self.ids}


def rows_at(time_s: Floats, rate_hz: float) -> Ints:
    """Indices into `time_s`, which holds at least one, at about `rate_hz`; the first and the last are among them."""
    step = max(1, round(len(time_s) / max(rate_hz * (time_s[-1] - time_s[0]), 1.0)))
    rows = np.arange(0, len(time_s), step)
    return rows if rows[-1] == len(time_s) - 1 else np.append(rows, len(time_s) - 1)


def sampled(recording: Recording, rows: Ints) -> Recording:
    """`recording` with the ticks `rows` alone."""
    return replace(recording, **{f.name: getattr(recording, f.name)[rows] for f in fields(recording)})


def load(folder: Path) -> Flown:
    """The flight in `folder`. RunFolderError or MissionError: it is not that of a flight."""
    recording = run_folder.load(folder)
    mission = load_mission(folder / MISSION_NAME)
    if not len(recording.time_s):
        raise run_folder.RunFolderError(f"{folder / run_folder.FILE_NAME}: holds no tick: nothing was flown")
    n = recording.on_ground.shape[1]
    if n != mission.swarm.size:
        place = f"{folder / MISSION_NAME}: swarm.size = {mission.swarm.size}"
        raise run_folder.RunFolderError(f"{place}: must be {n}, as many vehicles as {run_folder.FILE_NAME} has")
    if mission.origin is None:
        raise run_folder.RunFolderError(f"{folder / MISSION_NAME}: has no [origin]: where on Earth was it flown?")
    return Flown(
        folder,
        mission.name or folder.resolve().name,
        mission,
        recording,
        stand_of(mission, folder),
        LocalFrame(mission.origin.wgs84),
        run_folder.load_faults(folder, n),
        started_us(folder, n),
    )
