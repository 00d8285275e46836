"""Missions survive a round trip; polygons are judged rightly."""

from __future__ import annotations

import math
from collections.abc import Callable

from hypothesis import given, settings
from hypothesis import strategies as st

from mission.common.plane import clearance_m, polygon_fault
from mission.common.problems import printable, shown
from mission.document.load import dump_mission, parse_mission
from mission.document.model import AtEnd, Mission, Origin, Placement, RadioTrunks
from tests.unit.mission.mission_kit import TOML_VALUES


@given(st.text(), st.integers(4, 99))
def test_shown_text_is_short_and_printable(text: str, most: int) -> None:
    assert len(printable(text, most)) <= most
    assert printable(text, most).isprintable()


@given(TOML_VALUES)
def test_any_shown_value_is_short_and_printable(value: object) -> None:
    assert len(shown(value)) <= 60
    assert shown(value).isprintable()


# Round trip -------------------------------------------------------------------

names = st.text(st.characters(exclude_categories=["C", "Z"]) | st.just(" "), max_size=80)
small = st.floats(-30.0, 30.0)
STOPS = [{"pos_enu_m": (400.0 * k, 900.0, 18.0), "duration_s": 10.0 * k or None} for k in range(4)]


@st.composite
def missions(draw: Callable[[st.SearchStrategy[object]], object]) -> Mission:
    """Valid missions: a route of hundreds of metres, everything else free within what that allows."""
    size = draw(st.integers(1, 12))
    assert isinstance(size, int)
    leaders = draw(st.lists(st.integers(1, size), unique=True))
    d2_enu_m = (draw(st.floats(100.0, 5_000.0)), draw(st.floats(-900.0, 900.0)), draw(st.floats(8.0, 30.0)))
    sensing = draw(st.none() | st.fixed_dictionaries({"range_m": st.floats(8.0, 100.0)}))
    values = {
        "schema": 1,
        "name": draw(names),
        "origin": draw(
            st.none()
            | st.builds(
                Origin, lat_deg=st.floats(-85, 85), lon_deg=st.floats(-180, 180), alt_m=st.floats(-500, 9_000)
            ).map(Origin.model_dump)
        ),
        "route": {
            "d1_enu_m": (draw(small), draw(small), draw(st.floats(8.0, 30.0))),
            "d2_enu_m": d2_enu_m,
            "vel_leader_mps": draw(st.floats(0.05, 4.0)),
            "at_end": draw(st.sampled_from(AtEnd)),
            "stops": draw(st.lists(st.sampled_from(STOPS), unique_by=lambda stop: stop["pos_enu_m"], max_size=3)),
        },
        "swarm": {"size": size, "leader_priority": leaders},
        "fence": {
            "altitude_max_m": draw(st.floats(31.0, 9_000.0)),
            "polygon_enu_m": draw(
                st.none() | st.just(((-2e3, -2e3), (9e3, -2e3), (9e3, 2e3), (-2e3, 2e3)))
            ),
        },
        "sensing": sensing,
        "forest": {
            "grade": draw(st.sampled_from([(0.0, 0.0), (-0.1, 0.0)])),
            "file": draw(st.sampled_from([None, "stems.csv", "a b.geojson"])),
            "trees": draw(
                st.lists(
                    st.fixed_dictionaries(
                        {
                            "base_enu_m": st.tuples(st.floats(-9e3, -99.0), small),
                            "trunk_radius_m": st.floats(0.01, 9.0),
                            "height_m": st.floats(0.1, 99.0),
                        }
                    ),
                    max_size=3,
                )
            )
        },
        "sim": {
            "seed": draw(st.integers(0, 2**32 - 1)),
            "wind_mps": (draw(small), draw(small), draw(small)),
            "radio_trunks": draw(st.sampled_from(RadioTrunks)),
            "lidar": {} if sensing is None else {"noise_m": draw(st.floats(0.0, 1.0))},
            "radio_loss": draw(st.floats(0.0, 1.0, exclude_max=True)),
            "placement": draw(st.sampled_from(Placement)),
            "time_limit_s": draw(st.none() | st.floats(3e5, 6e5)),  # the longest way takes 1e5 s, and as long back
        },
    }  # fmt: skip
    return Mission.model_validate(values)


@settings(deadline=None)
@given(missions())
def test_a_dumped_mission_loads_back_equal(flown: Mission) -> None:
    assert parse_mission(dump_mission(flown)) == flown


@settings(deadline=None)
@given(missions(), st.integers(1, 12))
def test_a_copy_changes_its_size_and_nothing_else(flown: Mission, size: int) -> None:
    if all(leader <= size for leader in flown.swarm.leader_priority):
        assert flown.with_size(size).with_size(flown.swarm.size) == flown


# Geometry ---------------------------------------------------------------------


@st.composite
def stars(draw: Callable[[st.SearchStrategy[object]], object]) -> list[tuple[float, float]]:
    """Polygons around (0, 0) that are simple by construction."""
    radii = draw(st.lists(st.floats(5.0, 100.0), min_size=3, max_size=64))
    assert isinstance(radii, list)
    step = math.tau / len(radii)
    return [(r * math.cos(i * step), r * math.sin(i * step)) for i, r in enumerate(radii)]


@settings(deadline=None)
@given(stars(), st.booleans())
def test_a_star_is_simple_and_holds_its_centre(star: list[tuple[float, float]], turned: bool) -> None:
    polygon = star[::-1] if turned else star

    assert polygon_fault(polygon) == ""
    assert clearance_m((0.0, 0.0), polygon) > 0.0
    assert clearance_m((150.0, 0.0), polygon) < 0.0


@given(st.integers(4, 30), st.data())
def test_swapped_vertices_make_edges_cross(n: int, data: st.DataObject) -> None:
    ring = [(math.cos(i * math.tau / n), math.sin(i * math.tau / n)) for i in range(n)]
    i = data.draw(st.integers(0, n - 2))
    ring[i], ring[i + 1] = ring[i + 1], ring[i]

    assert "cross or touch" in polygon_fault(ring)
