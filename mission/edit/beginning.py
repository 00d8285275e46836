"""Begin a mission from a stem map: a text that lacks d1 and d2 alone."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Final

from mission.common.files import MAX_PLACE_CHARS, read_bytes, refused
from mission.common.problems import MissionError, printable
from mission.edit.ground import SUFFIXES
from mission.stems.stem_files import MAX_STEM_BYTES
from mission.stems.stem_map import StemMap, read_stems

HEIGHT_MAX_M: Final = 8.0  # as the examples fly in the open
HEIGHT_MIN_M: Final = 2.5  # above the least height of the fence, with what is kept of it
BELOW_CROWNS_M: Final = 0.5  # the fence's top below the lowest crown
BELOW_FENCE_M: Final = 0.8  # the flight below the fence's top: what is kept of it, and room to hold a height in
OPEN_TOP_M: Final = 30.0  # of a fence where nothing hangs

_TEXT: Final = """\
schema = 1
name = {name}
{origin}
[route]                         # d1_enu_m and d2_enu_m: click them on the map
vel_leader_mps = 2.0
at_end = "return"

[swarm]
size = 8

[fence]
altitude_min_m = 2.0
altitude_max_m = {top_m:.1f}{why}
{sensing}"""
_SENSING: Final = """
[sensing]                       # what each vehicle's own sensor sees of the trees
range_m = 8.0

[forest]
file = {file}
"""
_ORIGIN: Final = """
[origin]                        # of the stem map
lat_deg = {lat_deg:.7f}
lon_deg = {lon_deg:.7f}
alt_m = 0.0                     # to be set: of the ground, above sea level
"""


def begin_text(name: str, stem_file: Path | None) -> str:
    """TOML of a new mission, in the stand of `stem_file` beside it if there is one. MissionError: it cannot be read."""
    stems = None if stem_file is None else read_stems(stem_file)
    low_m = lowest_crown_m(stems)
    origin = "" if stems is None or stems.origin is None else _ORIGIN.format(**_degrees(stems))
    return _TEXT.format(
        name=_quoted(name),
        origin=origin,
        top_m=top_m(low_m),
        why="" if low_m is None else f"            # the lowest crown begins at {low_m:.1f} m",
        sensing="" if stem_file is None else _SENSING.format(file=_quoted(stem_file.name)),
    )


def lowest_crown_m(stems: StemMap | None) -> float | None:
    """Height above the ground at which crowns begin; None where nothing stands."""
    trees = () if stems is None else stems.trees
    return min((tree.crown_base_m for tree in trees if tree.crown_base_m < tree.height_m), default=None)


def top_m(low_m: float | None) -> float:
    """Top of the fence below crowns that begin at `low_m`."""
    if low_m is None:
        return OPEN_TOP_M
    return max(HEIGHT_MIN_M + BELOW_FENCE_M, math.floor(10.0 * (low_m - BELOW_CROWNS_M)) / 10.0)


def flight_height_m(fence_top_m: float) -> float:
    """Height at which the page puts points, below the top of the fence."""
    return round(min(HEIGHT_MAX_M, max(HEIGHT_MIN_M, fence_top_m - BELOW_FENCE_M)), 1)


def bring_stems(source: Path, folder: Path) -> Path:
    """The stem map beside the mission: `source` if it is there, else a copy. MissionError: it cannot be."""
    place = printable(os.fsdecode(source), MAX_PLACE_CHARS)
    if source.suffix.lower() not in SUFFIXES:
        raise refused(place, None, f"must be a stem map that missions can name: {', '.join(SUFFIXES)}")
    return put_stems(source.name, read_bytes(source, place, MAX_STEM_BYTES), folder)


def put_stems(name: str, data: bytes, folder: Path) -> Path:
    """Writes a stem map into `folder`, unless it is there. MissionError: another of this name is, or it is none."""
    place = printable(name, MAX_PLACE_CHARS)
    target = folder / name
    if Path(name).name != name or name in ("", ".", "..") or target.suffix.lower() not in SUFFIXES:
        raise refused(place, None, f"must be the name of a stem map: {', '.join(SUFFIXES)}")
    try:
        with target.open("xb") as file:
            try:
                file.write(data)
                file.flush()
                read_stems(target)
            except (OSError, MissionError):
                target.unlink()
                raise
    except FileExistsError:
        if read_bytes(target, place, MAX_STEM_BYTES) != data:
            raise refused(place, None, "another file of this name is beside the mission already: rename one") from None
        return target
    except (OSError, ValueError) as error:
        reason = os.strerror(error.errno or 0) if isinstance(error, OSError) else "is no name of a file"
        raise refused(place, None, f"cannot be written beside the mission: {reason}") from None
    return target


def _degrees(stems: StemMap) -> dict[str, float]:
    assert stems.origin is not None
    return {"lat_deg": stems.origin.lat_deg, "lon_deg": stems.origin.lon_deg}


def _quoted(text: str) -> str:
    """As a string of TOML."""
    return json.dumps(text, ensure_ascii=False)
