"""Missions in which not all vehicles have GNSS: which have, and what else the file must then say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from companion.core.perception.landmarks import constellation
from companion.sensors.table import kinds_of
from mission.check.findings import ALONE_TREES
from mission.cli import check
from mission.common.problems import MissionError
from mission.document import simulator
from mission.document.load import dump_mission, parse_mission
from mission.document.model import Mission
from mission.stand.stand import Stand
from sim_bridge.world.sensors.ranging import range_radios_of
from tests.unit.core.ranging_kit import STARTS, ranging_mission

ROUTE = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3}


def flown(gnss: Any, *, priority: tuple[int, ...] = (), size: int = 4, **tables: Any) -> Mission:
    swarm = {"size": size, "leader_priority": priority, "gnss": gnss}
    return Mission.model_validate({"schema": 1, "route": ROUTE, "swarm": swarm, **tables})


def refusal(gnss: Any, **others: Any) -> str:
    with pytest.raises(ValidationError) as refused:
        flown(gnss, **others)
    return str(refused.value)


RANGING = {"ranging": {"start_enu_m": STARTS}}
FAULT = {"kind": "range-errors", "at_s": 5.0, "vehicles": [2], "bias_m": 0.5, "noise_m": 0.1}


def test_by_default_all_have_satellites() -> None:
    mission = Mission.model_validate({"schema": 1, "route": ROUTE})
    assert not mission.flies_by_ranges
    assert all(mission.has_satellites(k) for k in range(1, 9))


def test_the_leader_is_the_first_of_those_that_may_lead() -> None:
    mission = flown("leader", priority=(3, 1), **RANGING)
    assert mission.flies_by_ranges
    assert [k for k in range(1, 5) if mission.has_satellites(k)] == [3]


def test_ids_name_those_that_have_satellites() -> None:
    mission = flown((1, 4), **RANGING)
    assert [k for k in range(1, 5) if mission.has_satellites(k)] == [1, 4]
    assert not flown((1, 2, 3, 4)).flies_by_ranges


@pytest.mark.parametrize(
    ("gnss", "others", "said"),
    [
        ("leader", RANGING, 'swarm.gnss = "leader": needs the leader that has GNSS'),
        ("leader", {"priority": (1,)}, "needs [ranging], for where each stands at the start"),
        ("leader", {"priority": (1,)}, "by range radios, or by trunks alone (radio = false)"),
        ((), RANGING, "needs one vehicle at least"),
        ((1, 7), RANGING, "must name vehicles of the swarm (swarm.size = 4)"),
        ((1,), {"size": 5, **RANGING}, "swarm.size = 5: ranging.start_enu_m has 4 positions"),
        (
            (1,),
            {"ranging": {"start_enu_m": STARTS, "reach_m": 14.9}},
            "ranging.reach_m = 14.9: must be at least 1.5 times",
        ),
        (
            (1,),
            {"ranging": {"start_enu_m": [(0, 0, 0), (6, 0, 0), (20, 0, 0), (40, 0, 0)]}},
            "has vehicles 1 and 2 6.0 m",
        ),
        (
            (1,),
            {"ranging": {"start_enu_m": [(0, 0, 0), (8, 0, 0), (16, 0, 0.5), (24, 0, 0)]}},
            "must be 0 up, each: vehicles stand on the ground",
        ),
        (
            "all",
            {"sim": {"satellites": {"crowns": "shade"}}},
            'sim.satellites.crowns = "shade": must be clear: a swarm of which all',
        ),
        (
            "leader",
            {"priority": (1,), "size": 1, "sim": {"satellites": {"crowns": "shade"}}},
            'has nothing else to fly by (swarm.gnss = "leader", swarm.size = 1)',
        ),
        (
            (1,),
            {"priority": tuple(range(1, 129)), "size": 128, **RANGING},
            "must be at most 127 ids where not all have GNSS",
        ),
        ("some", RANGING, 'must be "all", "leader", or an array of ids, 1 to 250'),
        ((1, 1), RANGING, "each at most once"),
        ((1, 0), RANGING, "1 to 250"),
        (True, RANGING, "or an array of ids"),
    ],
)
def test_what_does_not_go_together_is_refused(gnss: Any, others: Any, said: str) -> None:
    assert said in refusal(gnss, **others)


RAW = {"sensing": {"sensor": "scan-1deg", "range_m": 12.0}}
NO_RADIO = {"ranging": {"start_enu_m": STARTS, "radio": False}}


def test_without_range_radios_vehicles_fly_by_trunks() -> None:
    mission = flown((1,), **NO_RADIO, **RAW)
    assert mission.flies_by_ranges
    assert mission.shares_trunks
    assert not mission.has_range_radios
    assert flown((1,), **RANGING, **RAW).has_range_radios
    assert not flown("all").has_range_radios
    near = {"start_enu_m": STARTS, "radio": False, "reach_m": 5.0}  # of no radio
    assert not flown((1,), ranging=near, **RAW).has_range_radios


@pytest.mark.parametrize(
    ("gnss", "others", "said"),
    [
        ("all", {**NO_RADIO, **RAW}, "ranging.radio = false: must be true where all have GNSS"),
        ((1,), NO_RADIO, "ranging.radio = false: must be true without [sensing]"),
        ((1,), {**NO_RADIO, "sensing": {"range_m": 8.0}}, "ranging.radio = false: must be true unless"),
        (
            (1,),
            {**NO_RADIO, **RAW, "sim": {"faults": [FAULT]}},
            'sim.faults[0].kind = "range-errors": range-errors needs range radios (ranging.radio = false)',
        ),
    ],
)
def test_what_flies_without_range_radios_needs_trunks(gnss: Any, others: Any, said: str) -> None:
    assert said in refusal(gnss, **others)


@pytest.mark.parametrize("gnss", ["all", "leader"])
@pytest.mark.parametrize("radio", [True, False])
def test_a_swarm_of_one_has_nobody_to_find_whatever_its_others_would_find_it_by(
    gnss: str, radio: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ranging = {"start_enu_m": STARTS, "radio": radio}
    one = flown(gnss, priority=(1,), size=1, ranging=ranging)
    assert not one.flies_by_ranges
    assert range_radios_of(one, Stand(), (1,)) is None or radio
    file = tmp_path / "one.toml"
    file.write_text(dump_mission(one))
    assert check.run([str(file)], as_json=False) == 0
    assert "a swarm of one has GNSS, and no others to find: nothing comes of [ranging]" in capsys.readouterr().out


def test_by_trunks_alone_one_of_the_swarm_flies_by_itself() -> None:
    assert not flown("leader", priority=(1,), **NO_RADIO, **RAW).with_size(1).flies_by_ranges


def test_no_range_radio_is_asked_for_nor_simulated() -> None:
    mission = flown((1,), **NO_RADIO, **RAW)
    assert "ranges" not in kinds_of(mission)
    assert "ranges" in kinds_of(flown((1,), **RANGING, **RAW))
    assert range_radios_of(mission, Stand(), (1, 2)) is None
    assert range_radios_of(flown((1,), **RANGING, **RAW), Stand(), (1, 2)) is not None


def test_a_smaller_swarm_takes_the_first_places() -> None:
    assert ranging_mission().with_size(3).flies_by_ranges


def test_the_file_is_written_and_read_back() -> None:
    mission = ranging_mission()
    assert parse_mission(dump_mission(mission), "again") == mission


def test_who_cannot_measure_ranges_refuses_such_a_mission() -> None:
    with pytest.raises(MissionError, match=r"swarm.gnss = .leader.: must be all: no radios here"):
        simulator.needs_satellites(ranging_mission(), "file", "no radios here")
    simulator.needs_satellites(Mission.model_validate({"schema": 1, "route": ROUTE}), "file", "no radios here")


FAR = [(0, 0, 0), (8, 0, 0), (16, 0, 0), (40, 0, 0)]
FENCE = {"polygon_enu_m": [(-30, -40), (200, -40), (200, 40), (-30, 40)]}


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"fence": FENCE}, "route.d1_enu_m = [0.0, 0.0, 8.0]: is 30.0 m inside the fence: must be at least 42.0 m"),
        ({"forest": {"trees": [{"base_enu_m": (20, 5), "trunk_radius_m": 0.3, "height_m": 20}]}}, "m from d1"),
    ],
)
def test_start_places_that_are_too_far_out_are_named_and_not_the_simulators_placement(tables: Any, said: str) -> None:
    told = refusal((1,), ranging={"start_enu_m": FAR}, **tables)
    assert said in told
    assert "ranging.start_enu_m = [[0.0, 0.0, 0.0], [8.0, 0.0, 0.0]," in told
    assert "sim.placement" not in told


def test_a_key_like_one_of_its_table_is_meant_there_before_one_of_another_table() -> None:
    with pytest.raises(MissionError, match=r"ranging.range_m = 25.0: unknown key; did you mean reach_m\?"):
        parse_mission(dump_mission(ranging_mission()).replace("reach_m = 25.0", "range_m = 25.0"), "m.toml")


def test_check_says_what_does_nothing_where_all_have_satellites(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    swarm = {"size": 4, "gnss": "all", "leader_priority": (), "position_uncertain": "hold"}
    file = tmp_path / "all.toml"
    file.write_text(dump_mission(ranging_mission(swarm=swarm, sim={"odometry": {"yaw_deg": 4.0}})))
    assert check.run([str(file)], as_json=False) == 0
    said = "all have GNSS (swarm.gnss): nothing comes of swarm.position_uncertain, [sim.odometry]"
    assert said in capsys.readouterr().out
    file.write_text(dump_mission(ranging_mission()))
    assert check.run([str(file)], as_json=False) == 0
    assert "nothing comes" not in capsys.readouterr().out


def test_check_says_that_no_crowns_stand_where_they_are_to_shade(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "shade.toml"
    stand = {"forest": {"stand": {"density_per_ha": 50.0}}}
    for forest, is_told in (({}, True), (stand, False)):
        tables = dump_mission(ranging_mission(sim={"satellites": {"crowns": "shade"}}, **forest))
        file.write_text(tables)
        assert check.run([str(file)], as_json=False) == 0
        assert ("nothing comes of sim.satellites.crowns" in capsys.readouterr().out) is is_told


@pytest.mark.parametrize("tables", [{"ranging": {}}, {"ranging": {"radio": False}, "sensing": {"sensor": "scan-1deg"}}])
@pytest.mark.parametrize("forest", [{}, {"stand": {"density_per_ha": 200.0}}])
def test_start_positions_that_are_missing_are_named(tables: Any, forest: Any) -> None:
    assert "ranging.start_enu_m has 0 positions: each vehicle needs one" in refusal((1,), forest=forest, **tables)


@pytest.mark.parametrize(
    ("range_m", "density_per_ha", "radio", "said"),
    [
        (12.0, 50.0, {}, "with sensing.range_m = 12 and forest.stand.density_per_ha = 50 vehicles may see too few"),
        (20.0, 200.0, {}, ""),
        (20.0, 200.0, {"reach_m": 30.0}, "no range radios (ranging.radio): nothing comes of ranging.reach_m"),
    ],
)
def test_check_says_what_trunks_alone_may_lack(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    range_m: float,
    density_per_ha: float,
    radio: dict[str, float],
    said: str,
) -> None:
    file = tmp_path / "alone.toml"
    mission = ranging_mission(
        ranging={"start_enu_m": STARTS, "radio": False, **radio},
        sensing={"sensor": "scan-0.5deg", "range_m": range_m},
        forest={"stand": {"density_per_ha": density_per_ha}},
    )
    file.write_text(dump_mission(mission))
    assert check.run([str(file)], as_json=False) == 0
    told = capsys.readouterr().out
    assert said in told
    assert ("trunks alone" in told) is said.startswith("with")
    assert ("no range radios" in told) is said.startswith("no range")


@pytest.mark.parametrize(
    ("trees", "said"), [(0, "[forest] has no trees"), (1, "[forest] has 1 tree:"), (5, "has 5 trees"), (6, "")]
)
def test_check_says_that_by_so_few_trunks_alone_nobody_sets_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], trees: int, said: str
) -> None:
    assert ALONE_TREES == constellation.LEAST
    file = tmp_path / "alone.toml"
    mission = ranging_mission(
        ranging={"start_enu_m": STARTS, "radio": False},
        sensing={"sensor": "scan-0.5deg", "range_m": 20.0},
        forest={"trees": [{"base_enu_m": (60, 5 * k), "trunk_radius_m": 0.3, "height_m": 20} for k in range(trees)]},
    )
    file.write_text(dump_mission(mission))
    assert check.run([str(file)], as_json=False) == 0
    told = capsys.readouterr().out
    assert said in told
    assert ("do not set out" in told) is bool(said)


def test_check_says_whose_autopilots_are_told_no_odometry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, said = tmp_path / "odometry.toml", "nothing comes of sensing.sends_odometry on 3 of 4 vehicles"
    for gnss, is_told in (("leader", True), ("all", False)):
        swarm = {"size": 4, "gnss": gnss, "leader_priority": (1,)}
        file.write_text(dump_mission(ranging_mission(swarm=swarm, sensing={"sends_odometry": True})))
        assert check.run([str(file)], as_json=False) == 0
        assert (said in capsys.readouterr().out) is is_told
