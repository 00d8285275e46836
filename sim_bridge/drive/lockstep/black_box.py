"""Black boxes of companions in this process, as those of processes write them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

from companion.journal.recorder import BlackBox, Recorder, files_of, start_body
from companion.journal.segments import DirectWriter
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.harvest import RecordLink
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.peers.guard import Guard
from companion.sensors.table import kinds_of
from mission.document.load import dump_mission
from mission.document.model import Mission
from sim_bridge.options.report import BOXES_NAME

FOLDER_NAME: Final = BOXES_NAME
WAIVED: Final = "all"  # as `--waive all` of a companion that is a process


class SimulatedBox:
    """The black box of one companion in this process, on a disk that a fault fills."""

    def __init__(
        self,
        folder: Path,
        mission: Mission,
        mission_file: str,
        vehicle_id: int,
        *,
        flown_by: str = "",
        guard: Guard | None = None,
        orders: OrderBook | None = None,
    ) -> None:
        """`mission_file`: the text of mission.toml. `guard`: with keys; `orders`: of the operator's key."""
        start = start_body(
            mission,
            mission_file,
            hashlib.sha256(mission_file.encode()).hexdigest(),
            vehicle_id,
            sensors=list(kinds_of(mission)),
            clock="simulated",
            has_survey=mission.survey is not None,
            has_records=mission.keeps_records,
            waived=WAIVED,
            unsigned=guard is None,
            flown_by=flown_by,
            guard=guard,
            orders=orders,
        )
        self.vehicle_id: Final = vehicle_id
        self._recorder: Recorder | None = None
        self._writer: Final = DirectWriter(files_of(folder, start, waits_for_disk=False))
        self._box: Final = BlackBox(self._writer, start)
        self.guard: Final = self._box.record_guard(guard)
        self.orders: Final = self._box.record_orders(orders)

    def link(self, records: RecordLink | None) -> RecordLink | None:
        """The link of records to build the endpoint with."""
        return self._box.record_link(records)

    def record_endpoint(self, endpoint: Endpoint) -> Recorder:
        """Takes the endpoint's inputs from now on."""
        self._recorder = self._box.record_endpoint(endpoint)
        return self._recorder

    @property
    def incomplete(self) -> str:
        """Words for the ticks that are lost, once the box is closed; empty: none."""
        return "" if self._recorder is None else self._recorder.journal.incomplete

    def fill(self, *, full: bool) -> None:
        """Nothing more is written, or again."""
        self._writer.fill(full=full)


class Boxes:
    """Black boxes of all companions in this process: of one that is started again, another one."""

    def __init__(self, mission: Mission, folder: Path | None, flown_by: str) -> None:
        """In `folder` of a run; None: no companion keeps one."""
        self._mission: Final = mission
        self._text: Final = dump_mission(mission)
        self._folder: Final = None if folder is None else folder / FOLDER_NAME
        self._flown_by: Final = flown_by
        self._made: Final[list[SimulatedBox]] = []

    def make_box(self, vehicle_id: int, guard: Guard | None, orders: OrderBook | None) -> SimulatedBox | None:
        """The box of one vehicle's companion, to be built with this guard and these orders; None: it keeps none."""
        if self._folder is None:
            return None
        box = SimulatedBox(
            self._folder, self._mission, self._text, vehicle_id, flown_by=self._flown_by, guard=guard, orders=orders
        )
        self._made.append(box)
        return box

    def tell_losses(self, say: Callable[[str], None]) -> None:
        """Name those that lack something, once they are closed: nobody reads what a companion here logs."""
        for box in self._made:
            if box.incomplete:
                say(f"{self._folder}: black box of vehicle {box.vehicle_id}: {box.incomplete}")


def run_recorded(
    recorder: Recorder, from_peers: bytes, from_sensor: bytes, from_autopilot: bytes, now_s: float
) -> tuple[bytes, bytes]:
    """One tick of a companion: its answer (to the peers, to the autopilot)."""
    recorder.from_peers(from_peers, now_s)
    if from_sensor:
        recorder.from_sensor(from_sensor, now_s)
    recorder.from_autopilot(from_autopilot, now_s)
    out = recorder.tick(now_s)
    return out.peers + b"".join(out.records), out.autopilot
