"""Files of a real vehicle's records and of its survey's returns, found and opened."""

from __future__ import annotations

import os
import secrets
from contextlib import ExitStack
from pathlib import Path

from companion.cloud.returns_file import ReturnsFile
from companion.cloud.returns_log import SUFFIX, DirectReturns, ReturnsLog
from companion.mavlink.peers.session import Session
from companion.records.exchange import RecordExchange
from companion.records.node import open_records
from companion.records.signed.keys import mission_hash
from companion.records.store import RecordStore
from companion.records.summary import StandFusion
from companion.records.write_queue import DirectWriter, RecordWriter
from companion.shell.record_writer import BesideLoop, ThreadedWriter
from companion.shell.service import STATE
from companion.shell.stand_fusion import FusionChild, FusionProcess
from mission.document.model import Mission


def records_of(
    mission: Mission,
    vehicle_id: int,
    path: Path,
    opened: ExitStack,
    *,
    mission_file: Path,
    beside_loop: bool,
    session: Session | None = None,
) -> RecordExchange:
    """This vehicle's records in `path`. `beside_loop`: written and fused there, else while the loop waits.

    `session`: its keys, in a swarm that has them. StoreError: the file is another's, or of another mission.
    """

    def writer(store: RecordStore) -> RecordWriter:
        opened.callback(store.close)
        if not beside_loop:
            return DirectWriter(store)
        made = ThreadedWriter(store)
        opened.callback(made.close)  # before the file
        return made

    def fusion(store: RecordStore) -> StandFusion | None:
        if mission.survey is None:
            return None
        if not beside_loop:
            from companion.stand.summarise import DirectFusion  # SciPy: a simulation's process

            return DirectFusion(store, mission)
        made = FusionProcess(FusionChild(mission_file, path))
        opened.callback(made.close)
        return made

    return open_records(mission, vehicle_id, path, draw_log, writer=writer, fusion=fusion, session=session)


def draw_log() -> int:
    """A random uint32, for a log that is begun."""
    return secrets.randbits(32)


def records_path(given: str | None, log: str | None, mission: Mission, vehicle_id: int) -> Path:
    """`given`, or a file of this vehicle and this mission beside the flight log, or where the service keeps its state.

    Another name or origin is another file: records of two missions are not mixed.
    """
    if given is not None:
        return Path(given)
    name = f"records-{vehicle_id}-{mission_hash(mission):08x}.db"
    folder = Path(log).parent if log is not None else Path(os.environ.get(STATE, "."))
    return folder / name


def open_returns(records: Path, opened: ExitStack, *, beside_loop: bool) -> tuple[ReturnsLog, Path]:
    """The log of returns beside a vehicle's `records`, and its file. `beside_loop`: as for these."""
    path = records.with_suffix(SUFFIX)
    file = ReturnsFile(records.with_name(records.name + SUFFIX) if path == records else path)
    if not beside_loop:
        return ReturnsLog(DirectReturns(file)), file.path
    writer = BesideLoop(file.write, "returns")
    opened.callback(writer.close)
    return ReturnsLog(writer), file.path
