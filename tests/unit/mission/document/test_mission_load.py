"""A mission file loads, or each value that is wrong is refused with its line."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mission.check.findings import check_document
from mission.document.load import MAX_FILE_BYTES, MissionError, dump_mission, load_document, load_mission, parse_mission
from mission.document.model import MAX_TREES, Mission
from mission.schema.json_schema import json_schema, node_at, resolved
from tests.unit.mission.mission_file_kit import FULL, STOPS, only_problem, problems_of, with_value, without


def leaves(node: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key of the schema, dotted, with its description."""
    schema = json_schema(Mission)
    for name, child in node["properties"].items():
        child = {**resolved(schema, child), **child}
        if "properties" in child:
            yield from leaves(child, (*path, name))
        elif (*path, name) in (
            ("forest", "trees"),
            ("forest", "boxes"),
            ("sim", "faults"),
            ("route", "stops"),
            ("payload",),
        ):
            yield from leaves(node_at(schema, (*path, name, 0)), (*path, f"{name}[0]"))
        else:
            yield ".".join(map(str, (*path, name))), child


LEAVES = dict(leaves(json_schema(Mission)))
NUMBERS = {key: node for key, node in LEAVES.items() if node.get("type") in ("number", "integer")}
BOOLEANS = [key for key, node in LEAVES.items() if node.get("type") == "boolean"]
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
    of_maps = {"forest.file", "route.d1_tree", "route.d2_tree"}
    of_maps |= {"survey.area_enu_m"}  # which stops exclude
    assert all(with_value(key, "1") for key in LEAVES.keys() - of_maps)  # it holds every other key of the schema


def test_a_dump_loads_back_equal() -> None:
    assert parse_mission(dump_mission(parse_mission(FULL + STOPS))) == parse_mission(FULL + STOPS)


def test_a_table_without_a_key_is_written_out_where_it_is_there() -> None:
    text = FULL.replace("\n[survey]\n", "\n[unused]\n").partition("[unused]")
    plain = text[0] + text[2][text[2].index("[forest]") :] + STOPS
    surveys = parse_mission(plain + "[survey]\n")
    assert surveys.survey is not None
    assert parse_mission(dump_mission(surveys)) == surveys
    assert parse_mission(plain).survey is None


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
def test_text_where_a_number_belongs_is_refused_with_its_line(key: str) -> None:
    text, line = with_value(key, '"3"')
    refused = next(p for p in problems_of(text) if p.key == key)
    assert refused.line == line
    assert refused.message.startswith("must be ")


@pytest.mark.parametrize("value", ["true", "nan", "inf", "[1.0]", "2020-01-01", "1" + "0" * 4000])
def test_what_is_not_a_finite_number_is_refused_with_its_line_for_each_key(value: str) -> None:
    # Of one fault: each is looked at by itself.
    every_number = "late_s = 1.5\nbias_m = 0.2\nnoise_m = 0.1\ndelay_s = 0.2\nheight_m = 10.0"
    for part in (0, 1):  # no more than MAX_PROBLEMS at once
        text, lines = FULL.replace("late_s = 1.5", every_number) + STOPS, {}
        for key in list(NUMBERS)[part::2]:
            text, lines[key] = with_value(key, value, text)
        refused = {problem.key: problem for problem in problems_of(text)}
        for key, line in lines.items():
            assert refused[key].line == line
            assert refused[key].message.startswith("must be ")


@pytest.mark.parametrize("value", ['"false"', '"yes"', "0", "1", "1.0"])
@pytest.mark.parametrize("key", BOOLEANS)
def test_only_true_and_false_are_booleans(key: str, value: str) -> None:
    text, line = with_value(key, value)
    refused = next(p for p in problems_of(text) if p.key == key)
    assert (refused.line, refused.value, refused.message) == (line, value, "must be true or false")


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
        ("sim.estimates", '"good"', 'must be one of "exact", "recorded", "2026-11"'),
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
    assert (refused.line, refused.key) == (text.splitlines().index("[forest]") + 2, "forest.trees")
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
            'radio.zzz = "x": unknown key; allowed here: transit_range_m, full_range_m, beacon_rate_hz, bit_rate_kbps',
        ),
    ],
)
def test_an_unknown_key_is_refused_with_a_hint(unknown: str, hint: str) -> None:
    text = FULL.replace("[radio]\n", f"[radio]\n{unknown}\n")
    assert str(only_problem(text)) == f"m.toml:24: {hint}"


def test_an_unknown_table_is_refused_at_its_header() -> None:
    line = len(FULL.splitlines()) + 1
    told = f"m.toml:{line}: radoi = a table: unknown key; did you mean radio?"
    assert str(only_problem(FULL + "[radoi]\n")) == told


def test_the_attributes_name_is_no_key_of_the_file() -> None:
    assert only_problem(FULL.replace("[origin]", "schema_version = 1\n[origin]")).key == "schema_version"


@pytest.mark.parametrize("name", ["stand.csv", "Stand.CSV", "stand.gpkg", "stand.geojson"])
def test_a_stem_map_in_the_place_of_a_mission_is_told_so(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"Nr;H\xf6he\n1;20\n")
    with pytest.raises(MissionError, match=rf"{name}: is a stem map by its name, and a mission is a \.toml: .*--stems"):
        load_mission(tmp_path / name)


@pytest.mark.parametrize("keys", ['missions = ["m.toml"]\nseeds = 4\n', "localise = 1\n"])
def test_a_study_in_the_place_of_a_mission_is_told_so(tmp_path: Path, keys: str) -> None:
    file = tmp_path / "study.toml"
    file.write_text(f"schema = 1\n{keys}[[run]]\nname = 'ours'\n", encoding="utf-8")
    with pytest.raises(MissionError, match=r"study\.toml: is a study, and no mission: `sim-bridge study` flies it$"):
        load_mission(file)
    with pytest.raises(MissionError, match=r"study\.toml: is a study, and no mission: `sim-bridge study` flies it$"):
        check_document(load_document(file), file)
    file.write_text(f"schema = 1\n{keys}[route]\n", encoding="utf-8")  # a mission, with a key that is none of its own
    with pytest.raises(MissionError, match="unknown key"):
        load_mission(file)


@pytest.mark.parametrize("end", [None, 90, 60])
def test_of_a_key_file_in_the_place_of_a_mission_nothing_is_shown(tmp_path: Path, end: int | None) -> None:
    """As when --key and --mission are swapped; also of one that was cut off in its first secret."""
    seed, secret = "5c" * 32, "a7" * 32
    key = f'format = 1\nowner = 3\nseed = "{seed}"  # private\n\n[secrets]\n0 = "{secret}"\n'
    path = tmp_path / "vehicle-3.key"
    path.write_text(key[:end])
    with pytest.raises(MissionError) as refused:
        load_mission(path)
    assert "is a key file, and no mission" in str(refused.value)
    assert "5c5c" not in str(refused.value)
    assert "a7a7" not in str(refused.value)
