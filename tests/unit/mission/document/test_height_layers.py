"""Which heights a mission has room for, for parts that do not hear one another."""

from __future__ import annotations

import itertools
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mission.document.height_layers import APART_M, LAYERS_MOST, LIMIT_M, list_layers
from mission.document.model import Mission
from tests.unit.core.core_kit import mission


def level(own_m: float, low_m: float, high_m: float, **tables: dict[str, Any]) -> Mission:
    values: dict[str, dict[str, Any]] = {
        "route": {"d1_enu_m": (0.0, 0.0, own_m), "d2_enu_m": (130.0, 0.0, own_m)},
        "fence": {"altitude_min_m": low_m, "altitude_max_m": high_m},
        "separation": {"height_layers": True},
    }
    for name, table in tables.items():
        values[name] = values.get(name, {}) | table
    return mission(**values)


@pytest.mark.parametrize(
    ("own_m", "low_m", "high_m", "layers"),
    [
        (4.0, 2.0, 5.2, (4.0,)),  # natural_stand: undergrowth below, crowns above
        (4.4, 2.0, 5.2, (4.4, 2.4)),
        (4.0, 3.0, 7.0, (4.0, 6.0)),
        (8.0, 3.0, 30.0, (8.0, 6.0, 4.0)),
        (4.0, 1.6, 8.0, (4.0, 2.0, 6.0)),
        (4.0, 3.0, 5.0, (4.0,)),
    ],
)
def test_layers_are_below_first_then_above(
    own_m: float, low_m: float, high_m: float, layers: tuple[float, ...]
) -> None:
    assert list_layers(level(own_m, low_m, high_m)) == pytest.approx(layers)


@given(st.floats(3.0, 20.0), st.floats(0.4, 12.0), st.floats(0.4, 12.0))
def test_layers_are_apart_and_inside_the_fence(own_m: float, down_m: float, up_m: float) -> None:
    low_m, high_m = own_m - down_m, own_m + up_m
    layers = list_layers(level(own_m, max(low_m, 0.0), high_m))
    assert layers[0] == own_m
    assert len(layers) <= LAYERS_MOST
    ascending = sorted(layers)
    gaps = [above - below for below, above in itertools.pairwise(ascending)]
    assert gaps == pytest.approx([APART_M] * len(gaps))
    assert all(max(low_m, 0.0) + LIMIT_M - 1e-6 <= m <= high_m - LIMIT_M + 1e-6 for m in layers[1:])


@pytest.mark.parametrize(
    ("grade", "layers"),
    [
        ((0.0, 0.0), (8.0, 6.0, 4.0)),
        ((0.015, 0.0), (8.0, 6.0, 4.0)),  # 1.95 m up at d2, 0.2 m more 15 m beyond it
        ((0.022, 0.0), (8.0, 6.0, 10.0)),  # 4 m is less than a metre above the ground there
        ((0.0, 0.14), (8.0, 6.0, 4.0)),  # beside the way, up to 2.1 m
        ((0.0, 0.21), (8.0, 6.0, 10.0)),
        ((0.045, 0.0), (8.0, 10.0, 12.0)),
        ((-0.21, 0.0), (8.0, 6.0, 10.0)),  # it rises behind d1
    ],
)
def test_layers_are_above_sloping_ground_along_the_whole_way(
    grade: tuple[float, float], layers: tuple[float, ...]
) -> None:
    sloping = level(8.0, 1.0, 30.0, forest={"grade": grade}, coverage={"radius_m": 15.0})
    assert list_layers(sloping) == pytest.approx(layers)


def test_layers_are_above_level_ground_too() -> None:
    assert list_layers(level(2.8, 0.2, 3.2)) == (2.8,)
    assert list_layers(level(3.0, 0.2, 3.4)) == (3.0, 1.0)


SPRUCES = {"density_per_ha": 400}  # crowns from 5.2 m up, trees to 28 m


@pytest.mark.parametrize(
    ("own_m", "low_m", "high_m", "sloping", "says"),
    [
        (4.0, 2.0, 6.3, (0.0, 0.0), ""),
        (
            4.0,
            2.0,
            6.4,
            (0.0, 0.0),
            "separation.height_layers = true: makes a layer 6.0 m up, among crowns, the lowest from 5.2 m above the "
            "ground: fence.altitude_max_m must be less than 6.4 m (fence.altitude_max_m = 6.4)",
        ),
        (4.0, 1.6, 6.3, (0.0, 0.0), ""),
        (4.0, 1.6, 6.4, (0.0, 0.0), "makes a layer 6.0 m up"),
        (2.6, 1.0, 5.0, (0.0, 0.0), ""),
        (2.6, 1.0, 5.0, (-0.004, 0.0), "makes a layer 4.6 m up"),  # 5.1 m above the ground at d2
        (31.0, 28.7, 40.0, (0.0, 0.0), ""),
        (31.0, 25.0, 40.0, (0.0, 0.0), "fence.altitude_min_m must be more than 26.6 m"),
    ],
)
def test_a_layer_among_the_crowns_of_a_stand_is_refused(
    own_m: float, low_m: float, high_m: float, sloping: tuple[float, float], says: str
) -> None:
    tables: dict[str, Any] = {"forest": {"stand": SPRUCES, "grade": sloping}, "sensing": {}}
    try:
        level(own_m, low_m, high_m, **tables)
        refusal = ""
    except ValidationError as error:
        refusal = str(error)
    assert says in refusal
    assert bool(says) is bool(refusal), refusal
    level(own_m, low_m, high_m, **tables, separation={"height_layers": False})


def test_only_its_own_where_layers_are_off_or_would_not_be_level() -> None:
    assert list_layers(level(8.0, 3.0, 30.0, separation={"height_layers": False})) == (8.0,)
    assert list_layers(level(8.0, 3.0, 30.0, route={"d2_enu_m": (130.0, 0.0, 12.0)})) == (8.0,)
    assert list_layers(level(8.0, 3.0, 30.0, swarm={"size": 1})) == (8.0,)
    stop = {"stops": [{"pos_enu_m": (60.0, 0.0, 11.0)}]}
    assert list_layers(level(8.0, 3.0, 30.0, route=stop)) == (8.0,)
    sphere = {"shape": "sphere", "radius_m": 7.0}
    assert list_layers(level(12.0, 3.0, 30.0, coverage=sphere)) == (12.0,)


@pytest.mark.parametrize(("bushes_m", "per_ha", "lower"), [(1.5, 800.0, True), (1.7, 800.0, False), (1.7, 0.0, True)])
def test_none_in_the_undergrowth_of_a_stand(bushes_m: float, per_ha: float, lower: bool) -> None:
    stand = {"density_per_ha": 400, "undergrowth_per_ha": per_ha, "undergrowth_height_m": bushes_m}
    layers = list_layers(level(4.4, 2.0, 5.2, forest={"stand": stand}, sensing={}))
    assert layers == pytest.approx((4.4, 2.4) if lower else (4.4,))
