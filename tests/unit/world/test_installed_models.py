"""Simulated sensors of installed packages: driven as ours, and what is said of one that cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from mission.stand.stand import Stand
from sim_bridge.errors import StartError
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.installed import GROUP
from sim_bridge.world.sensors.table import link_name, simulated_sensors
from tests.installed_kit import Site, mission_with

GOOD = """\
class Model:
    is_optical = True

    def __init__(self, mission, stand, ids):
        self.ids = ids

    def frames(self, vehicle_id, state, positions_ned_m, now_s):
        return bytes([vehicle_id])
"""
STILL = AirframeState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), on_ground=True, throttle=0.0)


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    monkeypatch.syspath_prepend(str(tmp_path))
    return Site(tmp_path)


def test_a_model_is_driven_as_a_sensor_of_ours(site: Site) -> None:
    site.install("sonars", GROUP, "sonar = sonars_1:Model", sonars_1=GOOD)
    (sensor,) = simulated_sensors(mission_with("sonar"), Stand(), (1, 2))
    assert (sensor.name, sensor.is_optical, sensor.by_autopilot) == ("sonar", True, False)
    assert sensor.frames(2, STILL, {}, 0.0) == b"\2"
    assert link_name(mission_with("sonar")) == "sonar"
    assert [one.name for one in simulated_sensors(mission_with("sonar", sensing={}), Stand(), (1, 2))] == [
        "obstacles",
        "sonar",
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mission, stand, ids", "mission", "TypeError: "),
        ("def frames", "def frame", "which has no frames(vehicle_id, state, positions_ned_m, now_s)"),
        ("positions_ned_m, now_s)", "now_s)", "must take frames(vehicle_id, state, positions_ned_m, now_s)"),
    ],
)
def test_a_model_that_cannot_be_driven_is_named_with_its_package(
    site: Site, old: str, new: str, message: str, request: pytest.FixtureRequest
) -> None:
    module = f"sonars_{abs(hash(request.node.name))}"
    site.install("wrong", GROUP, f"sonar = {module}:Model", **{module: GOOD.replace(old, new)})
    named = f"sensor sonar (entry point understory.simulated_sensors: {module}:Model, of wrong 1.2): "
    with pytest.raises(StartError, match="^" + re.escape(named)) as caught:
        simulated_sensors(mission_with("sonar"), Stand(), (1,))
    assert message in str(caught.value)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize(
    ("answer", "message"), [("'text'", "returned 'text': must be bytes"), ("1 / 0", "ZeroDivisionError")]
)
def test_what_goes_wrong_in_flight_names_the_entry_point_too(
    site: Site, answer: str, message: str, request: pytest.FixtureRequest
) -> None:
    module = f"sonars_{abs(hash(request.node.name))}"
    text = GOOD.replace("bytes([vehicle_id])", answer)
    site.install("late", GROUP, f"sonar = {module}:Model", **{module: text})
    (sensor,) = simulated_sensors(mission_with("sonar"), Stand(), (1,))
    with pytest.raises(StartError, match=rf"^sensor sonar \(entry point .* of late 1\.2\): frames.*{message}"):
        sensor.frames(1, STILL, {}, 0.0)


def test_a_sensor_that_nobody_simulates_is_refused() -> None:
    with pytest.raises(StartError, match=r"^sensor sonar: no installed package simulates it"):
        simulated_sensors(mission_with("sonar"), Stand(), (1,))
