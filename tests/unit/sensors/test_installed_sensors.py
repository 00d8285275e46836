"""Sensors of installed packages: what a mission that names one gets, and what is said of one that is no sensor."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion import cli, doctor
from companion.journal.channels import VERSION
from companion.journal.rebuild import RebuildError, rebuild_endpoint
from companion.preflight.report import Verdict
from companion.run_command import RefusedError, mission_of
from companion.sensors.installed import GROUP, load_sensor
from companion.sensors.table import kinds_of, sensors_of
from mission.common.entry_points import EntryPointError
from mission.common.problems import MissionError
from tests.installed_kit import Site, mission_with
from tests.unit.core.core_kit import mission

GOOD = """\
from companion.mavlink.sensor_source import SensorSource


class Altimeter(SensorSource):
    NAME = "altimeter"
    TITLE = "altimeter"
    MESSAGES = {141: "ALTITUDE"}
    HELP = "ALTITUDE of a test"
    ABOUT = "It is heard."
    UNUSED = "has no use for it"
    STALE = "no height that is fresh"

    @classmethod
    def is_flown(cls, mission):
        return mission.name != "without"

    @classmethod
    def of(cls, mission):
        return cls(1.0)

    def decode(self, m, component, now_s):
        return None

    @classmethod
    def tally(cls, began_s):
        return None
"""


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    monkeypatch.syspath_prepend(str(tmp_path))
    load_sensor.cache_clear()
    yield Site(tmp_path)
    load_sensor.cache_clear()


def test_a_mission_flies_by_the_sensor_that_it_names_and_no_other_does(site: Site) -> None:
    site.install("heights", GROUP, "altimeter = heights_1:Altimeter", heights_1=GOOD)
    named = mission_with("altimeter")
    assert list(kinds_of(named)) == ["altimeter"]
    (sensor,) = sensors_of(named)
    assert sensor.NAME == "altimeter"
    assert kinds_of(mission()) == {}
    assert list(kinds_of(mission_with("altimeter", sensing={}))) == ["obstacles", "altimeter"]


@pytest.mark.parametrize(
    ("entry", "old", "new", "message"),
    [
        ("nowhere_2:Altimeter", "", "", "cannot be imported: ModuleNotFoundError: No module named 'nowhere_2'"),
        ("not a module", "", "", "must be MODULE or MODULE:OBJECT"),
        ("wrong_{}:Missing", "", "", "cannot be imported: AttributeError: module 'wrong_"),
        ("wrong_{}", "", "", "must be a class that inherits from companion.mavlink.sensor_source.SensorSource"),
        ("wrong_{}:Altimeter", "(SensorSource)", "", "must be a class that inherits from"),
        ("wrong_{}:Altimeter", 'HELP = "ALTITUDE of a test"', "HELP = 3", "Altimeter.HELP: must be a str"),
        ("wrong_{}:Altimeter", 'TITLE = "altimeter"', "pass", "Altimeter.TITLE: must be a str"),
        (
            "wrong_{}:Altimeter",
            'NAME = "altimeter"',
            'NAME = "height"',
            "Altimeter.NAME = 'height': must be the entry point's name, 'altimeter'",
        ),
        ("wrong_{}:Altimeter", '{141: "ALTITUDE"}', "{}", "Altimeter.MESSAGES: must be a dict of"),
        ("wrong_{}:Altimeter", "141", "9999", "Altimeter.MESSAGES: 9999: no message of companion/mavlink/swarm.xml"),
        ("wrong_{}:Altimeter", "def decode", "def decoded", "Altimeter must define decode: see docs/how-to/"),
        (
            "wrong_{}:Altimeter",
            "decode(self, m, component, now_s)",
            "decode(self, m)",
            "Altimeter.decode(self, m): must take decode(m, component, now_s)",
        ),
        ("wrong_{}:Altimeter", "of(cls, mission)", "of(cls)", "Altimeter.of(): must take of(mission)"),
    ],
)
def test_an_entry_point_that_is_no_sensor_is_named_with_its_package(
    site: Site, entry: str, old: str, new: str, message: str, request: pytest.FixtureRequest
) -> None:
    module = f"wrong_{abs(hash(request.node.name))}"  # one of its own: modules stay imported
    value = entry.format(module.removeprefix("wrong_"))
    assert not old or old in GOOD
    site.install("wrong", GROUP, f"altimeter = {value}", **{module: GOOD.replace(old, new) if old else GOOD})
    with pytest.raises(EntryPointError) as caught:
        load_sensor("altimeter")
    said = str(caught.value)
    assert said.startswith(f"altimeter (entry point understory.sensors: {value}, of wrong 1.2): ")
    assert message in said
    with pytest.raises(MissionError, match=r'sensors = \["altimeter"\]: altimeter \(entry point'):
        kinds_of(mission_with("altimeter"))


def test_what_a_mission_names_and_nobody_has_is_refused(site: Site) -> None:
    site.install("heights", GROUP, "altimeter = heights_3:Altimeter", heights_3=GOOD)
    with pytest.raises(MissionError, match=r"sonar: no installed package has an entry point .* \(altimeter\)"):
        kinds_of(mission_with("sonar"))
    with pytest.raises(MissionError, match="is flown by without being named"):
        kinds_of(mission_with("obstacles"))
    with pytest.raises(MissionError, match="altimeter: the mission has no use for it"):
        kinds_of(mission_with("altimeter", name="without"))


def test_a_name_that_two_packages_have_is_nobodys(site: Site) -> None:
    site.install("one", GROUP, "altimeter = heights_4:Altimeter", heights_4=GOOD)
    site.install("two", GROUP, "altimeter = heights_5:Altimeter", heights_5=GOOD)
    with pytest.raises(EntryPointError, match=r"of more than one package: one 1\.2, two 1\.2"):
        load_sensor("altimeter")


def test_messages_that_another_sensor_of_the_mission_reads_are_refused(site: Site) -> None:
    text = GOOD.replace('{141: "ALTITUDE"}', '{330: "OBSTACLE_DISTANCE"}')
    site.install("greedy", GROUP, "altimeter = heights_6:Altimeter", heights_6=text)
    assert list(kinds_of(mission_with("altimeter"))) == ["altimeter"]
    with pytest.raises(MissionError, match="OBSTACLE_DISTANCE: is read by obstacles in this mission"):
        kinds_of(mission_with("altimeter", sensing={}))


def parsed(*words: str) -> argparse.Namespace:
    return cli.build_parser().parse_args(words)


def test_the_command_line_takes_lists_and_refuses_it(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    site.install("heights", GROUP, "altimeter = heights_7:Altimeter", heights_7=GOOD)
    url = "udpin://127.0.0.1:14599"
    with pytest.raises(SystemExit):
        parsed("doctor", "--sensor", "help")
    assert "altimeter: ALTITUDE of a test" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        parsed("doctor", "--sensor", f"sonar={url}")
    assert "NAME one of obstacles, lidar, ranges, payload, altimeter" in capsys.readouterr().err
    file = tmp_path / "mission.toml"
    links = ("--autopilot", "udpout://127.0.0.1:9", "--peers", "udpout://127.0.0.1:9")
    arguments = parsed("run", "--mission", str(file), "--id", "1", *links, "--sensor", f"altimeter={url}")
    text = "schema = 1\norigin = { lat_deg = 47.0, lon_deg = 8.0, alt_m = 400.0 }\n"
    text += "route = { d1_enu_m = [0, 0, 5], d2_enu_m = [50, 0, 5], vel_leader_mps = 2.0 }\n"
    file.write_text(text)
    with pytest.raises(RefusedError, match=re.escape('does not name it: sensors = ["altimeter"]')):
        mission_of(arguments)
    file.write_text(f'sensors = ["altimeter"]\n{text}')
    assert mission_of(arguments).sensors == ("altimeter",)


def test_a_broken_one_is_told_where_it_is_asked_for(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.install("broken", GROUP, "altimeter = heights_8:Altimeter", heights_8="1 / 0\n")
    with pytest.raises(SystemExit):
        parsed("doctor", "--sensor", "help")
    named = "altimeter (entry point understory.sensors: heights_8:Altimeter, of broken 1.2): cannot be imported: Zero"
    assert named in capsys.readouterr().out
    with pytest.raises(SystemExit):
        parsed("doctor", "--sensor", "altimeter=udpin://127.0.0.1:14599")
    assert named in capsys.readouterr().err
    (row,) = doctor.packages()
    assert (row.verdict, row.found.startswith(named)) == (Verdict.FAIL, True)


def test_doctor_names_what_packages_bring(site: Site) -> None:
    assert list(doctor.packages()) == []
    site.install("heights", GROUP, "altimeter = heights_9:Altimeter", heights_9=GOOD)
    (row,) = doctor.packages()
    assert (row.verdict, row.found) == (Verdict.PASS, "sensors altimeter")


def test_a_black_box_whose_sensor_is_not_installed_says_so() -> None:
    start = {
        "format": VERSION,
        "flown_by": "",
        "vehicle": 1,
        "mission": mission_with("sonar").model_dump(mode="json", by_alias=True),
        "has_survey": False,
        "sensors": ["sonar"],
    }
    load_sensor.cache_clear()
    with pytest.raises(RebuildError, match="sonar: no installed package has an entry point"):
        rebuild_endpoint(start, None)  # type: ignore[arg-type]
