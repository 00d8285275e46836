"""Mission files whose parts conflict, and files that are no mission at all."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path

import pytest

from mission.common.problems import MAX_PROBLEMS, lookup
from mission.document.load import MAX_FILE_BYTES, MissionError, load_mission, parse_mission
from mission.document.locate import MAX_ENTRIES
from mission.document.model import MAX_TREES, Mission
from mission.schema.json_schema import json_schema
from tests.unit.mission.mission_file_kit import FULL, only_problem, problems_of, with_value, without

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
    refused = only_problem(text.replace("rise_to_m = 32.0\n", ""))
    assert (refused.line, refused.key) == (line + 1, "coverage.radius_m")
    assert "reaches from -7.0 to 23.0 m" in refused.message
    assert "fence.altitude_min_m = 2.0" in refused.message


def test_a_sphere_too_small_for_the_swarm_is_refused() -> None:
    text, _ = with_value("coverage.shape", '"sphere"')
    text, _ = with_value("swarm.size", "120", text)
    text, _ = with_value("fence.altitude_max_m", "90", text)
    text, _ = with_value("route.d2_enu_m", "[130, 0, 40]", text)
    text, _ = with_value("fence.polygon_enu_m", "[[-99, -99], [199, -99], [199, 99], [-99, 99]]", text)
    refused = only_problem(text.replace("rise_to_m = 32.0\n", ""))
    assert refused.message.startswith("leaves 4.85 m between neighbours")


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
    ring = text.splitlines().index("radius_m = 15.0") + 1
    refused = problems_of(text)
    assert [p.line for p in refused] == [first, second, third, third, ring, fourth]


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
        patch.setattr("mission.document.load.os.open", deny)
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
