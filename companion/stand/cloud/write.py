"""The point cloud beside a stand's other products."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from companion.cloud.returns_reader import read_returns
from companion.stand.cloud.las import to_laz
from companion.stand.cloud.merge import StandCloud, merge_returns
from companion.stand.products.write import Products, replace_file
from mission.document.model import Mission

CLOUD_LAZ: Final = "cloud.laz"


class CloudWritten(NamedTuple):
    """The file, its points, and bytes of the vehicles' files that were none."""

    file: Path
    cloud: StandCloud
    torn_bytes: int


def write_cloud(files: Sequence[Path], stand: Products, mission: Mission, out_dir: Path) -> CloudWritten:
    """Of the vehicles' files of returns, in whatever order. ReturnsFileError, OSError; the file is replaced whole."""
    read = [read_returns(path) for path in sorted(files)]
    passes = sorted(
        (found for found, _ in read), key=lambda one: (one[0].vehicle_id, one[0].first_s) if one else (0, 0.0)
    )
    cloud = merge_returns(passes, stand.harvest.observations, stand.fusion)
    file = out_dir / CLOUD_LAZ
    replace_file(file, to_laz(cloud, None if mission.origin is None else mission.origin.wgs84))
    return CloudWritten(file, cloud, sum(torn for _, torn in read))


def describe_cloud(written: CloudWritten) -> str:
    """In a line."""
    cloud = written.cloud
    of_stems, trees = int(cloud.of_stem.sum()), len(set(cloud.tree.tolist()) - {0})
    torn = f"; {written.torn_bytes} bytes could not be read" * bool(written.torn_bytes)
    return f"cloud: {cloud.n} points, {of_stems} of them on {trees} stems{torn}"
