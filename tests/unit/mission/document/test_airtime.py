"""Time that a mission takes in the air, and the simulated batteries for it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from companion.core.vehicle.failsafe import CRITICAL_BATTERY_PERCENT, LOW_BATTERY_PERCENT
from mission.cli.main import main
from mission.document import airtime
from mission.document.model import Mission, Personality
from sim_bridge.world.airframe.point_mass import HOVER_THROTTLE
from sim_bridge.world.autopilot.ardupilot.autopilot import BATTERY
from sim_bridge.world.autopilot.battery import Battery, BatterySpec


def flown(duration_s: float = 45.0, at_end: str = "hold", **sim: Any) -> Mission:
    route = {"d1_enu_m": (0.0, 0.0, 7.0), "d2_enu_m": (120.0, 0.0, 7.0), "vel_leader_mps": 3.0, "at_end": at_end}
    tables = {"schema": 1, "route": route, "coverage": {"duration_s": duration_s}, "sim": sim}
    return Mission.model_validate(tables | {"limits": {"climb_max_mps": 1.4}, "swarm": {"size": 3}})


def test_the_figures_are_those_of_the_bridge_and_of_the_companion() -> None:
    for spec, personality in ((BatterySpec(), Personality.PX4), (BATTERY, Personality.ARDUPILOT)):
        battery = Battery(spec)
        battery.drain(60.0, HOVER_THROTTLE)
        assert battery.current_a == pytest.approx(airtime.HOVER_A, rel=0.01)
        assert spec.capacity_mah == airtime.CAPACITY_MAH[personality]
    assert airtime.LANDS_BELOW * 100.0 == CRITICAL_BATTERY_PERCENT
    assert airtime.LEADS_ABOVE * 100.0 == LOW_BATTERY_PERCENT


def test_the_time_is_that_of_climb_gathering_way_coverage_and_what_comes_after() -> None:
    held_s = 5.0 + airtime.GATHER_S + 40.0 + 45.0
    assert airtime.airtime_s(flown()) == pytest.approx(held_s)
    assert airtime.airtime_s(flown(at_end="land")) == pytest.approx(held_s + 10.0)
    assert airtime.airtime_s(flown(at_end="return")) == pytest.approx(held_s + 40.0 + 10.0)


def test_an_hour_of_coverage_is_more_than_the_simulated_battery_has() -> None:
    (told,) = airtime.find_short_batteries(flown(3600.0))
    assert told.startswith(
        "the simulated battery does not last: landing after 24.5 min, at 10 %, vehicle 1, 2, 3 (5000 "
    )
    assert airtime.battery_share(flown(3600.0)) > 2.0
    battery = Battery(BatterySpec())
    battery.drain(24.5 * 60.0, HOVER_THROTTLE)
    assert battery.remaining == pytest.approx(airtime.LANDS_BELOW, abs=0.005)


def test_each_capacity_is_judged_by_itself() -> None:
    mission = flown(960.0, personalities={"2": "ardupilot"}, battery_mah={"3": 20_000.0})
    (told,) = airtime.find_short_batteries(mission)
    assert told.endswith(
        "landing after 16.2 min, at 10 %, vehicle 2 (3300 mAh): less coverage.duration_s, or more sim.battery_mah"
    )
    assert list(airtime.find_short_batteries(flown(60.0))) == []


def test_a_battery_that_lasts_but_is_low_at_the_end_is_told() -> None:
    (told,) = airtime.find_short_batteries(flown(1330.0))
    assert told == "the simulated battery is low at the end: not leading below 20 %, vehicle 1, 2, 3 (5000 mAh)"


def test_check_says_the_time_the_charge_and_that_it_does_not_last(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "m.toml"
    route = "[route]\nd1_enu_m = [0.0, 0.0, 8.0]\nd2_enu_m = [130.0, 0.0, 8.0]\nvel_leader_mps = 3.0\n"
    file.write_text(f"schema = 1\n{route}[coverage]\nduration_s = 3600.0\n")
    assert main(["check", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "  at least 61.1 min in the air: 11195 mAh, 224 % of the smallest simulated battery"
    assert lines[2].startswith("  the simulated battery does not last: landing after 24.5 min")
    assert main(["check", "--json", str(file)]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["airtime_s"], found["battery_mah"], found["battery_share"]) == (3663.7, 11195, 2.239)
