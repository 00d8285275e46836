"""Records that vehicles kept in a run folder, by their own files."""

from __future__ import annotations

from pathlib import Path

from companion.records.record import RecordKind
from companion.records.store import RecordStore


def records_in(folder: Path, vehicle_id: int) -> list[tuple[int, bytes]]:
    """Kinds and bodies of what one vehicle recorded itself."""
    store = RecordStore(folder / "companions" / f"records-{vehicle_id}.db", vehicle_id, lambda: 0)
    try:
        return [(kind, row[-1]) for kind in RecordKind for row in store.records(kind) if row[0] == vehicle_id]
    finally:
        store.close()
