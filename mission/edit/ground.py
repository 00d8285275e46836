"""Trees, boxes and slope under the mission, as the page draws them: also while the mission is not good yet."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from mission.common.frames import Wgs84
from mission.common.problems import MissionError
from mission.document.tree_points import origin_of
from mission.schema.fields import Table
from mission.schema.forest import Box, Tree
from mission.schema.trees import UNDERGROWTH, StandTree
from mission.stand.stand import Stand, alone
from mission.stems.stem_map import StemMap, read_stems

SUFFIXES: Final = (".csv", ".geojson", ".json", ".gpkg")  # that a mission may name
_TREE: Final = ("east_m", "north_m", "radius_m", "height_m", "crown_base_m", "crown_radius_m")
Model = TypeVar("Model", bound=Table)
_BUSH: Final = ("east_m", "north_m", "radius_m", "height_m")


class Ground:
    """Drawing of the ground, and the number by which the page sees that it has changed."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._read: tuple[object, StemMap | MissionError] | None = None  # the last, by its file
        self._drawn: object = None
        self._shows_generated = False
        self.id = ""
        self.data = b"{}"  # JSON
        self.why_not = ""  # there is no stem map to draw
        self.draw({}, None)

    def draw(self, values: Mapping[str, Any], stand: Stand | None) -> None:
        """Takes up what a document says of its forest. `stand`: of a good mission, or None."""
        forest = values.get("forest")
        forest = forest if isinstance(forest, Mapping) else {}
        stems, self.why_not = self._find_stems(forest.get("file"), origin_of(values))
        mapped = () if stems is None else stems.stems
        is_generated = isinstance(forest.get("stand"), Mapping)
        if is_generated and stand is None and self._shows_generated:
            return  # it cannot be generated now: the last one stays
        key = (stand if is_generated else stems, json.dumps(forest, default=str))
        if key == self._drawn:
            return
        self._drawn = key
        self._shows_generated = is_generated and stand is not None
        trees = [*_alone(forest), *(stem.tree for stem in mapped if stem.tree.species != UNDERGROWTH)]
        bushes: Sequence[StandTree] = [stem.tree for stem in mapped if stem.tree.species == UNDERGROWTH]
        if is_generated and stand is not None:
            trees, bushes = list(stand.trees), stand.bushes
        ids = {(stem.tree.east_m, stem.tree.north_m): stem.id for stem in mapped if stem.id}
        told = {
            "trees": {
                **_columns(trees, _TREE),
                "species": [tree.species for tree in trees],
                "id": [ids.get((tree.east_m, tree.north_m), "") for tree in trees],
            },
            "bushes": _columns(bushes, _BUSH),
            "boxes": [box.block.corners() for box in _well_said(forest, "boxes", Box)],
            "grade": _grade(forest),
        }
        self.data = json.dumps(told, separators=(",", ":")).encode()
        self.id = hashlib.blake2b(self.data, digest_size=8).hexdigest()

    def read_stem_map(self, path: Path, *, origin: Wgs84 | None) -> StemMap:
        """The stem map in `path`, read again only when its file has changed. MissionError."""
        try:
            state = os.stat(path)
        except OSError:
            return read_stems(path, origin=origin)
        key = (path, origin, state.st_mtime_ns, state.st_size, state.st_ino)
        if self._read is None or self._read[0] != key:
            try:
                self._read = key, read_stems(path, origin=origin)
            except MissionError as error:
                self._read = key, error
        found = self._read[1]
        if isinstance(found, MissionError):
            raise MissionError(found.problems)
        return found

    def _find_stems(self, file: object, origin: Wgs84 | None) -> tuple[StemMap | None, str]:
        """The stem map of that name, if there is one that can be read; and why not."""
        if not isinstance(file, str) or Path(file).name != file:
            return None, ""
        try:
            return self.read_stem_map(self._folder / file, origin=origin), ""
        except MissionError as error:
            return None, str(error)


def stem_files(folder: Path) -> list[str]:
    """Names of files in `folder` that may be stem maps."""
    try:
        return sorted(entry.name for entry in os.scandir(folder) if Path(entry.name).suffix.lower() in SUFFIXES)[:200]
    except OSError:
        return []


def _columns(trees: Sequence[StandTree], names: Sequence[str]) -> dict[str, list[float]]:
    return {name: [round(getattr(tree, name), 3) for tree in trees] for name in names}


def _alone(forest: Mapping[str, Any]) -> list[StandTree]:
    """Trees of [[forest.trees]]."""
    return [alone(tree) for tree in _well_said(forest, "trees", Tree)]


def _well_said(forest: Mapping[str, Any], key: str, model: type[Model]) -> Iterator[Model]:
    """Tables of the array `key` that can be drawn."""
    listed = forest.get(key)
    for table in listed if isinstance(listed, list) else []:
        with contextlib.suppress(ValidationError):
            yield model.model_validate(table)


def _grade(forest: Mapping[str, Any]) -> list[float]:
    """East and north; level where it is not said well."""
    grade = forest.get("grade")
    if isinstance(grade, list) and len(grade) == 2 and all(isinstance(g, int | float) for g in grade):
        return [float(g) if abs(g) <= 1.0 else 0.0 for g in grade]
    return [0.0, 0.0]
