"""Plans of others: whatever they hold, a mission or a MissionError comes of it."""

from __future__ import annotations

import contextlib
import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from mission.common.problems import MissionError
from mission.plan.qgc_plan import from_plan, to_plan

scalars = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5)
)
anything = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
degrees = st.floats(-90, 90) | scalars
PARAMS = st.lists(degrees, min_size=7, max_size=7) | anything
ITEMS = st.lists(
    st.fixed_dictionaries(
        {
            "type": st.sampled_from(["SimpleItem", "ComplexItem"]) | anything,
            "command": st.sampled_from([16, 17, 19, 20, 21, 22, 178, 206, 177]) | anything,
            "frame": st.sampled_from([0, 2, 3, 10]) | anything,
            "params": PARAMS,
        }
    ),
    max_size=5,
)
PLANS = st.fixed_dictionaries(
    {
        "fileType": st.just("Plan"),
        "mission": st.fixed_dictionaries(
            {
                "items": ITEMS | anything,
                "plannedHomePosition": st.lists(degrees, min_size=3, max_size=3) | anything,
                "hoverSpeed": st.floats(0.5, 5) | anything,
            }
        )
        | anything,
        "geoFence": anything
        | st.fixed_dictionaries(
            {
                "polygons": st.lists(
                    st.fixed_dictionaries(
                        {"inclusion": st.just(True), "polygon": st.lists(st.lists(degrees, max_size=3))}
                    ),
                    max_size=2,
                )
            }
        ),
        "rallyPoints": anything,
    }
)


@given(PLANS)
def test_any_plan_is_a_mission_or_refused(plan: dict[str, Any]) -> None:
    with contextlib.suppress(MissionError):
        from_plan(json.dumps(plan), "a.plan")


@given(st.text(max_size=200))
def test_any_text_is_refused(text: str) -> None:
    with contextlib.suppress(MissionError):
        from_plan(text, "a.plan")
        raise AssertionError("text is no plan")


@given(
    d1=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    way=st.tuples(st.floats(40, 300), st.floats(40, 300)),
    up=st.floats(4.0, 20.0),
    lat_deg=st.floats(-70, 70),
    lon_deg=st.floats(-179.9, 179.9),
)
def test_a_plan_survives_in_and_out(
    d1: tuple[float, float], way: tuple[float, float], up: float, lat_deg: float, lon_deg: float
) -> None:
    items = [
        {
            "type": "SimpleItem",
            "command": command,
            "frame": 3,
            "params": [0, 0, 0, None, lat_deg + north, lon_deg + east, up],
        }
        for command, (north, east) in ((22, (d1[0] * 1e-6, d1[1] * 1e-6)), (19, (way[0] * 2e-5, way[1] * 2e-5)))
    ]
    plan = {
        "fileType": "Plan",
        "mission": {"items": items, "plannedHomePosition": [lat_deg, lon_deg, 300.0], "hoverSpeed": 2},
    }
    once, _ = from_plan(json.dumps(plan), "a.plan")
    twice, _ = from_plan(to_plan(once, "a.toml"), "b.plan", once)
    assert twice.visits == once.visits
    assert twice.route == once.route.model_copy(update={"stops": twice.route.stops})
