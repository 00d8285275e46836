"""What the simulated vehicles can do: told by `mission check`, refused by `sim-bridge`."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import pytest

from mission.cli.main import main
from mission.common.frames import LocalFrame, Wgs84
from mission.common.problems import MissionError
from mission.document import simulator
from mission.document.load import parse_mission
from mission.document.model import Drag, Mission, Personality
from sim_bridge import cli
from sim_bridge.lab.study.load import load_study
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.autopilot.ardupilot import tables as ardupilot_tables
from sim_bridge.world.autopilot.px4 import tables as px4_tables

ROUTE = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3}
FAST = """\
schema = 1
[route]
d1_enu_m = [0.0, 0.0, 8.0]
d2_enu_m = [130.0, 0.0, 8.0]
vel_leader_mps = 13.0
[limits]
speed_max_mps = 13.0
"""
ORIGIN = "[origin]\nlat_deg = 47.0\nlon_deg = 8.0\nalt_m = 400.0\n"


def told(**changes: dict[str, Any]) -> list[str]:
    values = {"schema": 1, "route": {**ROUTE, **changes.pop("route", {})}, **changes}
    return [str(problem) for problem in simulator.problems(Mission.model_validate(values), "m.toml")]


# What the figures rest on


def test_the_autopilots_fly_at_most_what_their_parameters_allow() -> None:
    px4, copter = px4_tables.PARAMETERS, ardupilot_tables.PARAMETERS
    assert {
        Personality.PX4: simulator.Abilities(px4["MPC_XY_VEL_MAX"], px4["MPC_Z_VEL_MAX_UP"], px4["MPC_Z_VEL_MAX_DN"]),
        Personality.ARDUPILOT: simulator.Abilities(
            copter["WPNAV_SPEED"] / 100.0, copter["WPNAV_SPEED_UP"] / 100.0, copter["WPNAV_SPEED_DN"] / 100.0
        ),
    } == simulator.AUTOPILOTS


def course(speed_mps: float, seconds: float, drag: Drag = Drag.LOW) -> list[float]:
    """Speeds north at 20 Hz of the quadrotor that is told to fly `speed_mps` from a hover."""
    quad = JsbsimQuad(LocalFrame(Wgs84(45.0, 9.0, 0.0)), (0.0, 0.0, -50.0), 0.0, drag=drag)
    quad.set_armed(True)
    for _ in range(60):
        quad.step(0.05)
    quad.command((speed_mps, 0.0, 0.0), 0.0)
    found = []
    for _ in range(round(seconds * 20)):
        quad.step(0.05)
        found.append(quad.state.vel_ned_mps[0])
    return found


@pytest.mark.parametrize("drag", list(Drag))
def test_the_quadrotor_keeps_the_airspeed_that_missions_may_ask_for(drag: Drag) -> None:
    most_mps, seconds = simulator.AIRSPEED_MPS[drag], 15.0 if drag is Drag.LOW else 40.0  # in SIH's air it is slow
    assert course(most_mps, seconds, drag)[-1] == pytest.approx(most_mps, abs=0.05)
    assert course(1.3 * most_mps, seconds, drag)[-1] < 1.2 * most_mps


def test_the_quadrotor_accelerates_as_missions_may_ask_for() -> None:
    speeds = course(10.0, 3.0)
    most = max((after - before) / 0.05 for before, after in itertools.pairwise(speeds))

    assert most == pytest.approx(simulator.ACCELERATION_MPS2, rel=0.05)


# What is told


@pytest.mark.parametrize(
    ("good", "bad", "says"),
    [
        ({"limits": {"speed_max_mps": 12.0}}, {"limits": {"speed_max_mps": 12.1}}, "must be at most 12 m/s"),
        ({"limits": {"climb_max_mps": 3.0}}, {"limits": {"climb_max_mps": 3.1}}, "must be at most 3 m/s"),
        (
            {"limits": {"acceleration_max_mps2": 3.0}},
            {"limits": {"acceleration_max_mps2": 3.1}},
            "must be at most 3 m/s2",
        ),
        ({"sim": {"wind_mps": [-12, 0, 0]}}, {"sim": {"wind_mps": [-12.1, 0, 0]}}, "asks for 15.1 m/s through the air"),
        ({"sim": {"wind_mps": [12.1, 0, 0]}}, {"sim": {"wind_mps": [15.1, 0, 0]}}, "asks for 15.1 m/s"),
        (
            {"sim": {"wind_mps": [12.1, 0, 0]}},
            {"sim": {"wind_mps": [12.1, 0, 0]}, "route": {"at_end": "return"}},
            "asks for 15.1 m/s",
        ),
        (
            {"sim": {"wind_mps": [-1.5, 0, 0], "drag": "sih"}},
            {"sim": {"wind_mps": [-1.6, 0, 0], "drag": "sih"}},
            "asks for 4.6 m/s through the air: the simulated quadrotor keeps its course up to 4.5 m/s",
        ),
    ],
    ids=str,
)
def test_what_is_beyond_the_simulated_vehicles_is_told(good: Any, bad: Any, says: str) -> None:
    assert told(**good) == []
    (problem,) = told(**bad)
    assert says in problem


def test_the_slowest_autopilot_of_a_mixed_swarm_decides() -> None:
    limits = {"speed_max_mps": 11.0}

    assert told(limits=limits) == []
    (problem,) = told(limits=limits, sim={"personalities": {"3": "ardupilot"}})
    assert 'limits.speed_max_mps = 11.0: must be at most 10 m/s: more the simulated "ardupilot"' in problem


def test_a_descent_is_slower_than_a_climb() -> None:
    up: dict[str, Any] = {"d2_enu_m": [40, 0, 29], "d1_enu_m": [0, 0, 8], "vel_leader_mps": 4}
    limits = {"climb_max_mps": 3.0}

    assert told(route=up, limits=limits) == []
    for descends in ({**up, "at_end": "return"}, {**up, "d1_enu_m": [0, 0, 29], "d2_enu_m": [40, 0, 8]}):
        (problem,) = told(route=descends, limits=limits)
        assert "makes the leader descend at 1.86 m/s" in problem


# Who says it


def test_check_refuses_a_mission_for_the_simulator_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "fast.toml"
    file.write_text(FAST)

    assert main(["check", str(file)]) == 2
    assert f"{file}:7: limits.speed_max_mps = 13.0: must be at most 12 m/s" in capsys.readouterr().err


def test_check_accepts_a_mission_for_other_aircraft_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fast.toml"
    file.write_text(FAST + ORIGIN)

    assert main(["check", str(file)]) == 0
    first, _, second = capsys.readouterr().out.splitlines()
    assert ": ok: unnamed, 8 vehicles" in first
    assert second.startswith(f"  not for the simulator: {file}:7: limits.speed_max_mps = 13.0: must be at most 12 m/s")
    assert main(["check", "--json", str(file)]) == 0
    assert '"key": "limits.speed_max_mps"' in capsys.readouterr().out


@pytest.mark.parametrize("command", ["fly", "serve"])
def test_the_simulator_refuses_before_anything_is_written(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fast.toml").write_text(FAST + ORIGIN)
    monkeypatch.chdir(tmp_path)

    assert cli.main([command, "fast.toml"]) == 2
    assert capsys.readouterr().err.startswith("fast.toml: limits.speed_max_mps = 13.0: must be at most 12 m/s")
    assert [path.name for path in tmp_path.iterdir()] == ["fast.toml"]


def test_a_study_refuses_what_its_backend_cannot_fly(tmp_path: Path) -> None:
    (tmp_path / "fast.toml").write_text(FAST)
    study = 'schema = 1\nmissions = ["fast.toml"]\nseeds = 1\n[[run]]\nname = "one"\nbackend = "{}"\n'
    (tmp_path / "study.toml").write_text(study.format("jsbsim"))
    with pytest.raises(MissionError, match=r"fast.toml: limits.speed_max_mps = 13.0: must be at most 12 m/s"):
        load_study(tmp_path / "study.toml")

    (tmp_path / "study.toml").write_text(study.format("point-mass"))
    assert load_study(tmp_path / "study.toml").cases


def test_standing_still_in_too_much_wind_is_refused_whatever_the_speed() -> None:
    slow = parse_mission(FAST.replace("13.0", "1.0") + "[sim]\nwind_mps = [0.0, 16.0, 0.0]\n")

    (problem,) = simulator.problems(slow, "m.toml")
    assert math.isclose(float(problem.message.split()[2]), math.hypot(16.0, 1.0), abs_tol=0.05)
