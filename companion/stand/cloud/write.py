"""The point cloud beside a stand's other products."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from companion.cloud.returns import StemReturns
from companion.cloud.returns_reader import ReturnsFileError, read_returns
from companion.stand.cloud.las import to_laz
from companion.stand.cloud.merge import StandCloud, merge_returns
from companion.stand.products.write import Products, replace_file
from companion.stand.records import RecordLike
from companion.survey.observation import STEM_KIND
from mission.document.model import Mission

CLOUD_LAZ: Final = "cloud.laz"


class CloudWritten(NamedTuple):
    """The file, its points, and bytes of the vehicles' files that were none."""

    file: Path
    cloud: StandCloud
    torn_bytes: int


class VehicleReturns(NamedTuple):
    """Passes in one vehicle's file."""

    path: Path
    passes: list[StemReturns]
    torn_bytes: int


def read_files(paths: Sequence[Path]) -> list[VehicleReturns]:
    """Vehicles' files of returns, in whatever order. ReturnsFileError."""
    return [VehicleReturns(path, *read_returns(path)) for path in sorted(paths)]


def check_flight(file: VehicleReturns, records: Iterable[RecordLike]) -> str:
    """Check that a file is of the flight that the records are of; the doubt that is left, in words, or "".

    A pass bears the body of its record. ReturnsFileError: none of these is among `records`.
    """
    here = {(record.vehicle_id, record.body) for record in records if record.kind == STEM_KIND}
    bodies = [(one.vehicle_id, one.body) for one in file.passes if one.body]
    strange = sum(body not in here for body in bodies)
    if not strange:
        unknown = f"{file.path}: of which flight cannot be told: none of its stems has a record"
        return unknown if file.passes and not bodies else ""
    if strange == len(bodies):
        vehicle_id = bodies[0][0]
        raise ReturnsFileError(
            f"{file.path}: returns of another flight, or mission: none of its {strange} stems is among the records; "
            f"if vehicle {vehicle_id} flew here, and has delivered nothing, give its own store of records, too"
        )
    return f"{file.path}: {strange} of its {len(bodies)} stems are not among the records: never delivered, or of others"


def write_cloud(files: Sequence[VehicleReturns], stand: Products, mission: Mission, out_dir: Path) -> CloudWritten:
    """Of the vehicles' files of returns. OSError; the file is replaced whole."""
    passes = sorted(
        (one.passes for one in files), key=lambda one: (one[0].vehicle_id, one[0].first_s) if one else (0, 0.0)
    )
    cloud = merge_returns(passes, stand.harvest.observations, stand.fusion)
    file = out_dir / CLOUD_LAZ
    replace_file(file, to_laz(cloud, None if mission.origin is None else mission.origin.wgs84))
    return CloudWritten(file, cloud, sum(one.torn_bytes for one in files))


def describe_cloud(written: CloudWritten) -> str:
    """In a line."""
    cloud = written.cloud
    of_stems, trees = int(cloud.of_stem.sum()), len(set(cloud.tree.tolist()) - {0})
    torn = f"; {written.torn_bytes} bytes could not be read" * bool(written.torn_bytes)
    return f"cloud: {cloud.n} points, {of_stems} of them on {trees} stems{torn}"
