"""The stand that a mission's simulated vehicles fly in: trunks, crowns, undergrowth and the ground, quick to ask.

Only the simulator and `mission forest` make one. A companion knows d2, and what its sensor tells.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mission.common.files import refused
from mission.common.problems import MissionError, Problem, first_of, shown
from mission.document.model import CoverageShape, Mission, Placement
from mission.document.tree_points import POINTS, tree_problems
from mission.rules.flight_rules import name_of, placement_radius_m, route_points, trunk_clearance_m
from mission.schema.boxes import StandBox
from mission.schema.forest import Tree
from mission.schema.trees import StandTree
from mission.stand.generate import generate_stand
from mission.stand.layers import layer_problems

if TYPE_CHECKING:
    from mission.stems.stem_map import StemMap

    ReadStems = Callable[..., StemMap]  # as `read_stems`: mypyc has no Protocol here


__all__ = ["Stand", "StandBox", "StandTree", "stand_of"]

CELL_M = 4.0  # a scan of 8 m looks into 25 cells; 600 trees/ha put one tree into each


class Stand:
    """Trees, bushes and boxes on a plane that may slope. ENU metres from the mission's origin. Do not change it.

    `crossed` and `near` are of trees; undergrowth has `bushes_near`, boxes have `boxes_near` and `boxes_crossed`.
    """

    __slots__ = ("_bushes", "_trees", "boxes", "bushes", "grade", "trees")

    def __init__(
        self,
        trees: Iterable[StandTree] = (),
        bushes: Iterable[StandTree] = (),
        grade: tuple[float, float] = (0.0, 0.0),
        boxes: Iterable[StandBox] = (),
    ) -> None:
        self.boxes: Final = tuple(boxes)  # at most mission.schema.forest.MAX_BOXES: each question looks at all
        self.trees: Final = tuple(trees)
        self.bushes: Final = tuple(bushes)
        self.grade: Final = grade  # how much the ground rises per metre east and per metre north
        self._trees: Final = _Cells(self.trees)
        self._bushes: Final = _Cells(self.bushes)

    @property
    def has_obstacles(self) -> bool:
        """Trees or boxes stand in it."""
        return bool(self.trees or self.boxes)

    def ground_up_m(self, east_m: float, north_m: float) -> float:
        """Height of the ground there above that at the origin."""
        return self.grade[0] * east_m + self.grade[1] * north_m

    def near(self, east_m: float, north_m: float, within_m: float) -> list[StandTree]:
        """Trees whose trunk's surface is less than `within_m` from there, level; in no order of distance."""
        return self._trees.near(east_m, north_m, within_m)

    def bushes_near(self, east_m: float, north_m: float, within_m: float) -> list[StandTree]:
        """Bushes, as `near`."""
        return self._bushes.near(east_m, north_m, within_m)

    def crossed(self, a_enu_m: Sequence[float], b_enu_m: Sequence[float]) -> list[StandTree]:
        """Trees whose trunk, between the ground and its top, the straight way from a to b goes through."""
        found = []
        for tree in self._trees.along(a_enu_m[0], a_enu_m[1], b_enu_m[0], b_enu_m[1]):
            part = _inside(tree, a_enu_m, b_enu_m)
            if part is not None and self._is_at_height(tree, part, a_enu_m[2], b_enu_m[2]):
                found.append(tree)
        return found

    def boxes_near(self, east_m: float, north_m: float, within_m: float) -> list[StandBox]:
        """Boxes whose surface is less than `within_m` from there, level, or that are about the place."""
        return [box for box in self.boxes if box.clearance_m(east_m, north_m) < within_m]

    def boxes_crossed(self, a_enu_m: Sequence[float], b_enu_m: Sequence[float]) -> list[StandBox]:
        """As `crossed`, of boxes."""
        found = []
        for box in self.boxes:
            part = box.part_inside((a_enu_m[0], a_enu_m[1]), (b_enu_m[0], b_enu_m[1]))
            if part is not None and self._is_at_height(box, part, a_enu_m[2], b_enu_m[2]):
                found.append(box)
        return found

    def _is_at_height(
        self, tree: StandTree | StandBox, part: tuple[float, float], a_up_m: float, b_up_m: float
    ) -> bool:
        """True if the way, from shares `part` of it, is anywhere between the ground at the axis and the top."""
        enters_m, leaves_m = (a_up_m + share * (b_up_m - a_up_m) for share in part)
        ground_m = self.ground_up_m(tree.east_m, tree.north_m)
        return min(enters_m, leaves_m) < ground_m + tree.height_m and max(enters_m, leaves_m) > ground_m


def stand_of(mission: Mission, folder: str | os.PathLike[str] | None = None, read: ReadStems | None = None) -> Stand:
    """The stand of `mission`: its own trees, what `[forest.stand]` grows, and the stem map `forest.file` in `folder`.

    read: in place of `read_stems`, for who remembers maps that were read.

    MissionError when the stem map cannot be read, is not where the mission is, or has trees in the starting points, or
    one at d2 that is too thick.
    """
    forest = mission.forest
    trees = [alone(tree) for tree in forest.trees]
    bushes: tuple[StandTree, ...] = ()
    if forest.stand is not None:
        grown = generate_stand(mission, forest.stand, trees)
        trees += grown.trees
        bushes = grown.bushes
    if forest.file is not None:
        stems = mapped_stems(mission, forest.file, folder, read)
        trees += stems.trees
        bushes = stems.bushes
    return Stand(trees, bushes, forest.grade, [box.block for box in forest.boxes])


def mapped_stems(
    mission: Mission, file: str, folder: str | os.PathLike[str] | None, read: ReadStems | None = None
) -> StemMap:
    """The stem map `file` beside the mission, in `folder`, checked against its places. MissionError."""
    from mission.stems.stem_map import read_stems  # csv, json: only for missions that have one

    if folder is None:
        raise refused(file, None, "is a stem map beside the mission's file, and this mission was read from none")
    stems = (read or read_stems)(Path(folder, file), origin=None if mission.origin is None else mission.origin.wgs84)
    if mission.origin is None and stems.origin is not None:
        raise refused(stems.place, None, "is in degrees: the mission needs an [origin] to say where it is")
    found = list(map_problems(mission, stems))
    if found:
        raise MissionError(first_of(found, stems.place))
    return stems


def map_problems(mission: Mission, stems: StemMap) -> Iterator[Problem]:
    """Trees of a stem map that stand where vehicles start, or at d2 or a stop reach beyond `coverage.keep_out_m`.

    And trees that the mission names which are not there, or not where it has d1 and d2, and those that its layers of
    height are among.
    """
    named = mission.route.model_dump(include={*POINTS, *POINTS.values()})
    for name, message in tree_problems(named, stems):
        yield Problem(stems.place, None, f"route.{name}", shown(named[name]), message)
    d1 = mission.route.d1_enu_m[:2]
    least_m = placement_radius_m(mission) + trunk_clearance_m(mission)
    keep_out_m = mission.coverage.keep_out_m
    ringed = route_points(mission)[1:] if mission.coverage.shape is CoverageShape.RING else []
    for tree, line, name in stems.stems:
        axis = (tree.east_m, tree.north_m)
        key = f"the tree at {tree.east_m:.2f} east, {tree.north_m:.2f} north"
        gap_m = math.dist(axis, d1) - tree.radius_m
        if gap_m < least_m and not (name == mission.route.d1_tree and _is_ringed(mission, tree)):
            message = f"stands {gap_m:.1f} m from d1: must be at least {least_m:.1f} m, outside the starting points"
            yield Problem(stems.place, line, key, "", message)
        for point, pos_enu_m in ringed:
            off_m = math.dist(axis, pos_enu_m[:2])
            if off_m < keep_out_m < off_m + tree.radius_m:
                reach = f"reaches {off_m + tree.radius_m:.2f} m from {name_of(point)}"
                message = f"{reach}: must be at most coverage.keep_out_m = {keep_out_m:g}"
                yield Problem(stems.place, line, key, "", message)
    yield from layer_problems(mission, stems)


def _is_ringed(mission: Mission, tree: StandTree) -> bool:
    """True if the starting points are a ring about d1 with room for this tree in its middle."""
    d1 = mission.route.d1_enu_m
    if mission.sim.placement is not Placement.RING or mission.flies_by_ranges or mission.swarm.size == 1:
        return False
    off_m = math.dist((tree.east_m, tree.north_m), d1[:2])
    return placement_radius_m(mission) - off_m - tree.radius_m >= trunk_clearance_m(mission)


def alone(tree: Tree) -> StandTree:
    """A trunk of `[[forest.trees]]`: it has no crown."""
    east_m, north_m = tree.base_enu_m
    return StandTree(east_m, north_m, tree.trunk_radius_m, tree.height_m, tree.height_m, tree.trunk_radius_m)


def _inside(tree: StandTree, a: Sequence[float], b: Sequence[float]) -> tuple[float, float] | None:
    """The shares of the way from a to b at which it enters and leaves the trunk's circle; None: it passes by."""
    east_m, north_m = b[0] - a[0], b[1] - a[1]
    from_east_m, from_north_m = a[0] - tree.east_m, a[1] - tree.north_m
    square = east_m * east_m + north_m * north_m
    gap = from_east_m * from_east_m + from_north_m * from_north_m - tree.radius_m * tree.radius_m
    if square == 0.0:
        return (0.0, 1.0) if gap < 0.0 else None
    along = from_east_m * east_m + from_north_m * north_m
    root = along * along - square * gap
    if root <= 0.0:
        return None
    root = math.sqrt(root)
    enters, leaves = max(0.0, (-along - root) / square), min(1.0, (-along + root) / square)
    return (enters, leaves) if enters < leaves else None


class _Cells:
    """Cylinders by the square of CELL_M that their axis stands in."""

    __slots__ = ("_cells", "_widest_m")

    def __init__(self, trees: Sequence[StandTree]) -> None:
        cells: dict[tuple[int, int], list[tuple[float, float, float, StandTree]]] = {}
        for tree in trees:
            key = math.floor(tree.east_m / CELL_M), math.floor(tree.north_m / CELL_M)
            cells.setdefault(key, []).append((tree.east_m, tree.north_m, tree.radius_m, tree))
        self._cells: Final = cells
        self._widest_m: Final = max((tree.radius_m for tree in trees), default=0.0)

    def near(self, east_m: float, north_m: float, within_m: float) -> list[StandTree]:
        """As Stand.near."""
        reach_m = within_m + self._widest_m
        first, last = math.floor((north_m - reach_m) / CELL_M), math.floor((north_m + reach_m) / CELL_M)
        cells = self._cells
        found = []
        for i in range(math.floor((east_m - reach_m) / CELL_M), math.floor((east_m + reach_m) / CELL_M) + 1):
            for j in range(first, last + 1):
                for x, y, radius_m, tree in cells.get((i, j), ()):
                    x -= east_m
                    y -= north_m
                    limit_m = within_m + radius_m
                    if x * x + y * y < limit_m * limit_m:
                        found.append(tree)
        return found

    def along(self, a_east_m: float, a_north_m: float, b_east_m: float, b_north_m: float) -> Iterator[StandTree]:
        """All whose trunk the segment ab may touch, and some that it does not; column of cells by column."""
        if a_east_m > b_east_m:
            a_east_m, a_north_m, b_east_m, b_north_m = b_east_m, b_north_m, a_east_m, a_north_m
        reach_m = self._widest_m
        wide_m = b_east_m - a_east_m
        rise = (b_north_m - a_north_m) / wide_m if wide_m > 0.0 else 0.0
        for i in range(math.floor((a_east_m - reach_m) / CELL_M), math.floor((b_east_m + reach_m) / CELL_M) + 1):
            # The part of the segment that a trunk of this column can touch
            left_m = min(max(a_east_m, i * CELL_M - reach_m), b_east_m)
            right_m = max(min(b_east_m, (i + 1) * CELL_M + reach_m), left_m)
            start_m, end_m = a_north_m + rise * (left_m - a_east_m), a_north_m + rise * (right_m - a_east_m)
            if wide_m == 0.0:
                end_m = b_north_m
            low_m, high_m = min(start_m, end_m) - reach_m, max(start_m, end_m) + reach_m
            for j in range(math.floor(low_m / CELL_M), math.floor(high_m / CELL_M) + 1):
                for _, _, _, tree in self._cells.get((i, j), ()):
                    yield tree
