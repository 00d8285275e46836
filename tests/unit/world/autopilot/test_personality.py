"""Each vehicle has the autopilot that the mission names, with what a canopy asks for."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pytest

from mission.common.problems import MissionError
from mission.document.load import dump_mission, parse_mission
from mission.document.model import Estimates, Mission, Origin, Personality
from sim_bridge.drive import fly_program
from sim_bridge.drive.serve import notice, server
from sim_bridge.drive.serve import program as serve
from sim_bridge.options import fly as fly_options
from sim_bridge.options import serve as serve_options
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import ArduCopterAutopilot, Link, Px4Autopilot, StreamProfile
from sim_bridge.world.world import DEFAULT_ORIGIN, World
from tests.unit.core.core_kit import mission

LINKS = {Link.ONBOARD: StreamProfile.MINIMAL}


def mixed(**sim: Any) -> Mission:
    return mission(swarm={"size": 3}, sim=sim)


def world(flown: Mission) -> World:
    anchored = flown.with_origin(Origin(lat_deg=47.4, lon_deg=8.5, alt_m=488.0))
    return World(anchored, lambda _frame, place, _seed: PointMass(place, 0.0), links=LINKS)


def test_a_vehicle_may_differ_from_the_rest() -> None:
    vehicles = world(mixed(personalities={2: "ardupilot"})).vehicles
    assert [type(v.autopilot) for v in vehicles.values()] == [Px4Autopilot, ArduCopterAutopilot, Px4Autopilot]
    vehicles = world(mixed(personality="ardupilot", personalities={3: "px4"})).vehicles
    assert [type(v.autopilot) for v in vehicles.values()] == [ArduCopterAutopilot, ArduCopterAutopilot, Px4Autopilot]


def test_each_has_the_parameters_of_a_canopy_by_its_own_names() -> None:
    vehicles = world(mixed(personalities={2: "ardupilot"})).vehicles
    assert vehicles[1].autopilot.parameters["COM_OF_LOSS_T"] == 0.5
    assert vehicles[2].autopilot.parameters["GUID_TIMEOUT"] == 0.5


@pytest.mark.parametrize(
    ("line", "refusal"),
    [
        (
            'personalities = { 4 = "ardupilot" }',
            r'm\.toml:\d+: sim\.personalities\.4 = "ardupilot": must be a vehicle id, 1 to 3',
        ),
        (
            "battery_mah = { 4 = 700.0 }",
            r"m\.toml:\d+: sim\.battery_mah\.4 = 700\.0: must be a vehicle id, 1 to 3",
        ),
        ("battery_mah = { 2 = 0.0 }", r"sim\.battery_mah\.2 = 0\.0: must be"),
        (
            'personalities = { 0 = "px4" }',
            r'm\.toml:\d+: sim\.personalities\.0 = "px4": must be a vehicle id, 1 to 250',
        ),
        (
            'personalities = { two = "px4" }',
            r'm\.toml:\d+: sim\.personalities\.two = "px4": must be a vehicle id, 1 to',
        ),
        ('personalities = { two = "x" }', r'sim\.personalities\.two = "x": must be'),
        (
            'personalities = { 2 = "betaflight" }',
            r'sim\.personalities\.2 = "betaflight": must be one of "px4", "ardupilot"',
        ),
        ('personalities = "px4"', r"sim\.personalities"),
    ],
)
def test_what_is_no_vehicle_or_no_personality_is_refused_at_its_place(line: str, refusal: str) -> None:
    text = dump_mission(mixed()).replace('personality = "px4"', f'personality = "px4"\n{line}')
    with pytest.raises(MissionError, match=refusal):
        parse_mission(text, "m.toml")


def test_an_unknown_personality_is_refused_with_the_known_ones() -> None:
    text = dump_mission(mixed()).replace('personality = "px4"', 'personality = "betaflight"')
    with pytest.raises(MissionError, match='must be one of "px4", "ardupilot"'):
        parse_mission(text, "m.toml")


def test_it_comes_back_from_a_file() -> None:
    flown = mixed(personality="ardupilot", personalities={3: "px4"})
    again = parse_mission(dump_mission(flown), "m.toml")
    assert again == flown
    assert [again.sim.personality_of(k) for k in (1, 2, 3)] == ["ardupilot", "ardupilot", "px4"]


def test_a_word_on_the_command_line_is_for_all() -> None:
    flown = mixed(personalities={3: "ardupilot"}).with_personality("ardupilot")
    assert {flown.sim.personality_of(k) for k in (1, 2, 3)} == {Personality.ARDUPILOT}


def test_a_smaller_swarm_forgets_the_personalities_of_vehicles_that_it_has_not() -> None:
    flown = mixed(personalities={2: "ardupilot", 3: "ardupilot"}).with_size(2)
    assert flown.sim.personalities == {2: Personality.ARDUPILOT}


def test_a_vehicle_has_the_battery_that_the_mission_fits() -> None:
    flown = mixed(personalities={2: "ardupilot", 3: "ardupilot"}, battery_mah={1: 700, 2: 1400})
    parked = world(flown)
    for _ in range(100):
        parked.step(0.05)
    used = {k: 1.0 - vehicle.autopilot.snapshot.battery_remaining for k, vehicle in parked.vehicles.items()}
    assert used[1] / used[2] == pytest.approx(2.0)
    assert used[1] / used[3] == pytest.approx(3300 / 700)
    assert dict(flown.with_size(1).sim.battery_mah) == {1: 700.0}


def test_a_word_on_the_command_line_is_comes_before_the_size(tmp_path: Path) -> None:
    file = tmp_path / "mixed.toml"
    file.write_text(dump_mission(mixed(personalities={2: "ardupilot", 3: "px4"})))
    parser = argparse.ArgumentParser()
    serve_options.configure(parser)
    flown = serve._mission(parser.parse_args([str(file), "--personality", "ardupilot", "-n", "2"]))
    assert (flown.sim.personality, flown.sim.personalities, flown.swarm.size) == (Personality.ARDUPILOT, {}, 2)


def test_estimates_on_the_command_line_go_before_the_missions(tmp_path: Path) -> None:
    file = tmp_path / "exact.toml"
    file.write_text(dump_mission(mixed()))
    for configure, read in ((serve_options.configure, serve._mission), (fly_options.configure, fly_mission)):
        parser = argparse.ArgumentParser()
        configure(parser)
        for chosen in (None, *Estimates):
            words = [str(file)] if chosen is None else [str(file), "--estimates", chosen.value]
            assert read(parser.parse_args(words)).sim.estimates is (chosen or Estimates.EXACT)


def fly_mission(args: argparse.Namespace) -> Mission:
    return fly_program._mission(args, None)[0]


def test_an_unknown_personality_on_the_command_line_is_refused_in_words(capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    serve_options.configure(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["mission.toml", "--personality", "betaflight"])
    assert "choose from 'px4', 'ardupilot'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("personalities", "px4", "ardupilot"),
    [({}, True, False), ({2: "ardupilot"}, True, True), (dict.fromkeys((1, 2, 3), "ardupilot"), False, True)],
)
def test_those_who_connect_are_told_what_a_takeoff_altitude_means(
    personalities: dict[int, str], px4: bool, ardupilot: bool
) -> None:
    ports = server.open_ports(server.PortPlan(), (1, 2, 3))
    try:
        anchored = mixed(personalities=personalities).with_origin(DEFAULT_ORIGIN)
        table = notice.table(notice.where(anchored, Path("m.toml"), ports, 1.0), None)
    finally:
        ports.close()
    assert ("PX4: takeoff altitudes are above sea level" in table) == px4
    assert ("ArduPilot: takeoff altitudes are above home" in table) == ardupilot
