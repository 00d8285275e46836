"""All products of a stand from its records, into a folder."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NamedTuple

from companion.stand.figures.estimate import SeenGround, figures_of
from companion.stand.form_height import FORM_HEIGHT_M
from companion.stand.fusion.fuse import Fusion, fuse
from companion.stand.products import payload
from companion.stand.products.report import report_page
from companion.stand.products.table import COLUMNS, rows_of, to_3dfin_csv, to_csv, to_geojson, to_json_lines
from companion.stand.records import Harvest, RecordLike, harvest_of
from mission import __version__
from mission.document.model import Mission
from mission.stems.geopackage_write import PointLayer, points_gpkg

LAYER: Final = "stems"
FORMAT: Final = "understory-stand"
VERSION: Final = 1
GEOJSON: Final = "stems.geojson"  # of missions with an origin alone
PAYLOAD_CSV: Final = "payload.csv"  # where vehicles recorded other sensors


class Products(NamedTuple):
    """Files that were written, and what they hold."""

    files: tuple[Path, ...]
    fusion: Fusion
    ground: SeenGround
    harvest: Harvest


def write_products(
    records: Iterable[RecordLike],
    mission: Mission,
    out_dir: Path,
    *,
    form_height_m: float = FORM_HEIGHT_M,
    origin_note: str = "",
) -> Products:
    """Files and report of `records` into `out_dir`, which is made. OSError names a file that cannot be written.

    Figures are of the mission's fence, where it has a polygon. A file is replaced whole, or left as it was;
    one of these names that is not written this time is removed.
    `origin_note`: what the report is to say of the mission's origin.
    """
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations, mission.without_satellites, harvest.track)
    area_m = mission.surveyed_enu_m
    ground = figures_of(harvest, fusion, area_m=area_m, form_height_m=form_height_m)
    out_dir.mkdir(parents=True, exist_ok=True)
    files = []
    for name, made in _texts(mission, harvest, fusion, ground, origin_note):
        files.append(out_dir / name)
        replace_file(files[-1], made())
    for name in {GEOJSON, PAYLOAD_CSV} - {file.name for file in files}:
        (out_dir / name).unlink(missing_ok=True)  # of a time before: other stems, on another spot of Earth
    return Products(tuple(files), fusion, ground, harvest)


def replace_file(file: Path, data: bytes) -> None:
    """`data` for all that `file` held. OSError that names it; then it is as it was."""
    scratch = file.with_name(f".{file.name}.part")
    try:
        scratch.write_bytes(data)
        os.replace(scratch, file)
    except OSError as error:
        with contextlib.suppress(OSError):
            scratch.unlink()
        raise OSError(error.errno, f"cannot be written: {error.strerror}", str(file)) from error


def _texts(
    mission: Mission, harvest: Harvest, fusion: Fusion, ground: SeenGround, origin_note: str
) -> Iterable[tuple[str, Callable[[], bytes]]]:
    """Names of the files, and how each is made."""
    origin = None if mission.origin is None else mission.origin.wgs84
    stems = fusion.stems
    columns = {column.name: column.kind for column in COLUMNS}
    layers = [PointLayer(LAYER, columns, [(s.east_m, s.north_m) for s in stems], rows_of(stems))]
    if harvest.payload:
        table = payload.table_of(harvest.payload)
        layers.append(payload.layer_of(table))
        yield PAYLOAD_CSV, lambda: payload.to_csv(table).encode()
    lidar, system = to_3dfin_csv(stems, origin)
    yield "stems.gpkg", lambda: points_gpkg(layers, origin)
    if origin is not None:
        yield GEOJSON, lambda: to_geojson(stems, origin).encode()
    yield "stems.csv", lambda: to_csv(stems).encode()
    yield "stems_3dfin.csv", lambda: lidar.encode()
    yield (
        "stand.json",
        lambda: (json.dumps(_figures(mission, harvest, fusion, ground, system), indent=1) + "\n").encode(),
    )
    yield "records.jsonl", lambda: to_json_lines(harvest).encode()
    yield "report.html", lambda: report_page(mission, harvest, fusion, ground, origin_note).encode()


def _figures(mission: Mission, harvest: Harvest, fusion: Fusion, ground: SeenGround, system: str) -> dict[str, Any]:
    """The stand's figures, as docs/reference/stand-files.md defines them."""
    figures = None if ground.figures is None else asdict(ground.figures)
    if ground.figures is not None and figures is not None:
        named = {k: v._asdict() for k, v in figures.items() if hasattr(v, "_asdict")}
        classes = [{"from_cm": c.from_cm, **c.stems_per_ha._asdict()} for c in ground.figures.classes]
        figures |= {**named, "classes": classes}
    return {
        "format": FORMAT,
        "version": VERSION,
        "made_by": f"understory {__version__}",
        "mission": mission.name,
        "sensor": None if mission.sensing is None else mission.sensing.sensor.value,
        "origin": None if mission.origin is None else mission.origin.model_dump(),
        "logs": [{**log._asdict(), "missing": log.missing} for log in harvest.counted()],
        "stems": len(fusion.stems),
        "stems_3dfin_xy": system,
        "figures": figures,
        "payload": [quantity._asdict() for quantity in payload.quantities_of(harvest.payload)],
    }


def describe_products(written: Products) -> str:
    """The finding, in a line."""
    lines = (written.harvest.missing_line(), written.harvest.unproven_line())
    found = f"{len(written.fusion.stems)} stems"
    if written.harvest.payload:
        found += f"; {len(written.harvest.payload)} values of other sensors"
    end = "".join(f"; {line}" for line in lines if line is not None)
    figures = written.ground.figures
    if figures is None:
        return f"{found}; too little ground was seen, or too few stems found, for figures per hectare{end}"
    basal = figures.basal_area_m2_per_ha
    spread = "" if basal.low is None or basal.high is None else f" ({basal.low:.1f} to {basal.high:.1f})"
    seen = f"{figures.seen_ha:.2f} ha seen"
    if figures.area_ha is not None:
        seen = f"{figures.seen_ha:.2f} of {figures.area_ha:.2f} ha seen ({100.0 * figures.seen_share:.0f} %)"
    return f"{found}; {seen}; basal area {basal.value:.1f} m2/ha{spread}{end}"
