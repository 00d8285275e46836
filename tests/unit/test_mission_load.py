"""Mission files: every refusal, with its line."""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mission.load import MAX_FILE_BYTES, MissionError, Problem, dump_mission, load_mission, parse_mission
from mission.locate import MAX_ENTRIES
from mission.model import MAX_TREES, Mission
from mission.problems import MAX_PROBLEMS, lookup
from mission.schema import json_schema, node_at, resolved

# Every key there is, one to a line, so that every refusal has a line to name
FULL = """\
# a comment, and a blank line

schema = 1
name = "all keys"
[origin]
lat_deg = 49.5
lon_deg = 6.36
alt_m = 310.0
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 3.0
arrival_distance_m = 5.0
at_end = "land"
[swarm]
size = 8
leader_priority = [2, 1]
reelection_period_s = 30.0
start_timeout_s = 20.0
[radio]
transit_range_m = 30.0
full_range_m = 55.0
beacon_rate_hz = 10.0
[separation]
hard_m = 5.0
soft_m = 10.0
[coverage]
shape = "ring"
radius_m = 15.0
keep_out_m = 2.0
duration_s = 45.0
[limits]
speed_max_mps = 5.0
climb_max_mps = 1.5
acceleration_max_mps2 = 3.0
[fence]
altitude_min_m = 2.0
altitude_max_m = 30.0
polygon_enu_m = [[-40.0, -50.0], [170.0, -50.0], [170.0, 50.0], [-40.0, 50.0]]
[sensing]
range_m = 8.0
rate_hz = 10.0
field_of_view_deg = 360.0
vehicle_radius_m = 0.35
margin_m = 0.3
stale_s = 0.3
[forest]
grade = [0.01, -0.02]
[forest.stand]
seed = 5
density_per_ha = 400.0
margin_m = 40.0
area_enu_m = [[-40.0, -50.0], [170.0, -50.0], [170.0, 50.0], [-40.0, 50.0]]
spacing_min_m = 1.5
dbh_min_m = 0.1
dbh_mean_m = 0.25
dbh_max_m = 0.5
dbh_shape = 2.0
species = ["spruce", "spruce"]
height_mean_m = 17.0
crown_base_share = 1.0
undergrowth_per_ha = 100.0
undergrowth_height_m = 1.5
clearing_m = 2.0
[[forest.trees]]
base_enu_m = [130.0, 0.0]
trunk_radius_m = 0.6
height_m = 28.0
[sim]
seed = 1
wind_mps = [0.0, 0.0, 0.0]
turbulence_mps = 0.0
radio_loss = 0.0
radio_delay_s = 0.0
radio_trunks = "attenuated"
radio_trunk_db = 6.0
personality = "px4"
personalities = { 3 = "ardupilot" }
estimates = "exact"
velocity_bias_mps = 0.4
climb_bias_mps = 0.1
velocity_noise_mps = 0.2
position_noise_m = 0.3
estimate_delay_s = 0.3
drag = "low"
battery_mah = { 2 = 1000.0 }
placement = "random"
placement_spacing_m = 6.0
time_limit_s = 300.0
[sim.lidar]
noise_m = 0.05
dropout = 0.02
delay_s = 0.0
[[sim.faults]]
kind = "late"
vehicles = [4, 5]
at_s = 10.0
phase = "transit"
for_s = 5.0
late_s = 1.5
"""

STOPS = """\
[[route.stops]]
pos_enu_m = [60.0, 20.0, 8.0]
duration_s = 30.0
"""


def with_value(key: str, value: str, text: str = "") -> tuple[str, int]:
    """`text`, or FULL (with STOPS for a key of theirs), with another value for the dotted `key`, and its line."""
    text = text or (FULL + STOPS if key.startswith("route.stops") else FULL)
    lines, table = text.splitlines(), ""
    for index, line in enumerate(lines):
        if line.startswith("["):
            table = line.strip("[]") + ("[0]." if line.startswith("[[") else ".")
        elif table + line.split(" = ")[0] == key:
            lines[index] = f"{line.split(' = ')[0]} = {value}"
            return "\n".join(lines), index + 1
    raise AssertionError(f"no {key}")


def without(key: str) -> str:
    text, line = with_value(key, "")
    lines = text.splitlines()
    lines[line - 1] = ""
    return "\n".join(lines)


def problems_of(text: str) -> tuple[Problem, ...]:
    with pytest.raises(MissionError) as caught:
        parse_mission(text, "m.toml")
    return caught.value.problems


def only_problem(text: str) -> Problem:
    problems = problems_of(text)
    assert len(problems) == 1, [str(problem) for problem in problems]
    return problems[0]


def leaves(node: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key of the schema, dotted, with its description."""
    schema = json_schema(Mission)
    for name, child in node["properties"].items():
        child = {**resolved(schema, child), **child}
        if "properties" in child:
            yield from leaves(child, (*path, name))
        elif (*path, name) in (("forest", "trees"), ("sim", "faults"), ("route", "stops")):
            yield from leaves(node_at(schema, (*path, name, 0)), (*path, f"{name}[0]"))
        else:
            yield ".".join(map(str, (*path, name))), child


LEAVES = dict(leaves(json_schema(Mission)))
NUMBERS = {key: node for key, node in LEAVES.items() if node.get("type") in ("number", "integer")}
VECTORS = {key: node for key, node in LEAVES.items() if "prefixItems" in node}


def beyond(node: dict[str, Any]) -> list[str]:
    """Values just outside the bounds of `node`."""
    step = 1 if node["type"] == "integer" else 1e-6
    values = [node["minimum"] - step] if "minimum" in node else []
    values += [node["exclusiveMinimum"]] if "exclusiveMinimum" in node else []
    values += [node["maximum"] + step] if "maximum" in node else []
    return [repr(int(v) if node["type"] == "integer" else float(v)) for v in values]


# Good files


def test_a_file_with_every_key_loads() -> None:
    full = parse_mission(FULL + STOPS)

    assert full.name == "all keys"
    assert full.swarm.leader_priority == (2, 1)
    assert full.sim.time_limit_s == 300.0
    assert "forest.file" in LEAVES  # which [forest.stand] excludes
    assert full.route.stops[0].duration_s == 30.0
    assert all(with_value(key, "1") for key in LEAVES if key != "forest.file")  # it holds every key of the schema


def test_a_dump_loads_back_equal() -> None:
    assert parse_mission(dump_mission(parse_mission(FULL + STOPS))) == parse_mission(FULL + STOPS)


def test_the_largest_forest_that_a_mission_holds_is_written_out_within_its_limits() -> None:
    """Trees to 1 mm, and the longest of everything else."""
    ring = [
        [round(600 * math.cos(k * math.tau / 64), 3), round(600 * math.sin(k * math.tau / 64), 3)] for k in range(64)
    ]
    text = FULL + STOPS * 20
    for key in ("fence.polygon_enu_m", "forest.stand.area_enu_m"):
        text, _ = with_value(key, str(ring), text)
    text, _ = with_value("forest.stand.density_per_ha", "50", text)
    for k in reversed(range(20)):
        text = text.replace("[60.0, 20.0, 8.0]", f"[{60 + 6 * k}.0, 20.0, 8.0]", 1)  # the last stays
    trees = "".join(
        f"{{base_enu_m=[-{60 + k % 40}.{k:03d},{k - 350}.{k:03d}],trunk_radius_m=0.{200 + k},height_m=28.12}},\n"
        for k in range(MAX_TREES)
    )
    head, _, rest = text.partition("[[forest.trees]]")
    _, _, tail = rest.partition("[sim]")
    mission = parse_mission(
        head.replace("[forest]\n", f"[forest]\ntrees=[\n{trees}]\n") + "[sim]" + tail.replace("300", "5000")
    )

    written = dump_mission(mission)
    assert len(written.encode()) < MAX_FILE_BYTES
    assert parse_mission(written) == mission


def test_a_mission_that_no_file_holds_is_not_written() -> None:
    tree = {"base_enu_m": (-61.123456789012345, 62.123456789012345), "trunk_radius_m": 1 / 3, "height_m": 100 / 3}
    values = parse_mission(FULL).model_dump(by_alias=True)
    values["forest"]["trees"] = [tree] * MAX_TREES
    with pytest.raises(MissionError, match=r"KiB written out: must be at most 64 KiB; a stem map"):
        dump_mission(Mission.model_validate(values))


def test_windows_newlines_and_a_byte_order_mark_are_no_obstacle(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_bytes(b"\xef\xbb\xbf" + FULL.replace("\n", "\r\n").encode())

    assert load_mission(file) == parse_mission(FULL)
    assert load_mission(str(file)) == parse_mission(FULL)


# Fields by themselves


@pytest.mark.parametrize("key", NUMBERS)
def test_a_number_beyond_its_bounds_is_refused_with_its_line(key: str) -> None:
    for value in beyond(NUMBERS[key]):
        text, line = with_value(key, value)
        refused = next(p for p in problems_of(text) if p.key == key)
        assert (refused.line, refused.value) == (line, value)
        assert refused.message.startswith("must be ")


@pytest.mark.parametrize("key", NUMBERS)
@pytest.mark.parametrize("value", ['"3"', "true", "nan", "inf", "[1.0]", "2020-01-01", "1" + "0" * 4000])
def test_what_is_not_a_finite_number_is_refused_with_its_line(key: str, value: str) -> None:
    text, line = with_value(key, value)
    refused = next(p for p in problems_of(text) if p.key == key)
    assert refused.line == line
    assert refused.message.startswith("must be ")


@pytest.mark.parametrize("key", VECTORS)
def test_a_vector_has_exactly_its_components(key: str) -> None:
    size = len(VECTORS[key]["prefixItems"])
    for count in (size - 1, size + 1):
        text, line = with_value(key, repr([1.0] * count))
        assert (line, f"an array of {size}") in [(p.line, p.message[8:21]) for p in problems_of(text) if p.key == key]


@pytest.mark.parametrize("key", VECTORS)
def test_a_component_beyond_its_bounds_is_named_by_its_index(key: str) -> None:
    text, line = with_value(key, repr([1e9, *[1.0] * (len(VECTORS[key]["prefixItems"]) - 1)]))
    refused = next(p for p in problems_of(text) if p.key == f"{key}[0]")
    assert (refused.line, refused.value) == (line, "1000000000.0")


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("schema", "2", "must be 1"),
        ("schema", "1.0", "must be 1"),
        ("schema", "true", "must be 1"),
        ("name", "3", "must be text of at most 80 characters"),
        ("name", f'"{"x" * 81}"', "must be text of at most 80 characters"),
        ("name", r'"two\nlines"', "must be one line of printable characters"),
        ("route.at_end", '"rtl"', 'must be one of "hold", "land", "return"'),
        ("coverage.shape", '"disc"', 'must be one of "ring", "sphere"'),
        ("sim.placement", '"heap"', 'must be one of "random", "grid", "ring"'),
        ("sim.estimates", '"good"', 'must be one of "exact", "recorded"'),
        ("sim.drag", "0.3", 'must be one of "low", "sih"'),
        ("radio.beacon_rate_hz", "3", "must be one of 1, 2, 4, 5, 10, 20"),
        ("radio.beacon_rate_hz", "40", "must be one of 1, 2, 4, 5, 10, 20"),
        ("swarm.size", "8.0", "must be an integer from 1 to 250"),
        ("swarm.leader_priority", "[1, 1]", "each id at most once"),
        ("swarm.leader_priority", "3", "must be an array of 0 to 250"),
        ("fence.polygon_enu_m", "[[0, 0], [1, 1]]", "must be an array of 3 to 64"),
        (
            "fence.polygon_enu_m",
            repr([[float(i), float(i * i)] for i in range(65)]),
            "must be an array of 3 to 64",
        ),
        ("fence.polygon_enu_m", "[[-40, -50], [170, 50], [170, -50], [-40, 50]]", "must be a simple polygon"),
        (
            "fence.polygon_enu_m",
            "[[-40, -50], [170, -50], [170, 50], [-40, -50]]",
            "must not repeat a vertex",
        ),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_with_its_line(key: str, value: str, allowed: str) -> None:
    text, line = with_value(key, value)
    refused = next(p for p in problems_of(text) if p.key == key)
    assert refused.line == line
    assert allowed in refused.message


def test_an_id_beyond_250_is_named_by_its_index() -> None:
    text, line = with_value("swarm.leader_priority", "[1, 251]")
    refused = only_problem(text)
    assert (refused.line, refused.key, refused.value) == (line, "swarm.leader_priority[1]", "251")


def test_a_table_in_the_place_of_a_value_and_the_reverse_are_refused() -> None:
    refused = problems_of("schema = 1\nroute = 3\nname = { a = 1 }\n")
    assert [(p.line, p.key, p.value, p.message) for p in refused] == [
        (2, "route", "3", "must be a table"),
        (3, "name", "a table", "must be text of at most 80 characters"),
    ]


def test_more_trees_than_allowed_are_refused() -> None:
    tree = "{base_enu_m=[60,30],trunk_radius_m=1,height_m=9},"
    text = FULL.split("[forest]")[0] + "[forest]\ntrees = [" + tree * (MAX_TREES + 1) + "]\n"
    refused = only_problem(text)
    assert (refused.line, refused.key) == (48, "forest.trees")
    assert f"0 to {MAX_TREES}" in refused.message


# Missing and unknown keys


@pytest.mark.parametrize(
    ("key", "header"),
    [
        ("route.d1_enu_m", "[route]"),
        ("route.d2_enu_m", "[route]"),
        ("route.vel_leader_mps", "[route]"),
        ("origin.lat_deg", "[origin]"),
        ("origin.lon_deg", "[origin]"),
        ("origin.alt_m", "[origin]"),
        ("route.stops[0].pos_enu_m", "[[route.stops]]"),
        ("forest.trees[0].base_enu_m", "[[forest.trees]]"),
        ("forest.trees[0].trunk_radius_m", "[[forest.trees]]"),
        ("forest.trees[0].height_m", "[[forest.trees]]"),
    ],
)
def test_a_missing_key_is_named_at_the_header_of_its_table(key: str, header: str) -> None:
    missing = only_problem(without(key))
    assert (missing.line, missing.key, missing.value) == ((FULL + STOPS).splitlines().index(header) + 1, key, "")
    assert missing.message.startswith("missing; must be ")


def test_a_missing_schema_is_named_at_line_1() -> None:
    assert str(only_problem(without("schema"))) == "m.toml:1: schema: missing; must be 1"


def test_an_empty_file_is_told_every_key_that_it_needs() -> None:
    assert [str(p) for p in problems_of("")] == [
        "m.toml:1: schema: missing; must be 1",
        "m.toml:1: route.d1_enu_m: missing; must be an array of 3, each a number from -20000 to 20000",
        "m.toml:1: route.d2_enu_m: missing; must be an array of 3, each a number from -20000 to 20000",
        "m.toml:1: route.vel_leader_mps: missing; must be a number from 0.05 to 30",
    ]


@pytest.mark.parametrize(
    ("unknown", "hint"),
    [
        ("transit_rnage_m = 3", "radio.transit_rnage_m = 3: unknown key; did you mean transit_range_m?"),
        ("size = 3", "radio.size = 3: unknown key; did you mean swarm.size?"),
        (
            "zzz = 'x'",
            'radio.zzz = "x": unknown key; allowed here: transit_range_m, full_range_m, beacon_rate_hz',
        ),
    ],
)
def test_an_unknown_key_is_refused_with_a_hint(unknown: str, hint: str) -> None:
    text = FULL.replace("[radio]\n", f"[radio]\n{unknown}\n")
    assert str(only_problem(text)) == f"m.toml:21: {hint}"


def test_an_unknown_table_is_refused_at_its_header() -> None:
    line = len(FULL.splitlines()) + 1
    told = f"m.toml:{line}: radoi = a table: unknown key; did you mean radio?"
    assert str(only_problem(FULL + "[radoi]\n")) == told


def test_the_attributes_name_is_no_key_of_the_file() -> None:
    assert only_problem(FULL.replace("[origin]", "schema_version = 1\n[origin]")).key == "schema_version"


# Fields together


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        (
            "route.d2_enu_m",
            "[0.0, 0.0, 8.0]",
            "must differ from the deployment point (route.d1_enu_m = [0.0, 0.0, 8.0])",
        ),
        ("route.arrival_distance_m", "130.0", "must be less than the 130.0 m from d1 to d2"),
        ("route.arrival_distance_m", "15.0", "must be less than coverage.radius_m = 15.0"),
        ("coverage.keep_out_m", "3.8", "must be at most 3.70 m: the leader comes to rest 0.8 of arrival_distance_m"),
        ("separation.hard_m", "10.0", "must be less than separation.soft_m = 10.0"),
        ("separation.soft_m", "29.9", "must be at most 21.00 m, 70% of the range: the leader slows down"),
        ("radio.transit_range_m", "56.0", "must be at most radio.full_range_m = 55.0"),
        ("route.vel_leader_mps", "5.5", "must be at most limits.speed_max_mps = 5.0"),
        ("swarm.leader_priority", "[9]", "has no vehicle 9: ids are 1 to 8 (swarm.size = 8)"),
        ("fence.altitude_min_m", "30.0", "must be less than fence.altitude_max_m = 30.0"),
        (
            "route.d1_enu_m",
            "[0.0, 0.0, 1.0]",
            "must be inside the fence's altitudes, 0.3 m from each (fence.altitude_min_m = 2.0",
        ),
        ("route.d2_enu_m", "[130.0, 0.0, 31.0]", "must be inside the fence's altitudes"),
        ("route.d1_enu_m", "[-60.0, 0.0, 8.0]", "must be inside the fence (fence.polygon_enu_m = [[-40.0"),
        (
            "route.d1_enu_m",
            "[-30.0, 0.0, 8.0]",
            "13.6 m for the starting points and 5 m of slack (fence.polygon_enu_m",
        ),
        ("route.d2_enu_m", "[180.0, 0.0, 8.0]", "must be inside the fence (fence.polygon_enu_m = [[-40.0"),
        ("route.d2_enu_m", "[151.0, 0.0, 8.0]", "must be at least radius_m and 5 m of slack"),
        ("separation.hard_m", "5.8", "must be at most placement_spacing_m less 0.3 m (sim.placement_spacing_m = 6.0)"),
        ("sim.placement_spacing_m", "14.1", "must be at most transit_range_m less 2 m, and half of that for random"),
        ("forest.trees[0].trunk_radius_m", "2.5", "must be at most coverage.keep_out_m = 2.0"),
        ("forest.trees[0].base_enu_m", "[0.0, 15.0]", "stands 14.4 m from d1: must be at least 14.6 m"),
    ],
)
def test_fields_that_conflict_are_refused_with_both_and_a_line(key: str, value: str, named: str) -> None:
    text, line = with_value(key, value)
    refused = [p for p in problems_of(text) if p.key == key and named in p.message]
    assert [(p.line, p.value) for p in refused] == [(line, value)]


def test_a_climb_steeper_than_the_limit_is_refused() -> None:
    text, _ = with_value("route.d2_enu_m", "[130.0, 0.0, 29.0]")
    text, line = with_value("limits.climb_max_mps", "0.4", text)
    refused = only_problem(text)
    assert (refused.key, refused.line) == ("route.vel_leader_mps", 12)
    assert "at 0.48 m/s" in refused.message
    assert "limits.climb_max_mps = 0.4" in refused.message
    assert line > 12


def test_a_ring_too_small_for_the_swarm_is_refused() -> None:
    text, line = with_value("coverage.radius_m", "6.0")
    refused = only_problem(text)
    assert (refused.line, refused.key) == (line, "coverage.radius_m")
    assert "leaves 4.59 m between neighbours" in refused.message
    assert "swarm.size = 8, separation.hard_m = 5.0" in refused.message


def test_a_radio_that_loses_everything_is_refused() -> None:
    text, line = with_value("sim.radio_loss", "1.0")
    assert str(only_problem(text)) == f"m.toml:{line}: sim.radio_loss = 1.0: must be a number at least 0, below 1"
    assert parse_mission(with_value("sim.radio_loss", "0.99")[0]).sim.radio_loss == 0.99


def test_a_ring_too_large_for_the_radio_is_refused() -> None:
    text, line = with_value("coverage.radius_m", "80.0", without("fence.polygon_enu_m"))
    refused = only_problem(text)
    assert (refused.line, refused.key) == (line, "coverage.radius_m")
    assert "puts neighbours 61.23 m apart" in refused.message
    assert "radio.full_range_m = 55.0" in refused.message


def test_a_sphere_that_leaves_the_fences_altitudes_is_refused() -> None:
    text, line = with_value("coverage.shape", '"sphere"')
    refused = only_problem(text)
    assert (refused.line, refused.key) == (line + 1, "coverage.radius_m")
    assert "reaches from -7.0 to 23.0 m" in refused.message
    assert "fence.altitude_min_m = 2.0" in refused.message


def test_a_sphere_too_small_for_the_swarm_is_refused() -> None:
    text, _ = with_value("coverage.shape", '"sphere"')
    text, _ = with_value("swarm.size", "120", text)
    text, _ = with_value("fence.altitude_max_m", "90", text)
    text, _ = with_value("route.d2_enu_m", "[130, 0, 40]", text)
    text, _ = with_value("fence.polygon_enu_m", "[[-99, -99], [199, -99], [199, 99], [-99, 99]]", text)
    assert only_problem(text).message.startswith("leaves 4.85 m between neighbours")


def test_a_fence_that_cuts_the_way_is_refused() -> None:
    notched = "[[-40, -50], [65, -50], [65, 10], [70, 10], [70, -50], [170, -50], [170, 50], [-40, 50]]"
    text, line = with_value("fence.polygon_enu_m", notched)
    refused = only_problem(text)
    assert (refused.line, refused.key) == (line, "fence.polygon_enu_m")
    assert "must hold the straight way d1 to d2" in refused.message


def test_a_conflict_with_a_default_is_told_at_the_line_that_is_written() -> None:
    route = "[route]\nd1_enu_m = [0, 0, 8]\nd2_enu_m = [99, 0, 8]\nvel_leader_mps = 3\n"
    refused = only_problem(f"schema = 1\n{route}[radio]\nfull_range_m = 20\n")
    assert str(refused) == "m.toml:7: radio.transit_range_m = 30.0: must be at most radio.full_range_m = 20.0"


def test_a_tree_beside_the_tree_at_d2_may_be_thicker_than_keep_out() -> None:
    parse_mission(FULL + "[[forest.trees]]\nbase_enu_m = [140, 0]\ntrunk_radius_m = 3\nheight_m = 9\n")


# All at once


def test_every_problem_is_reported_at_once_in_the_order_of_the_file() -> None:
    text, first = with_value("route.vel_leader_mps", '"fast"')
    text, second = with_value("radio.beacon_rate_hz", "3", text)
    text, third = with_value("separation.hard_m", "12.0", text)  # against soft, placement and the ring
    text, fourth = with_value("sim.seed", "-1", text)
    refused = problems_of(text)
    assert [p.line for p in refused] == [first, second, third, third, 29, fourth]


def test_what_is_refused_by_itself_is_left_out_of_conflicts() -> None:
    text, _ = with_value("separation.hard_m", "-1.0")
    assert only_problem(text).key == "separation.hard_m"


def test_the_second_of_two_tables_is_named_by_its_index_and_line() -> None:
    text = FULL + "\n[[forest.trees]]\nbase_enu_m = [60, 30]\ntrunk_radius_m = 1\nheight_m = -3\n"
    refused = only_problem(text)
    line = len(text.splitlines())
    assert str(refused) == f"m.toml:{line}: forest.trees[1].height_m = -3: must be a number above 0, at most 150"


def test_an_item_of_an_array_over_several_lines_has_its_own_line() -> None:
    text, line = with_value("fence.polygon_enu_m", "[\n  [-40, -50], # ] not the end\n  [170, -50],\n  [170, 1e9]\n]")
    refused = only_problem(text)
    assert (refused.line, refused.key) == (line + 3, "fence.polygon_enu_m[2][1]")


# TOML and files


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("schema = 1\nname = \n", 2, "not TOML: Invalid value (column 8)"),
        ("schema = 1\nname = 'x", 2, 'not TOML: Expected "\'" (end of file)'),
        ("schema = 1\nschema = 1\n", 2, "not TOML: Cannot overwrite a value (column 11)"),
        ("[route]\n[route]\n", 2, "not TOML: Cannot declare ('route',) twice (column 7)"),
        ("schema = 1\n\nx = " + "[" * 60000, 3, "nested too deep: at most 8 levels"),
        ("schema = 1\nx = " + "{a=" * 20000, 2, "nested too deep: at most 8 levels"),
        ("schema = 1\n" + "a." * 30000 + "a = 1\n", 2, "nested too deep: at most 8 levels"),
        ("[" + "a." * 30000 + "a]\n", 1, "nested too deep: at most 8 levels"),
        ("schema = 1\nx = " + "9" * 60000, 2, "holds a number with too many digits"),
        ("x = [" + "1," * 20000 + "]\n", 1, f"holds too many values: at most {MAX_ENTRIES}"),
    ],
)
def test_what_is_not_toml_is_refused_with_its_line(text: str, line: int, message: str) -> None:
    assert [(p.line, p.message) for p in problems_of(text)] == [(line, message)]


def test_a_file_that_is_not_utf8_is_refused_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_bytes(b"schema = 1\nname = 'B\xe4ume'\n")

    with pytest.raises(MissionError, match=r"m\.toml:2: not UTF-8 text: byte 0xe4"):
        load_mission(file)


def test_a_file_that_is_too_large_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "m.toml"
    file.write_bytes(FULL.encode().ljust(MAX_FILE_BYTES, b"\n"))
    assert load_mission(file).swarm.size == 8

    file.write_bytes(FULL.encode().ljust(MAX_FILE_BYTES + 1, b"\n"))
    with pytest.raises(MissionError, match="is too large: must be at most 64 KiB"):
        load_mission(file)


def test_what_is_not_a_readable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="no such file"):
        load_mission(tmp_path / "none.toml")
    with pytest.raises(MissionError, match="is a directory"):
        load_mission(tmp_path)
    with pytest.raises(MissionError, match="is not a path"):
        load_mission("nul\0byte")
    with pytest.raises(MissionError, match="cannot be read: File name too long"):
        load_mission("x" * 10_000)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX")
def test_a_named_pipe_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(MissionError, match="is not a regular file"):
        load_mission(tmp_path / "pipe")


def test_a_file_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def deny(*_: object) -> int:  # root, who may run the tests, may read everything
        raise PermissionError(13, "Permission denied")

    file = tmp_path / "m.toml"
    file.write_text(FULL)
    with monkeypatch.context() as patch:
        patch.setattr("mission.load.os.open", deny)
        with pytest.raises(MissionError, match="must be readable: permission denied"):
            load_mission(file)


# Messages


def test_what_the_file_says_is_shortened_and_printable_in_messages() -> None:
    text = 'schema = 1\n"\\u001b[31m\\n" = "\\u0007' + "x" * 5000 + '"\n' + "k" * 5000 + " = 1\n"
    refused = str(MissionError(p for p in problems_of(text) if p.line != 1))
    assert all(len(line) < 350 and line.isprintable() for line in refused.splitlines())
    assert r"m.toml:2: \x1b[31m\n = " in refused


def test_a_path_is_printable_in_messages(tmp_path: Path) -> None:
    with pytest.raises(MissionError) as caught:
        load_mission(f"{tmp_path}/a\x1b\n\udcff.toml")
    assert str(caught.value).isprintable()


def test_ten_thousand_problems_are_a_hundred_and_a_count() -> None:
    refused = problems_of("".join(f"k{i} = 1\n" for i in range(3000)))
    assert len(refused) == MAX_PROBLEMS + 1
    assert refused[-1].message == "and 2904 more problems"


@pytest.mark.parametrize(
    "text",
    [
        "".join(f"k{i}=1\n" for i in range(MAX_ENTRIES)),
        "".join(f"[a{i}]\n" for i in range(MAX_ENTRIES)),
        "[[forest.trees]]\n" * 3800,
        "x=[" + "{a=1}," * 9000 + "]",
        "\n" * MAX_FILE_BYTES,
        'x="""' + '"" ' * 20000 + '"""',
        "x='" + "a" * 60000,
        "a" * 60000 + "=1",
        FULL + "[[forest.trees]]\nbase_enu_m=[60,30]\ntrunk_radius_m=1\nheight_m=9\n" * (MAX_TREES - 1),
    ],
    ids=[
        "keys",
        "tables",
        "trees",
        "inline",
        "newlines",
        "quotes",
        "open string",
        "long key",
        "largest forest",
    ],
)
def test_the_worst_files_are_judged_in_time_for_a_preflight(text: str) -> None:
    json_schema(Mission)  # made once
    start_s = time.process_time()
    with contextlib.suppress(MissionError):
        parse_mission(text[:MAX_FILE_BYTES])
    # Measured: 20 to 65 ms. The slack is for busy machines and coverage; what counts is that nothing explodes
    assert time.process_time() - start_s < 1.0


def test_lookup_knows_tables_and_arrays() -> None:
    assert lookup({"a": [{"b": 1}]}, ("a", 0, "b")) == 1
    with pytest.raises(KeyError):
        lookup({"a": [1]}, ("a", 1))
