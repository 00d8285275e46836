"""[[sim.faults]]: what may stand there, and what a mission makes of it."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.model.states import SwarmPhase
from mission.common.problems import MissionError
from mission.document.load import dump_mission, parse_mission
from mission.document.model import Mission
from mission.schema.faults import FaultPhase

HEAD = """\
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 3.0
[swarm]
size = 4
[sim]
time_limit_s = 200.0
[[sim.faults]]
"""
GOOD = (
    'kind = "kill"\nat_s = 40',
    'kind = "kill"\nvehicles = [3, 4]\nphase = "coverage"\nat_s = 5.0',
    'kind = "stop"\nvehicles = [2]\nat_s = 30\nfor_s = 3',
    'kind = "partition"\nvehicles = [1, 2]\nat_s = 60\nfor_s = 100',
    'kind = "late"\nvehicles = [2]\nat_s = 40\nlate_s = 1.5',
    'kind = "late"\nat_s = 40\nlate_s = 1.5\nfor_s = 20',
    'kind = "wind"\nvehicles = [1, 2]\nat_s = 40\nwind_mps = [4.0, -3.0]\nfor_s = 20',
    'kind = "gnss-outage"\nvehicles = [2]\nat_s = 40',
    'kind = "gnss-drift"\nat_s = 40\ndrift_mps = [0.3, 0.0]\nfor_s = 60',
    'kind = "position-jump"\nat_s = 40\njump_m = [6.0, -2.0]',
    'kind = "position-freeze"\nat_s = 40\nfor_s = 5',
    'kind = "position-drift"\nat_s = 40\ndrift_mps = [0.3, 0.0]',
    'kind = "height-error"\nat_s = 40\nheight_m = -10.0',
    'kind = "motor"\nat_s = 40',
    'kind = "disk-full"\nat_s = 40',
)


def with_faults(*faults: dict[str, Any]) -> Mission:
    return parse_mission(HEAD.removesuffix("[[sim.faults]]\n")).with_faults(faults)


@pytest.mark.parametrize("table", GOOD)
def test_a_fault_loads_and_its_dump_loads_back_equal(table: str) -> None:
    loaded = parse_mission(HEAD + table)
    assert len(loaded.sim.faults) == 1
    assert parse_mission(dump_mission(loaded)) == loaded
    assert hash(loaded) == hash(parse_mission(HEAD + table))


@pytest.mark.parametrize(
    ("table", "line", "problem"),
    [
        ("at_s = 1", 10, "sim.faults[0].kind: missing; must be one of"),
        (
            'kind = "hang"\nat_s = 1',
            11,
            'sim.faults[0].kind = "hang": must be one of "kill", "restart", "stop", "partition", "base-lost", "late", '
            '"blind", "wind", "gnss-outage", "gnss-drift", "position-jump", "position-freeze", "position-drift", '
            '"height-error", "motor", "scan-errors", "range-errors", "pilot", "disk-full"',
        ),
        ('kind = "kill"', 10, "sim.faults[0].at_s: missing; must be a number from 0"),
        ('kind = "kill"\nat_s = -1', 12, "sim.faults[0].at_s = -1: must be a number from 0"),
        ('kind = "kill"\nat_s = 200.0', 12, "sim.faults[0].at_s = 200.0: must be less than sim.time_limit_s = 200.0"),
        ('kind = "kill"\nat_s = 1\nfor_s = 3', 10, "sim.faults[0] = a table: kill: has no for_s"),
        ('kind = "stop"\nat_s = 1', 10, "sim.faults[0] = a table: stop: needs for_s"),
        ('kind = "stop"\nat_s = 1\nfor_s = 0', 13, "sim.faults[0].for_s = 0: must be a number above 0"),
        ('kind = "stop"\nat_s = 1\nfor_s = 1\nlate_s = 1', 10, "sim.faults[0] = a table: stop: has no late_s"),
        ('kind = "wind"\nat_s = 1', 10, "sim.faults[0] = a table: wind: needs wind_mps"),
        ('kind = "kill"\nat_s = 1\nwind_mps = [1, 1]', 10, "sim.faults[0] = a table: kill: has no wind_mps"),
        (
            'kind = "wind"\nat_s = 1\nwind_mps = [31, 0]',
            13,
            "sim.faults[0].wind_mps[0] = 31: must be a number from -30",
        ),
        ('kind = "motor"\nat_s = 1\nfor_s = 3', 10, "sim.faults[0] = a table: motor: has no for_s"),
        ('kind = "gnss-drift"\nat_s = 1', 10, "sim.faults[0] = a table: gnss-drift: needs drift_mps"),
        (
            'kind = "gnss-drift"\nat_s = 1\ndrift_mps = [0, 6]',
            13,
            "sim.faults[0].drift_mps[1] = 6: must be a number from -5 to 5",
        ),
        (
            'kind = "base-lost"\nat_s = 1',
            11,
            'sim.faults[0].kind = "base-lost": needs [survey] or [payload]: without records there is no base station',
        ),
        (
            'kind = "range-errors"\nat_s = 1\nbias_m = 1\nnoise_m = 0',
            11,
            'sim.faults[0].kind = "range-errors": needs [ranging]: without it no vehicle has a range radio',
        ),
        (
            'kind = "insider"\nat_s = 1\nlie = "ranges"',
            13,
            'sim.faults[0].lie = "ranges": needs [ranging], and vehicles without satellites (swarm.gnss = "all",'
            " swarm.size = 4)",
        ),
        (
            'kind = "insider"\nat_s = 1\nlie = "trunks"',
            13,
            'sim.faults[0].lie = "trunks": needs [ranging], vehicles without satellites (swarm.gnss = "all",'
            " swarm.size = 4),"
            " and a sensing.sensor that tells every ray",
        ),
        ('kind = "position-jump"\nat_s = 1', 10, "sim.faults[0] = a table: position-jump: needs jump_m"),
        (
            'kind = "height-error"\nat_s = 1\nheight_m = 51',
            13,
            "sim.faults[0].height_m = 51: must be a number from -50 to 50",
        ),
        ('kind = "late"\nat_s = 1', 10, "sim.faults[0] = a table: late: needs late_s"),
        ('kind = "late"\nat_s = 1\nlate_s = 11', 13, "sim.faults[0].late_s = 11: must be a number above 0, at most 10"),
        ('kind = "kill"\nat_s = 1\nphase = "hover"', 13, 'sim.faults[0].phase = "hover": must be one of "assemble"'),
        ('kind = "kill"\nat_s = 1\nvehicles = []', 13, "sim.faults[0].vehicles = []: must be an array of 1 to 250"),
        ('kind = "kill"\nat_s = 1\nvehicles = [1, 1]', 13, "sim.faults[0].vehicles = [1, 1]: each id at most once"),
        ('kind = "kill"\nat_s = 1\nvehicles = [2, 5]', 13, "sim.faults[0].vehicles = [2, 5]: has no vehicle 5: ids"),
        (
            'kind = "partition"\nat_s = 1\nfor_s = 1\nvehicles = [1, 2, 3, 4]',
            14,
            "sim.faults[0].vehicles = [1, 2, 3, 4]: must leave a vehicle to cut off from (swarm.size = 4)",
        ),
        ('kind = "kill"\nat_s = 1\nwho = 3', 13, "sim.faults[0].who = 3: unknown key"),
    ],
)
def test_what_cannot_happen_is_refused_with_its_line(table: str, line: int, problem: str) -> None:
    with pytest.raises(MissionError) as caught:
        parse_mission(HEAD + table, "m.toml")
    (refused,) = caught.value.problems
    assert str(refused).startswith(f"m.toml:{line}: {problem}")


def test_there_is_a_limit_to_what_can_go_wrong() -> None:
    assert len(with_faults(*[{"kind": "kill", "at_s": 1.0}] * 64).sim.faults) == 64
    with pytest.raises(MissionError, match=r"sim\.faults = .*: must be an array of 0 to 64"):
        with_faults(*[{"kind": "kill", "at_s": 1.0}] * 65)


def test_faults_come_besides_those_of_the_file_and_their_place_is_named() -> None:
    loaded = parse_mission(HEAD + GOOD[0])
    both = loaded.with_faults([{"kind": "kill", "vehicles": [3], "at_s": 50.0}], place="--kill 3@50")
    assert [fault.vehicles for fault in both.sim.faults] == [None, (3,)]
    with pytest.raises(MissionError, match=r"^--kill 5@50: sim\.faults\[1\]\.vehicles = \[5\]: has no vehicle 5"):
        loaded.with_faults([{"kind": "kill", "vehicles": [5], "at_s": 50.0}], place="--kill 5@50")


def test_a_smaller_swarm_forgets_the_faults_of_vehicles_that_it_has_not() -> None:
    full = with_faults(
        {"kind": "kill", "at_s": 1.0},
        {"kind": "kill", "vehicles": [4], "at_s": 2.0},
        {"kind": "kill", "vehicles": [1, 4], "at_s": 3.0},
        {"kind": "partition", "vehicles": [1, 2], "at_s": 4.0, "for_s": 1.0},
        {"kind": "partition", "vehicles": [2, 3], "at_s": 5.0, "for_s": 1.0},
    )
    left = [(fault.at_s, fault.vehicles) for fault in full.with_size(2).sim.faults]
    assert left == [(1.0, None), (3.0, (1,)), (5.0, (2,))]
    assert full.with_seed(2).with_personality("ardupilot").with_size(4).sim.faults == full.sim.faults


def test_phases_have_the_names_of_the_swarms() -> None:
    assert [phase.value for phase in FaultPhase] == [phase.name.lower() for phase in SwarmPhase]


def test_only_a_mission_with_sensing_has_sensors_that_can_fail() -> None:
    blind = {"kind": "blind", "vehicles": [2], "at_s": 3.0}
    with pytest.raises(MissionError, match=r'sim\.faults\[0\]\.kind = "blind": needs \[sensing\]'):
        with_faults(blind)
    seeing = parse_mission(HEAD.removesuffix("[[sim.faults]]\n") + "[sensing]\n")
    assert seeing.with_faults([blind]).sim.faults[0].for_s is None
