"""Crowns and undergrowth of a stem map, inside a mission's fence, in which a layer of height would be.

A companion has no map: it takes every layer that the fence has room for (`height_layers.list_layers`).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from mission.common.plane import clearance_m
from mission.common.problems import Problem
from mission.document.height_layers import OVER_BUSHES_M, exclude_layer, list_layers
from mission.document.model import Mission
from mission.rules.flight_rules import MARGIN_M
from mission.rules.forest_rules import ground_up_m
from mission.schema.trees import UNDERGROWTH, StandTree

if TYPE_CHECKING:
    from mission.stems.stem_map import StemMap


def layer_problems(mission: Mission, stems: StemMap) -> Iterator[Problem]:
    """One at the most: of the layer that is first in the list, the lowest crown or the highest bush."""
    own_m, *others_m = list_layers(mission)
    inside = [stem for stem in stems.stems if others_m and _is_inside(mission, stem.tree)]
    for layer_m in others_m:
        met = [stem for stem in inside if _is_met(mission, stem.tree, layer_m)]
        if not met:
            continue
        stem = min(met, key=lambda one: one.tree.crown_base_m)
        tree = stem.tree
        if tree.species == UNDERGROWTH:
            what = f"undergrowth {tree.height_m:g} m high"
        else:
            what = f"its crown, {tree.crown_base_m:g} to {tree.height_m:g} m above the ground,"
        key, must_be = exclude_layer(layer_m, own_m)
        where = f"the tree at {tree.east_m:.2f} east, {tree.north_m:.2f} north"
        message = f"{what} is in the layer {layer_m:.1f} m up of separation.height_layers: {key} must be {must_be}"
        yield Problem(stems.place, stem.line, where, "", message)
        return


def _is_inside(mission: Mission, tree: StandTree) -> bool:
    polygon = mission.fence.polygon_enu_m
    return polygon is None or clearance_m((tree.east_m, tree.north_m), polygon) > -tree.crown_radius_m


def _is_met(mission: Mission, tree: StandTree, layer_m: float) -> bool:
    over_m = layer_m - ground_up_m(mission, tree.east_m, tree.north_m)
    if tree.species == UNDERGROWTH:
        return over_m < tree.height_m + OVER_BUSHES_M
    hull_m = MARGIN_M if mission.sensing is None else mission.sensing.vehicle_radius_m
    return tree.crown_base_m - hull_m < over_m < tree.height_m + hull_m and tree.crown_base_m < tree.height_m
