"""`mission import` and `mission export`: a mission's route and fence from and to ground stations."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from mission.common.exit_codes import EXIT_DONE, EXIT_ENVIRONMENT

_IMPORT = """\
Makes a mission of a .plan of QGroundControl. Its takeoff is d1, its last waypoint d2, those between are stops; times to
loiter are times in coverage; it ends in the air, with a landing or with a return. One polygon to stay inside of is the
fence. Heights relative to home are above the ground of the origin. What else a mission needs comes from --mission, or
is left at its default. Stem maps: mission forest import.
"""
_EXPORT = """\
Writes the route and the fence of a mission as a .plan that QGroundControl opens: to look at on its map, to change
there, and to bring back with mission import --mission. It is the leader's way: it is not for upload to the vehicles.
"""


def add_parsers(commands: Any) -> None:
    """`import` and `export`."""
    raw = argparse.RawDescriptionHelpFormatter
    imported = commands.add_parser(
        "import",
        help="make a mission of a .plan of QGroundControl",
        description=_IMPORT,
        formatter_class=raw,
    )
    imported.add_argument("file", metavar="FILE.plan", help="the plan (at most 1 MiB)")
    imported.add_argument("--out", required=True, metavar="FILE.toml", help="where to")
    imported.add_argument(
        "--mission", metavar="FILE.toml", help="the mission whose route and fence it changes; left out: a new one"
    )
    exported = commands.add_parser(
        "export",
        help="write a mission's route and fence as a .plan for QGroundControl",
        description=_EXPORT,
        formatter_class=raw,
    )
    exported.add_argument("file", metavar="FILE.toml", help="a mission with an [origin]")
    exported.add_argument("--out", required=True, metavar="FILE.plan", help="where to")


def run_import(args: argparse.Namespace) -> int:
    """MissionError is for the caller."""
    from mission.common.files import MAX_PLACE_CHARS, decoded, read_bytes, refused
    from mission.common.problems import printable
    from mission.document.load import dump_mission, load_mission
    from mission.plan.qgc_plan import MAX_PLAN_BYTES, from_plan

    place = printable(args.file, MAX_PLACE_CHARS)
    if Path(args.file).suffix.lower() in (".csv", ".geojson", ".json", ".gpkg"):
        raise refused(place, None, "must be a .plan; stem maps: mission forest import")
    base = None if args.mission is None else load_mission(args.mission)
    text = decoded(read_bytes(args.file, place, MAX_PLAN_BYTES), place)
    mission, notes = from_plan(text, place, base)
    if not _written(args.out, dump_mission(mission, all_keys=False)):
        return EXIT_ENVIRONMENT
    stops = {0: "", 1: " over 1 stop"}.get(len(mission.route.stops), f" over {len(mission.route.stops)} stops")
    print(f"{args.out}: {mission.route.length_m:.1f} m{stops}, at {mission.route.vel_leader_mps:g} m/s")
    for note in notes:
        print(f"  {note}")
    return EXIT_DONE


def run_export(args: argparse.Namespace) -> int:
    """MissionError is for the caller."""
    from mission.common.files import MAX_PLACE_CHARS
    from mission.common.problems import printable
    from mission.document.load import load_mission
    from mission.plan.qgc_plan import to_plan

    mission = load_mission(args.file)
    plan = to_plan(mission, printable(args.file, MAX_PLACE_CHARS))
    if not _written(args.out, plan):
        return EXIT_ENVIRONMENT
    vertices = len(mission.fence.polygon_enu_m or ())
    fence = f", a fence of {vertices} vertices" if vertices else ""
    print(f"{args.out}: {len(mission.route.points_enu_m)} positions{fence}")
    return EXIT_DONE


def _written(out: str, text: str) -> bool:
    """Writes `text` to the file `out`; False, and a message, where it cannot."""
    try:
        Path(out).write_text(text, encoding="utf-8")
    except OSError as error:
        print(f"mission: cannot write {out}: {os.strerror(error.errno or 0)}", file=sys.stderr)
        return False
    return True
