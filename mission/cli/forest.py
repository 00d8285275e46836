"""`mission forest`: make stem maps, take over those of others, say what stands there, and draw it."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from mission.cli.forest_check import check, draw
from mission.cli.forest_make import make, take_over

_ABOUT = """\
Stem maps and forest stands. A stem map is a file of trees, each with its position and its diameter at breast height:
CSV, GeoJSON or GeoPackage. A mission names the one beside it as [forest] file, or has the simulator generate a
stand: [forest.stand].
"""
_MAKE = """\
Writes the stand that [forest.stand] describes as a stem map: that of a mission, or one of keys given here. The
same keys and seed give the same file everywhere.
"""
_IMPORT = """\
Reads another program's stem map and writes one as missions use, in metres from an origin. Says what each
column was taken for, which were not read, what was filled in (heights, crowns) and what was dropped.

CSV: a header, then a line for each tree, with commas, semicolons or tabs between; UTF-8, UTF-16 or older Windows text.
Needed are the place (lat and lon; or east_m and north_m, metres from an origin of your own; or easting and northing,
with --utm) and the diameter (dbh_cm, dbh_mm or dbh_m). Known besides: height_m, crown_base_m, crown_radius_m, species,
id. These names are also known in German, French, Finnish, Swedish, Spanish, Portuguese and Polish.
GeoJSON: a FeatureCollection of points in WGS84 (RFC 7946), the same names as properties.
GeoPackage: its only layer of points, in WGS84, a UTM zone, or metres of your own; the same names as columns.
"""
_CHECK = """\
Says of each file what stands there: density, basal area, diameters, gaps between neighbouring trunks and how many of
them a vehicle passes with its margin; for a mission, also what its route meets. FILE is a mission or a stem map.
"""
_DRAW = """\
Draws the plan of a mission's stand, or of a stem map, as SVG: trunks, crowns, undergrowth, route and fence, on a grid
of metres east and north of the origin; with latitudes and longitudes where it is known where that is.
"""


def add_parser(commands: Any) -> None:
    """`forest` with its own commands."""
    raw = argparse.RawDescriptionHelpFormatter
    forest = commands.add_parser(
        "forest",
        help="make, import, check and draw stands of trees",
        description=_ABOUT,
        formatter_class=raw,
    )
    inner = forest.add_subparsers(dest="forest", required=True, metavar="COMMAND")

    made = inner.add_parser(
        "make",
        help="generate a mission's stand, or one of keys, and write it as a stem map",
        description=_MAKE,
        formatter_class=raw,
    )
    made.add_argument("keys", nargs="*", metavar="KEY=VALUE", help="a key of [forest.stand], as in a mission")
    made.add_argument("--out", required=True, metavar="FILE", help="where to: .csv, .geojson or .gpkg")
    made.add_argument("--mission", metavar="FILE", help="whose stand; left out: one of the keys, without a route")
    made.add_argument(
        "--area-m",
        nargs=2,
        type=float,
        metavar=("EAST", "NORTH"),
        help="without --mission: the rectangle, from the origin (default: 200 100)",
    )
    made.add_argument("--seed", type=int, metavar="N", help="instead of the mission's (default without one: 1)")
    _add_origin(made, "for GeoJSON and GeoPackage: where the origin is on Earth; left out: as the mission says")

    imported = inner.add_parser(
        "import",
        help="convert another program's stem map",
        description=_IMPORT,
        formatter_class=raw,
    )
    imported.add_argument(
        "file", metavar="FILE", help="a stem map, .csv (.txt, .tsv), .geojson or .gpkg (at most 8 MiB and 20,000 trees)"
    )
    imported.add_argument("--out", required=True, metavar="FILE", help="where to: .csv, .geojson or .gpkg")
    imported.add_argument("--utm", metavar="ZONE", help="zone of easting and northing: 32N, or EPSG:32632")
    imported.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="NAME=HEADING",
        help="read the column with this heading as NAME: dbh_m, height_m, easting, id ... (again for each)",
    )
    imported.add_argument(
        "--decimal", choices=("comma", "point"), help="decimal sign of numbers that do not say it themselves, as 1.234"
    )
    _add_origin(imported, "that metres count from; left out: the median of the trees' places")

    checked = inner.add_parser("check", help="print density, diameters and gaps", description=_CHECK)
    checked.add_argument(
        "files", nargs="+", metavar="FILE", help="a mission (.toml) or a stem map (.csv, .geojson, .gpkg)"
    )
    checked.add_argument("--mission", metavar="FILE", help="mission whose route is checked against the stem map")
    checked.add_argument("--json", action="store_true", help="print one JSON array, an object for each file")

    drawn = inner.add_parser("draw", help="draw a plan of the stand", description=_DRAW)
    drawn.add_argument("file", metavar="FILE", help="a mission (.toml) or a stem map (.csv, .geojson, .gpkg)")
    drawn.add_argument("--mission", metavar="FILE", help="whose route and fence are drawn into a stem map")
    drawn.add_argument("--out", required=True, metavar="FILE.svg", help="where to")
    drawn.add_argument("--ids", action="store_true", help="write the trees' ids beside them, as the stem map has them")


def _add_origin(parser: argparse.ArgumentParser, text: str) -> None:
    parser.add_argument("--origin", nargs=2, type=float, metavar=("LAT", "LON"), help=text)


def run(args: argparse.Namespace) -> int:
    """One of the commands; MissionError is for the caller."""
    commands: dict[str, Callable[[argparse.Namespace], int]] = {
        "make": make,
        "import": take_over,
        "check": check,
        "draw": draw,
    }
    return commands[args.forest](args)
