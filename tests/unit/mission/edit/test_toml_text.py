"""A mission's TOML is changed where it is asked for, and nowhere else."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import mission
from mission.document.load import parse_mission
from mission.edit.toml_text import Change, ChangeError, change_text

EXAMPLES = sorted((Path(mission.__file__).parent / "examples").glob("*.toml"))
TEXTS = [file.read_text(encoding="utf-8") for file in EXAMPLES]
ODD = """\
# first
schema = 1
route.vel_leader_mps = 3 # dotted
route.d1_enu_m = [
  0.0, # east
  0.0,
  8.0, # up
]
route.d2_enu_m = [130, 0.0, 8.0]
coverage = { radius_m = 15.0, duration_s = 10 } # inline
swarm.size = 4
[sim]
seed = 7 # lucky
[fence]
polygon_enu_m = [
  [-60.0, -60.0], # corner a
  [-60.0, 60.0], # corner b
  [190.0, 60.0], # corner c
  [190.0, -60.0] # corner d
]
[[sim.faults]]
kind = "kill" # a fault
at_s = 30.0"""


def changed(text: str, do: str, path: tuple[str | int, ...], value: Any = None) -> tuple[str, bool]:
    return change_text(text, [Change.model_validate({"do": do, "path": path, "value": value})])


def comments(text: str) -> set[str]:
    """Of lines, where no text of ours holds a #."""
    return {line.partition("#")[2].strip() for line in text.splitlines() if "#" in line}


metres = st.floats(-500.0, 500.0).map(lambda metre: round(metre, 2))
points = st.lists(metres, min_size=3, max_size=3)
polygons = st.lists(st.lists(metres, min_size=2, max_size=2), min_size=3, max_size=8)
numbers = {
    ("swarm", "size"): st.integers(1, 250),
    ("route", "vel_leader_mps"): st.floats(0.1, 20.0),
    ("coverage", "radius_m"): st.floats(1.0, 100.0),
    ("limits", "speed_max_mps"): st.floats(1.0, 20.0),
    ("sensing", "range_m"): st.floats(1.0, 100.0),
    ("route", "d1_enu_m"): points,
    ("route", "d2_enu_m"): points,
    ("fence", "polygon_enu_m"): polygons,
    ("name",): st.text(st.characters(codec="utf-8", exclude_categories=("C",)), max_size=20),
}
sets = st.one_of(
    *(st.builds(lambda value, path=path: {"do": "set", "path": path, "value": value}, s) for path, s in numbers.items())
)
removals = st.sampled_from(
    [("fence", "polygon_enu_m"), ("route", "at_end"), ("sensing",), ("swarm", "size"), ("nothing", "there")]
).map(lambda path: {"do": "remove", "path": path})
stops = st.builds(lambda at: {"do": "insert", "path": ("route", "stops", 0), "value": {"pos_enu_m": at}}, points)


@given(st.sampled_from([*TEXTS, ODD]), st.lists(st.one_of(sets, removals, stops), min_size=1, max_size=6))
def test_the_document_holds_what_was_asked_for_and_all_else_as_before(text: str, asked: list[dict[str, Any]]) -> None:
    new, lost = change_text(text, [Change.model_validate(one) for one in asked])
    wanted = tomllib.loads(text)
    for one in asked:
        *way, last = one["path"]
        at = wanted
        for part in way:
            at = at.setdefault(part, {} if part != "stops" else [])
        if one["do"] == "set":
            at[last] = one["value"]
        elif one["do"] == "insert":
            at.insert(last, one["value"])  # type: ignore[attr-defined]
        else:
            at.pop(last, None)
    wanted = {key: value for key, value in wanted.items() if key != "nothing"}
    found = tomllib.loads(new)
    assert {k: v for k, v in found.items() if v != {}} == {k: v for k, v in wanted.items() if v != {}}
    touched = {"polygon_enu_m", "sensing", "at_end", "size"}
    if not any(one["do"] == "remove" or one["path"][-1] in touched for one in asked):
        assert not lost
        assert comments(text) <= comments(new)


@given(st.sampled_from(TEXTS), points, points)
def test_saved_and_loaded_it_is_the_mission_that_was_meant(text: str, d1: list[float], d2: list[float]) -> None:
    """Through the model: places that are good stay what they are to the bit."""
    d1, d2 = [d1[0], d1[1], 4.4], [d2[0], d2[1], 4.4]
    changes = [("d1_enu_m", d1), ("d2_enu_m", d2)]
    new, lost = change_text(text, [Change(do="set", path=("route", key), value=at) for key, at in changes])
    assert not lost
    route = tomllib.loads(new)["route"]
    assert (route["d1_enu_m"], route["d2_enu_m"]) == (d1, d2)
    assert all(isinstance(one, float) for one in route["d1_enu_m"])


@pytest.mark.parametrize("text", TEXTS, ids=[file.stem for file in EXAMPLES])
def test_a_change_that_is_taken_back_leaves_the_file_as_it_was(text: str) -> None:
    before = tomllib.loads(text)["swarm"]["size"]
    there, _ = changed(text, "set", ("swarm", "size"), before + 1)
    back, _ = changed(there, "set", ("swarm", "size"), before)
    assert back == text


def test_only_its_line_changes() -> None:
    text = TEXTS[[file.stem for file in EXAMPLES].index("lone_tree")]
    new, lost = changed(text, "set", ("route", "d2_enu_m"), [120, 5.5, 8])
    assert not lost
    (old_line,) = set(text.splitlines()) - set(new.splitlines())
    (new_line,) = set(new.splitlines()) - set(text.splitlines())
    assert old_line.startswith("d2_enu_m = [130.0, 0.0, 8.0]")
    assert new_line == "d2_enu_m = [120.0, 5.5, 8.0]  # destination: the tree"
    assert parse_mission(new).route.d2_enu_m == (120.0, 5.5, 8.0)


def test_corners_keep_their_lines_and_comments() -> None:
    corners = tomllib.loads(ODD)["fence"]["polygon_enu_m"]
    new, lost = changed(ODD, "set", ("fence", "polygon_enu_m"), [*corners[:2], [60, 70], *corners[2:]])
    assert not lost
    assert comments(ODD) == comments(new)
    fewer, lost = changed(new, "set", ("fence", "polygon_enu_m"), [*corners[:2], *corners[3:]])
    assert not lost
    assert comments(ODD) - comments(fewer) <= {"corner c", "corner b"}


def test_numbers_are_integers_only_where_the_schema_wants_them() -> None:
    new, _ = change_text(
        "schema = 1\n",
        [
            Change(do="set", path=("swarm", "size"), value=5),
            Change(do="set", path=("coverage", "radius_m"), value=20),
            Change(do="insert", path=("route", "stops", 0), value={"pos_enu_m": [1, 2, 3]}),
        ],
    )
    assert (
        new == "schema = 1\n\n[swarm]\nsize = 5\n\n[coverage]\nradius_m = 20.0\n\n"
        "[[route.stops]]\npos_enu_m = [1.0, 2.0, 3.0]\n\n"
    )


def test_with_the_last_stop_the_key_goes() -> None:
    text = TEXTS[[file.stem for file in EXAMPLES].index("mapped_stand")]
    new, lost = changed(text, "remove", ("route", "stops", 0))
    assert (lost, "stops" in tomllib.loads(new)["route"]) == (False, False)
    assert parse_mission(new, "new").route.stops == ()


@pytest.mark.parametrize(
    ("do", "path", "value", "message"),
    [
        ("remove", ("route", "d1_enu_m", 3), None, r"route.d1_enu_m\[3\]: there is no such place"),
        ("insert", ("route", "stops", 3), {"pos_enu_m": [0, 0, 0]}, r"route.stops\[3\]: there is no such place"),
        ("set", ("name", "of"), 1, "name.of: there is no such place"),
        ("set", ("route", 0), 1, r"route\[0\]: there is no such place"),
        ("insert", ("route", "d1_enu_m"), 1, "route.d1_enu_m: there is no such place"),
        ("set", ("route", "d1_enu_m"), [1, None, 2], "route.d1_enu_m: TOML has no null"),
        ("set", ("swarm", "size"), None, "swarm.size: TOML has no null"),
    ],
)
def test_what_fits_nowhere_is_refused_and_nothing_is_changed(
    do: str, path: tuple[str | int, ...], value: Any, message: str
) -> None:
    with pytest.raises(ChangeError, match=message):
        changed('schema = 1\nname = "x"\n[route]\nd1_enu_m = [0.0, 0.0, 1.0]\n', do, path, value)


def test_where_comments_cannot_be_kept_it_is_said_and_the_values_are_right() -> None:
    """A table in a dotted key: the library writes what follows it into that table."""
    text = "forest.grade = [0.1, 0.0] # slope\nschema = 1 # last\n"
    new, lost = changed(text, "set", ("forest", "stand"), {"density_per_ha": 400})
    assert tomllib.loads(new) == {"schema": 1, "forest": {"grade": [0.1, 0.0], "stand": {"density_per_ha": 400.0}}}
    assert lost == ("# last" not in new)
