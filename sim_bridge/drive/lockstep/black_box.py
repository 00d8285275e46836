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

MakesBox = Callable[[int, Guard | None, OrderBook | None], "SimulatedBox | None"]
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
        self._writer: Final = DirectWriter(files_of(folder, start, waits_for_disk=False))
        self._box: Final = BlackBox(self._writer, start)
        self.guard: Final = self._box.record_guard(guard)
        self.orders: Final = self._box.record_orders(orders)

    def link(self, records: RecordLink | None) -> RecordLink | None:
        """The link of records to build the endpoint with."""
        return self._box.record_link(records)

    def record_endpoint(self, endpoint: Endpoint) -> Recorder:
        """Takes the endpoint's inputs from now on."""
        return self._box.record_endpoint(endpoint)

    def fill(self, *, full: bool) -> None:
        """Nothing more is written, or again."""
        self._writer.fill(full=full)


def boxes_of(mission: Mission, folder: Path | None, flown_by: str) -> MakesBox:
    """Makes the black box of a vehicle's companion, with guard and orders, in `folder` of a run; None: none."""
    if folder is None:
        return lambda _vehicle_id, _guard, _orders: None
    text, boxes = dump_mission(mission), folder / FOLDER_NAME
    return lambda vehicle_id, guard, orders: SimulatedBox(
        boxes, mission, text, vehicle_id, flown_by=flown_by, guard=guard, orders=orders
    )


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
