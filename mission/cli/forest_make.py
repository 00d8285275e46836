"""`mission forest make` and `import`: stem maps from a stand that is generated, and from those of others."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mission.cli.forest_files import refuse, written
from mission.common.exit_codes import EXIT_DONE, EXIT_ENVIRONMENT

if TYPE_CHECKING:
    from mission.common.frames import Wgs84
    from mission.document.model import Mission
    from mission.schema.trees import StandTree


def make(args: argparse.Namespace) -> int:
    """The exit code; MissionError is for the caller."""
    from mission.stand.stand import stand_of
    from mission.stems.stem_map import counted

    mission = _sown(args)
    stand = stand_of(mission, None if args.mission is None else Path(args.mission).parent)
    if not stand.trees and not stand.bushes:
        refuse(args.mission or "KEY=VALUE", f"{_barren(mission)}: {args.out} is not written")
    origin = _origin(args) or (None if mission.origin is None else mission.origin.wgs84)
    bushes = f" and {len(stand.bushes)} bushes" if stand.bushes else ""
    if not _write(args.out, (*stand.trees, *stand.bushes), origin):
        return EXIT_ENVIRONMENT
    print(f"{args.out}: {counted(len(stand.trees))}{bushes}")
    return EXIT_DONE


def _barren(mission: Mission) -> str:
    """The reason why nothing grows."""
    from mission.common.plane import area_m2
    from mission.rules.forest_rules import stand_area
    from mission.schema.forest import M2_PER_HA

    spec = mission.forest.stand
    if spec is None:
        return "has no trees in its [forest]"
    area_ha = area_m2(stand_area(mission, spec)) / M2_PER_HA
    return f"forest.stand.density_per_ha = {spec.density_per_ha:g} grows no tree on {area_ha:.2f} ha"


def _sown(args: argparse.Namespace) -> Mission:
    """The mission whose stand is grown: the file's, or one that flies above a stand of its own."""
    from mission.document.load import load_document
    from mission.document.model import Mission
    from mission.schema.check import LineOf, no_line, validated
    from mission.schema.fields import COORDINATE_MAX_M

    line_of: LineOf = no_line
    if args.area_m is not None and not all(0.0 < side_m <= COORDINATE_MAX_M for side_m in args.area_m):
        refuse("--area-m", f"must be two numbers above 0, at most {COORDINATE_MAX_M:g}")
    if args.seed is not None and not 0 <= args.seed < 2**32:
        refuse("--seed", f"{args.seed}: must be an integer from 0 to {2**32 - 1}")
    if args.mission is None:
        values, place = _above(args.area_m or (200.0, 100.0)), "KEY=VALUE"
    elif args.area_m is not None:
        refuse("--area-m", "is for a stand without a mission: with one, area_enu_m=[...]")
    else:
        values, place, line_of = load_document(args.mission)
    keys = _keys(args.keys)
    if args.seed is not None:
        if "seed" in keys:
            refuse("--seed", "seed= says it as well: leave one out")
        keys["seed"] = args.seed
    forest = values.setdefault("forest", {})
    if isinstance(forest, dict) and keys:
        stand = forest.setdefault("stand", {})
        if isinstance(stand, dict):
            stand.update(keys)
    return validated(Mission, values, place, line_of)


def _above(area_m: Sequence[float]) -> dict[str, Any]:
    """A mission that asks nothing of its stand: one vehicle, high over the corner of the area."""
    east_m, north_m = area_m
    return {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 500.0), "d2_enu_m": (100.0, 0.0, 500.0), "vel_leader_mps": 1.0},
        "swarm": {"size": 1},
        "coverage": {"shape": "sphere"},
        "fence": {"altitude_max_m": 1_000.0},
        "forest": {"stand": {"area_enu_m": ((0.0, 0.0), (east_m, 0.0), (east_m, north_m), (0.0, north_m))}},
    }


def _keys(texts: Sequence[str]) -> dict[str, Any]:
    """KEY=VALUE as TOML has it; a bare word is text."""
    keys: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals:
            refuse(text, "must be KEY=VALUE, as density_per_ha=400")
        if key in keys:
            refuse(text, f"{key} is given twice: leave one out")
        try:
            keys[key] = tomllib.loads(f"value = {value}")["value"]
        except (tomllib.TOMLDecodeError, RecursionError, ValueError):
            keys[key] = value
        if key == "species" and isinstance(keys[key], str):
            keys[key] = keys[key].split(",")
    return keys


def take_over(args: argparse.Namespace) -> int:
    """The exit code; MissionError is for the caller."""
    from mission.stems.columns import mapping_of
    from mission.stems.numbers import COMMA, POINT
    from mission.stems.stem_map import counted, read_stems
    from mission.stems.utm import zone_of

    zone = None
    if args.utm is not None:
        zone = zone_of(args.utm)
        if zone is None:
            refuse("--utm", f"{args.utm}: must be a zone with its half, as 32N, or EPSG:32632")
    if Path(args.out).absolute() == Path(args.file).absolute():
        refuse("--out", "must be another file than the one that is read")
    try:
        columns = mapping_of(args.column)
    except ValueError as error:
        refuse("--column", str(error))
    signs = {None: None, "comma": COMMA, "point": POINT}[args.decimal]
    stems = read_stems(args.file, origin=_origin(args), zone=zone, lenient=True, columns=columns, signs=signs)
    trees, ids = [stem.tree for stem in stems.stems], [stem.id for stem in stems.stems]
    if not _write(args.out, trees, stems.origin or _origin(args), ids):
        return EXIT_ENVIRONMENT
    print(f"{args.out}: {counted(len(stems.trees))}")
    for note in stems.notes:
        print(f"  {note}")
    if stems.origin is not None:
        print("  a mission in it says where it is by")
        print(f"    [origin]\n    lat_deg = {stems.origin.lat_deg:.7f}\n    lon_deg = {stems.origin.lon_deg:.7f}")
        print("    alt_m = 0.0  # to be set: of the ground, above sea level")
    return EXIT_DONE


def _origin(args: argparse.Namespace) -> Wgs84 | None:
    from mission.common.frames import Wgs84

    if args.origin is None:
        return None
    lat_deg, lon_deg = args.origin
    if not (abs(lat_deg) <= 85.0 and abs(lon_deg) <= 180.0):
        refuse("--origin", "must be a latitude from -85 to 85 and a longitude from -180 to 180 degrees")
    return Wgs84(lat_deg, lon_deg, 0.0)


def _write(out: str, trees: Sequence[StandTree], origin: Wgs84 | None, ids: Sequence[str] = ()) -> bool:
    from mission.stems.geopackage_write import to_gpkg
    from mission.stems.write import to_csv, to_geojson

    suffix = Path(out).suffix.lower()
    if suffix == ".csv":
        text = to_csv(trees, ids)
    elif suffix in (".geojson", ".json"):
        if origin is None:
            refuse("--out", f"{out}: GeoJSON is on Earth: give --origin LAT LON")
        text = to_geojson(trees, origin, ids)
    elif suffix == ".gpkg":
        return written(out, to_gpkg(trees, origin, ids))
    else:
        refuse("--out", f"{out}: must end in .csv, .geojson or .gpkg")
    return written(out, text.encode())
