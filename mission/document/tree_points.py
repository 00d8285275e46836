"""d1 and d2 at trees of the stem map: `route.d1_tree` and `d2_tree` to the points that a mission flies between."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Final

from pydantic import ValidationError

from mission.common.frames import Wgs84
from mission.common.problems import MissionError, Path, Problem, shown
from mission.schema.tables import Origin

if TYPE_CHECKING:
    from mission.stems.stem_map import Stem, StemMap

POINTS: Final = {"d1_tree": "d1_enu_m", "d2_tree": "d2_enu_m"}
MOST_OFF_M: Final = 0.05  # of a point that is given beside its tree: maps are to 1 cm, and so is what people copy


def place_trees(
    values: dict[str, Any], lines: dict[Path, int], place: str, folder: str | os.PathLike[str] | None
) -> None:
    """Sets in `values` each point of the route that is given by its tree alone, as high as the route's other end.

    MissionError where there is no such tree, or more than one. Values that are malformed are left to be refused.
    """
    route, forest = values.get("route"), values.get("forest")
    if not isinstance(route, dict):
        return
    wanted = {tree: point for tree, point in POINTS.items() if isinstance(route.get(tree), str) and point not in route}
    if not wanted:
        return
    if folder is None:
        message = "is a tree of a stem map, and this text is of no file beside which one could be"
        raise MissionError([_problem(route, tree, lines, place, message) for tree in wanted])
    file = forest.get("file") if isinstance(forest, Mapping) else None
    if file is None:
        message = "is a tree of a stem map: the mission has no forest.file"
        raise MissionError([_problem(route, tree, lines, place, message) for tree in wanted])
    if not isinstance(file, str) or FilePath(file).name != file:
        return
    from mission.stems.stem_map import read_stems  # csv, json: only for missions that name trees

    stems = read_stems(FilePath(folder, file), origin=origin_of(values))
    problems = []
    for tree, point in wanted.items():
        stem = find_stem(stems, route[tree])
        other = route.get("d2_enu_m" if tree == "d1_tree" else "d1_enu_m")
        if isinstance(stem, str):
            problems.append(_problem(route, tree, lines, place, stem))
        elif not isinstance(other, list) or len(other) != 3:
            at = f"[{stem.tree.east_m:g}, {stem.tree.north_m:g}, up]"
            message = f"how high? The other end does not say it: write {point} = {at} beside it"
            problems.append(_problem(route, tree, lines, place, message))
        else:
            route[point] = [stem.tree.east_m, stem.tree.north_m, other[2]]
            lines["route", point] = lines.get(("route", tree), 1)
    if problems:
        raise MissionError(problems)


def find_stem(stems: StemMap, name: str) -> Stem | str:
    """The only tree with this id, or the reason why there is none."""
    found = [stem for stem in stems.stems if stem.id == name]
    if len(found) == 1:
        return found[0]
    if found:
        lines = ", ".join(str(stem.line) for stem in found[:8] if stem.line is not None)
        return f"{len(found)} trees of {stems.place} have this id{f': lines {lines}' if lines else ''}"
    ids = [stem.id for stem in stems.stems if stem.id]
    if not ids:
        return f"{stems.place} has no ids: a column id, or `mission forest import --column id=HEADING`"
    near = get_close_matches(name, ids, n=3, cutoff=0.5) or ids[:3]
    return f"no tree of {stems.place} has this id; it has {', '.join(map(shown, near))} ..."


def tree_problems(route: Mapping[str, Any], stems: StemMap) -> Iterator[tuple[str, str]]:
    """Keys of points that are not where the trees beside them are, and why; `route` has all keys."""
    for tree, point in POINTS.items():
        if route[tree] is None:
            continue
        stem = find_stem(stems, route[tree])
        if isinstance(stem, str):
            yield tree, stem
        elif max(abs(stem.tree.east_m - route[point][0]), abs(stem.tree.north_m - route[point][1])) > MOST_OFF_M:
            at = f"{stem.tree.east_m:g} east, {stem.tree.north_m:g} north"
            yield tree, f"stands at {at}, {point} is elsewhere: leave one of them out"


def _problem(route: Mapping[str, Any], tree: str, lines: Mapping[Path, int], place: str, message: str) -> Problem:
    return Problem(place, lines.get(("route", tree)), f"route.{tree}", shown(route[tree]), message)


def origin_of(values: Mapping[str, Any]) -> Wgs84 | None:
    """Place on Earth of a document's frame; None: it does not say, or not well."""
    try:
        return Origin.model_validate(values["origin"]).wgs84
    except (KeyError, ValidationError):
        return None
