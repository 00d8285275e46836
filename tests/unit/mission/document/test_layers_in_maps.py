"""Layers of height against the crowns and the undergrowth of a stem map."""

from __future__ import annotations

from pathlib import Path

import pytest

from mission.common.problems import MissionError
from mission.document.load import load_mission
from mission.stand.resolve import resolve_stand

ROUTE = """[route]
d1_enu_m = [0.0, 0.0, 4.4]
d2_enu_m = [100.0, 0.0, 4.4]
vel_leader_mps = 2.0
"""
HEAD = "x,y,dbh_cm,height_m,crown_base_m,species\n"
TREE = "50,30,30,20,{base},spruce\n"
BUSH = "40,10,2,{high},{high},undergrowth\n"


def refusal(tmp_path: Path, stems: str, low_m: float, high_m: float, *, layers: bool = True, fence: str = "") -> str:
    (tmp_path / "stems.csv").write_text(HEAD + stems)
    file = tmp_path / "m.toml"
    altitudes = f"[fence]\naltitude_min_m = {low_m}\naltitude_max_m = {high_m}\n{fence}"
    separation = f"[separation]\nheight_layers = {str(layers).lower()}\n"
    forest = "schema = 1\n[sensing]\n[coverage]\nradius_m = 8.0\n[forest]\nfile = 'stems.csv'\n"
    file.write_text(forest + separation + altitudes + ROUTE)
    try:
        resolve_stand(load_mission(file), file)
    except MissionError as error:
        return str(error).replace(f"{file.parent}/", "")
    return ""


def test_a_layer_among_a_maps_crowns_is_refused_where_its_tree_stands(tmp_path: Path) -> None:
    told = refusal(tmp_path, TREE.format(base=6.5), 3.0, 6.8)
    assert "stems.csv:2: the tree at 50.00 east, 30.00 north" in told
    assert "its crown, 6.5 to 20 m above the ground, is in the layer 6.4 m up" in told
    assert "fence.altitude_max_m must be less than 6.8 m" in told


@pytest.mark.parametrize(
    ("base_m", "high_m", "layers", "fence"),
    [
        (6.8, 6.8, True, ""),  # the layer is 0.4 m below the crown: more than the hull's radius
        (6.5, 6.7, True, ""),  # no room for that layer
        (6.5, 6.8, False, ""),
        (6.5, 6.8, True, "polygon_enu_m = [[-20, -19], [120, -19], [120, 19], [-20, 19]]\n"),
    ],
)
def test_no_layer_is_refused_for_a_crown_that_it_does_not_meet(
    tmp_path: Path, base_m: float, high_m: float, layers: bool, fence: str
) -> None:
    assert refusal(tmp_path, TREE.format(base=base_m), 3.0, high_m, layers=layers, fence=fence) == ""


def test_a_layer_in_a_maps_undergrowth_is_refused(tmp_path: Path) -> None:
    assert refusal(tmp_path, BUSH.format(high=1.5), 2.0, 5.2) == ""
    told = refusal(tmp_path, BUSH.format(high=1.7), 2.0, 5.2)
    assert "undergrowth 1.7 m high is in the layer 2.4 m up" in told
    assert "fence.altitude_min_m must be more than 2.0 m" in told
