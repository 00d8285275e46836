"""`mission forest check` and `draw`: what stands in a mission or a stem map, in figures and as a plan."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mission.cli.forest_files import refuse, written
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT

if TYPE_CHECKING:
    from mission.document.model import Mission
    from mission.stand.figures import Figures
    from mission.stand.stand import Stand
    from mission.stems.stem_map import StemMap

BARS = 40


def check(args: argparse.Namespace) -> int:
    """The exit code: of the files that are bad, each is told."""
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
    from mission.check.forest_notes import notes_of
    from mission.stand.figures import area_of, figures_of

    stand, mission, stems = _load_stand(file, mission_file)
    notes = [*(() if stems is None else stems.notes), *(() if mission is None else notes_of(stand, mission))]
    if not stand.trees:
        return None, tuple(notes)
    area = None if mission is None else area_of(mission)
    return figures_of(stand, area=area, sensing=mission.sensing if mission else None), tuple(notes)


def _load_stand(file: str, mission_file: str | None) -> tuple[Stand, Mission | None, StemMap | None]:
    """The stand, the mission that flies in it, and the stem map that `file` is."""
    from mission.common.problems import MissionError, first_of
    from mission.document.load import load_mission
    from mission.stand.resolve import resolve_stand
    from mission.stand.stand import Stand, map_problems
    from mission.stems.stem_map import read_stems

    if Path(file).suffix.lower() == ".toml":
        if mission_file is not None:
            refuse("--mission", "is for stem maps: this is a mission")
        mission = load_mission(file)
        return resolve_stand(mission, file), mission, None
    flown = None if mission_file is None else load_mission(mission_file)
    origin = None if flown is None or flown.origin is None else flown.origin.wgs84
    stems = read_stems(file, origin=origin, lenient=True)
    if flown is not None:
        if origin is None and stems.origin is not None:
            refuse(file, "is in degrees: the mission needs an [origin] to say where it is")
        found = list(map_problems(flown, stems))
        if found:
            raise MissionError(first_of(found, stems.place))
    grade = (0.0, 0.0) if flown is None else flown.forest.grade
    boxes = () if flown is None else [box.block for box in flown.forest.boxes]
    return Stand(stems.trees, stems.bushes, grade, boxes), flown, stems


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


def draw(args: argparse.Namespace) -> int:
    """The exit code; MissionError is for the caller."""
    from mission.stand.drawing import drawn
    from mission.stand.stand import mapped_stems
    from mission.stems.stem_map import counted

    if Path(args.out).suffix.lower() != ".svg":
        refuse("--out", f"{args.out}: must end in .svg")
    stand, mission, stems = _load_stand(args.file, args.mission)
    if args.ids and stems is None and mission and mission.forest.file:
        stems = mapped_stems(mission, mission.forest.file, Path(args.file).parent)
    ids = {(stem.tree.east_m, stem.tree.north_m): stem.id for stem in stems.stems if stem.id} if stems else {}
    if args.ids and not ids:
        refuse(args.file, "has no ids of trees to draw: they are in a stem map's column id")
    origin = mission.origin.wgs84 if mission and mission.origin else stems.origin if stems else None
    try:
        text = drawn(stand, mission, os.path.basename(args.file), origin=origin, ids=ids if args.ids else {})
    except ValueError:
        refuse(args.file, "has nothing to draw")
    if not written(args.out, text.encode()):
        return EXIT_ENVIRONMENT
    boxes = f", {len(stand.boxes)} box{'es' * (len(stand.boxes) > 1)}" if stand.boxes else ""
    print(f"{args.out}: {counted(len(stand.trees))}{boxes}")
    return EXIT_DONE
