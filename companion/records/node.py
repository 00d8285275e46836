"""Opens the records of one node, as its mission has them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from companion.mavlink.peers.session import Session
from companion.records.exchange import RecordExchange
from companion.records.record import BASE_ID
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.keys import mission_hash, record_keys
from companion.records.store import MEMORY, RecordStore, StoreError, open_store
from companion.records.summary import StandFusion
from companion.records.write_queue import DirectWriter, RecordWriter
from mission.document.model import Mission

BIT_RATE_KBPS: Final = 1000.0  # where the mission says nothing: the slowest that 802.11 broadcasts at


def open_records(
    mission: Mission,
    me: int,
    path: Path | None,
    draw: Callable[[], int],
    *,
    writer: Callable[[RecordStore], RecordWriter] = DirectWriter,
    fusion: Callable[[RecordStore], StandFusion | None] = lambda _: None,
    is_synced: bool = True,
    session: Session | None = None,
) -> RecordExchange:
    """A vehicle's (`me`: its id), of a mission that surveys. `path` None: in memory alone; `is_synced`: see the store.

    `fusion`: what makes a stand of the records while it leads. `session`: its keys, in a swarm that has them.

    So it is, too, where the disk does not let it be opened: a companion that starts again in flight must fly on. Then
    `unstored` of what is returned says why. StoreError: the file is another's, or of another mission.
    """
    said, unstored, mission_id = "", "", mission_hash(mission)
    keys = record_keys(session, mission_id)
    try:
        if path is None:
            store = RecordStore(MEMORY, me, draw, keys=keys)
        else:
            store, said = open_store(path, me, draw, is_synced=is_synced, mission_hash=mission_id, keys=keys)
    except StoreError as error:
        if error.is_foreign:
            raise
        store = RecordStore(MEMORY, me, draw, keys=keys)
        unstored = str(error)
        said = f"{unstored}: in memory"
    exchange: RecordExchange
    common = (store, writer(store), me, mission.swarm.size, bit_rate_kbps(mission))
    if keys is None:
        exchange = RecordExchange(*common, mission_hash=mission_id, fusion=fusion(store))
    else:
        exchange = SignedExchange(*common, keys=keys, fusion=fusion(store))
    exchange.unstored = unstored
    if said:
        exchange.note_line(f"records: {said}")
    return exchange


def open_base(
    mission: Mission,
    path: Path | None,
    draw: Callable[[], int],
    *,
    made_s: int,
    is_synced: bool = True,
    session: Session | None = None,
) -> RecordExchange:
    """The base station's. `made_s`: UTC now, for a file that is new. StoreError where it cannot be opened."""
    mission_id = mission_hash(mission)
    keys = record_keys(session, mission_id)
    if path is None:
        store, said = RecordStore(MEMORY, BASE_ID, draw, keys=keys), ""
    else:
        store, said = open_store(path, BASE_ID, draw, is_synced=is_synced, mission_hash=mission_id, keys=keys)
    epoch = store.made(made_s)
    exchange: RecordExchange
    common = (store, DirectWriter(store), BASE_ID, mission.swarm.size, bit_rate_kbps(mission))
    if keys is None:
        exchange = RecordExchange(*common, epoch=epoch, mission_hash=mission_id)
    else:
        exchange = SignedExchange(*common, keys=keys, epoch=epoch)
    if said:
        exchange.note_line(f"records: {said}")
    return exchange


def bit_rate_kbps(mission: Mission) -> float:
    """Of the channel that all share."""
    return BIT_RATE_KBPS if mission.radio.bit_rate_kbps is None else mission.radio.bit_rate_kbps
