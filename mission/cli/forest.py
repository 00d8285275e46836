"""`mission forest`: make stem maps, take over those of others, say what stands there, and draw it."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT

if TYPE_CHECKING:
    from mission.common.frames import Wgs84
    from mission.document.model import Mission
    from mission.stand.figures import Figures
    from mission.stand.stand import Stand

BARS = 40

_ABOUT = """\
What grows where a mission flies. A stem map is a file of trees, each with its place and its diameter at breast height:
CSV, GeoJSON or GeoPackage. A mission names the one beside it as [forest] file, or has the simulator grow a stand:
[forest.stand].
"""
_MAKE = """\
Writes the stand that [forest.stand] grows as a stem map: that of a mission, or one of keys given here. The same keys
and seed give the same file everywhere.
"""
_MAKE_EXAMPLE = """\
examples:
  mission forest make --mission natural_stand.toml --seed 7 --out stems.csv
  mission forest make --area-m 200 100 --out stems.csv density_per_ha=600 dbh_mean_m=0.3 'species=["pine"]'
"""
_IMPORT = """\
Reads a foreign stem map and writes one of ours, in metres from an origin. Says what each column was taken for, what was
filled in (heights, crowns) and what was dropped.

CSV: a header, then a line for each tree, with commas, semicolons or tabs between. Needed are the place (lat and lon; or
east_m and north_m, metres from an origin of your own; or easting and northing, with --utm) and the diameter (dbh_cm,
dbh_mm or dbh_m). Known besides: height_m, crown_base_m, crown_radius_m, species.
GeoJSON: a FeatureCollection of points in WGS84 (RFC 7946), the same names as properties.
GeoPackage: its only layer of points, in WGS84, a UTM zone, or metres of your own; the same names as columns.
"""
_CHECK = """\
Says of each file what stands there: density, basal area, diameters, gaps between neighbouring trunks and how many of
them a vehicle passes with its margin; for a mission, also what its route meets. FILE is a mission or a stem map.
"""
_DRAW = "Draws the plan of a mission's stand, or of a stem map, as SVG: trunks, crowns, undergrowth, route and fence."


def add_parser(commands: Any) -> None:
    """`forest` with its own commands."""
    raw = argparse.RawDescriptionHelpFormatter
    forest = commands.add_parser(
        "forest",
        help="make, import, check and draw stands of trees",
        description=_ABOUT,
        formatter_class=raw,
        allow_abbrev=False,
    )
    inner = forest.add_subparsers(dest="forest", required=True, metavar="COMMAND")

    make = inner.add_parser(
        "make",
        help="write the stand that a mission or keys grow as a stem map",
        description=_MAKE,
        epilog=_MAKE_EXAMPLE,
        formatter_class=raw,
        allow_abbrev=False,
    )
    make.add_argument("keys", nargs="*", metavar="KEY=VALUE", help="a key of [forest.stand], as in a mission")
    make.add_argument("--out", required=True, metavar="FILE", help="where to: .csv, .geojson or .gpkg")
    make.add_argument("--mission", metavar="FILE", help="whose stand; left out: one of the keys, without a route")
    make.add_argument(
        "--area-m",
        nargs=2,
        type=float,
        metavar=("EAST", "NORTH"),
        help="without --mission: the rectangle, from the origin (default: 200 100)",
    )
    make.add_argument("--seed", type=int, metavar="N", help="instead of the mission's (default without one: 1)")
    _add_origin(make, "for GeoJSON and GeoPackage: where the origin is on Earth; left out: as the mission says")

    imported = inner.add_parser(
        "import",
        help="turn a foreign stem map into one of ours",
        description=_IMPORT,
        formatter_class=raw,
        allow_abbrev=False,
    )
    imported.add_argument(
        "file", metavar="FILE", help="a stem map, .csv, .geojson or .gpkg (at most 8 MiB and 20,000 trees)"
    )
    imported.add_argument("--out", required=True, metavar="FILE", help="where to: .csv, .geojson or .gpkg")
    imported.add_argument("--utm", metavar="ZONE", help="zone of easting and northing: 32N, or EPSG:32632")
    _add_origin(imported, "that metres count from; left out: the median of the trees' places")

    check = inner.add_parser("check", help="say what stands there", description=_CHECK, allow_abbrev=False)
    check.add_argument(
        "files", nargs="+", metavar="FILE", help="a mission (.toml) or a stem map (.csv, .geojson, .gpkg)"
    )
    check.add_argument("--mission", metavar="FILE", help="whose route is looked at in a stem map")
    check.add_argument("--json", action="store_true", help="print one JSON array, an object for each file")

    draw = inner.add_parser("draw", help="draw a plan of the stand", description=_DRAW, allow_abbrev=False)
    draw.add_argument("file", metavar="FILE", help="a mission (.toml) or a stem map (.csv, .geojson, .gpkg)")
    draw.add_argument("--mission", metavar="FILE", help="whose route and fence are drawn into a stem map")
    draw.add_argument("--out", required=True, metavar="FILE.svg", help="where to")


def _add_origin(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--origin", nargs=2, type=float, metavar=("LAT", "LON"), help=text)


def run(args: argparse.Namespace) -> int:
    """One of the commands; MissionError is for the caller."""
    commands: dict[str, Callable[[argparse.Namespace], int]] = {
        "make": _make,
        "import": _import,
        "check": _check,
        "draw": _draw,
    }
    return commands[args.forest](args)


# --- make, import -----------------------------------------------------------------------------------------------------


def _make(args: argparse.Namespace) -> int:
    from mission.stand.stand import stand_of
    from mission.stems.stem_map import counted

    mission = _sown(args)
    stand = stand_of(mission, None if args.mission is None else Path(args.mission).parent)
    if not stand.trees and not stand.bushes:
        _refuse(args.mission or "KEY=VALUE", f"{_barren(mission)}: {args.out} is not written")
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
        _refuse("--area-m", f"must be two numbers above 0, at most {COORDINATE_MAX_M:g}")
    if args.seed is not None and not 0 <= args.seed < 2**32:
        _refuse("--seed", f"{args.seed}: must be an integer from 0 to {2**32 - 1}")
    if args.mission is None:
        values, place = _above(args.area_m or (200.0, 100.0)), "KEY=VALUE"
    elif args.area_m is not None:
        _refuse("--area-m", "is for a stand without a mission: with one, area_enu_m=[...]")
    else:
        values, place, line_of = load_document(args.mission)
    keys = _keys(args.keys)
    if args.seed is not None:
        if "seed" in keys:
            _refuse("--seed", "seed= says it as well: leave one out")
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
            _refuse(text, "must be KEY=VALUE, as density_per_ha=400")
        if key in keys:
            _refuse(text, f"{key} is given twice: leave one out")
        try:
            keys[key] = tomllib.loads(f"value = {value}")["value"]
        except (tomllib.TOMLDecodeError, RecursionError, ValueError):
            keys[key] = value
        if key == "species" and isinstance(keys[key], str):
            keys[key] = keys[key].split(",")
    return keys


def _import(args: argparse.Namespace) -> int:
    from mission.stems.stem_map import counted, read_stems
    from mission.stems.utm import zone_of

    zone = None
    if args.utm is not None:
        zone = zone_of(args.utm)
        if zone is None:
            _refuse("--utm", f"{args.utm}: must be a zone with its half, as 32N, or EPSG:32632")
    if Path(args.out).absolute() == Path(args.file).absolute():
        _refuse("--out", "must be another file than the one that is read")
    stems = read_stems(args.file, origin=_origin(args), zone=zone, lenient=True)
    if not _write(args.out, (stem.tree for stem in stems.stems), stems.origin or _origin(args)):
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
        _refuse("--origin", "must be a latitude from -85 to 85 and a longitude from -180 to 180 degrees")
    return Wgs84(lat_deg, lon_deg, 0.0)


def _write(out: str, trees: Any, origin: Wgs84 | None) -> bool:
    from mission.stems.geopackage_write import to_gpkg
    from mission.stems.write import to_csv, to_geojson

    suffix = Path(out).suffix.lower()
    if suffix == ".csv":
        text = to_csv(trees)
    elif suffix in (".geojson", ".json"):
        if origin is None:
            _refuse("--out", f"{out}: GeoJSON is on Earth: give --origin LAT LON")
        text = to_geojson(trees, origin)
    elif suffix == ".gpkg":
        return _written(out, to_gpkg(list(trees), origin))
    else:
        _refuse("--out", f"{out}: must end in .csv, .geojson or .gpkg")
    return _written(out, text.encode())


def _written(out: str, data: bytes) -> bool:
    """Writes `data` to the file `out`; False, and a message, where it cannot."""
    try:
        Path(out).write_bytes(data)
    except OSError as error:
        print(f"mission: cannot write {out}: {os.strerror(error.errno or 0)}", file=sys.stderr)
        return False
    return True


def _refuse(place: str, message: str) -> NoReturn:
    from mission.common.files import refused

    raise refused(place, None, message)


# --- check, draw ------------------------------------------------------------------------------------------------------


def _check(args: argparse.Namespace) -> int:
    from dataclasses import asdict

    from mission.common.problems import MissionError

    code = EXIT_DONE
    results: list[dict[str, Any]] = []
    for file in args.files:
        try:
            figures, notes = _judged(file, args.mission)
        except MissionError as error:
            code = EXIT_BAD_FILE
            results.append({"file": file, "ok": False, "problems": [asdict(problem) for problem in error.problems]})
            if not args.json:
                print(error, file=sys.stderr)
            continue
        told = None if figures is None else asdict(figures)
        results.append({"file": file, "ok": True, "figures": told, "notes": list(notes), "problems": []})
        if not args.json:
            print("\n".join(_lines(file, figures, notes)))
    if args.json:
        print(json.dumps(results, indent=2))
    return code


def _judged(file: str, mission_file: str | None) -> tuple[Figures | None, tuple[str, ...]]:
    """The figures of a stand, None for one without trees, and what is to be known of it."""
    from mission.cli.forest_notes import notes_of
    from mission.stand.figures import area_of, figures_of

    stand, mission, read = _stand(file, mission_file)
    notes = [*read, *(() if mission is None else notes_of(stand, mission))]
    if not stand.trees:
        return None, tuple(notes)
    area = None if mission is None else area_of(mission)
    return figures_of(stand, area=area, sensing=mission.sensing if mission else None), tuple(notes)


def _stand(file: str, mission_file: str | None) -> tuple[Stand, Mission | None, tuple[str, ...]]:
    """The stand, the mission that flies in it, and what was read."""
    from mission.common.problems import MissionError, first_of
    from mission.document.load import load_mission
    from mission.stand.resolve import resolve_stand
    from mission.stand.stand import Stand, map_problems
    from mission.stems.stem_map import read_stems

    if Path(file).suffix.lower() == ".toml":
        if mission_file is not None:
            _refuse("--mission", "is for stem maps: this is a mission")
        mission = load_mission(file)
        return resolve_stand(mission, file), mission, ()
    flown = None if mission_file is None else load_mission(mission_file)
    origin = None if flown is None or flown.origin is None else flown.origin.wgs84
    stems = read_stems(file, origin=origin, lenient=True)
    if flown is not None:
        if origin is None and stems.origin is not None:
            _refuse(file, "is in degrees: the mission needs an [origin] to say where it is")
        found = list(map_problems(flown, stems))
        if found:
            raise MissionError(first_of(found, stems.place))
    grade = (0.0, 0.0) if flown is None else flown.forest.grade
    return Stand(stems.trees, stems.bushes, grade), flown, stems.notes


def _lines(file: str, figures: Figures | None, notes: Sequence[str]) -> list[str]:
    """For people."""
    from mission.stems.stem_map import counted

    if figures is None:
        return [f"{file}: no trees", *(f"  {note}" for note in notes)]
    f = figures
    bushes = f", {f.bushes} bushes" if f.bushes else ""
    sizes = f"diameters {f.dbh_cm[0]:.0f} to {f.dbh_cm[2]:.0f} cm, mean {f.dbh_cm[1]:.1f}"
    spread = "" if f.area_ha is None else f" on {f.area_ha:.2f} ha, {f.density_per_ha:.0f} per hectare"
    basal = "" if f.basal_area_m2_per_ha is None else f"basal area {f.basal_area_m2_per_ha:.1f} m2/ha; "
    lines = [
        f"{file}: {counted(f.trees)}{spread}{bushes}",
        f"  {basal}{sizes}, quadratic mean {f.dbh_quadratic_mean_cm:.1f}",
    ]
    fullest = max(count for _, count in f.dbh_classes)
    for low_cm, count in f.dbh_classes:
        bar = "#" * round(BARS * count / fullest)
        lines.append(f"  {low_cm:5d} to {low_cm + 10} cm {count:6d} {bar}".rstrip())
    lines.append(f"  heights {f.height_m[0]:.1f} to {f.height_m[1]:.1f} m, crowns from {f.crowns_from_m:.1f} m up")
    if f.gap_least_m is not None:
        lines.append(
            f"  gaps between neighbouring trunks: least {f.gap_least_m:.2f} m, median {f.gap_median_m:.2f} m; "
            f"{f.gaps_passed} of {f.gaps} are at least {f.passes_m:.2f} m, which a vehicle passes with its margin"
        )
    if f.too_narrow:
        named = "; ".join(f"{gap:.2f} m at {east:.1f} east, {north:.1f} north" for gap, east, north in f.too_narrow)
        lines.append(f"  too narrow: {named}{'; ...' if f.gaps - f.gaps_passed > len(f.too_narrow) else ''}")
    return lines + [f"  {note}" for note in notes]


def _draw(args: argparse.Namespace) -> int:
    from mission.stand.drawing import drawn
    from mission.stems.stem_map import counted

    if Path(args.out).suffix.lower() != ".svg":
        _refuse("--out", f"{args.out}: must end in .svg")
    stand, mission, _ = _stand(args.file, args.mission)
    try:
        text = drawn(stand, mission, os.path.basename(args.file))
    except ValueError:
        _refuse(args.file, "has nothing to draw")
    if not _written(args.out, text.encode()):
        return EXIT_ENVIRONMENT
    print(f"{args.out}: {counted(len(stand.trees))}")
    return EXIT_DONE
