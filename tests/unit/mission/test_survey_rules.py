"""[survey]: with which sensors it is refused, and what `mission check` says of the height of cuts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mission.cli import check
from mission.document.model import Mission
from mission.rules.survey_rules import cut_distances_m

HANGING = {"sensor": "multi-layer", "upside_down": True, "range_m": 12.0}
FILE = """
schema = 1
survey = {{}}
{sensing}
[route]
d1_enu_m = [0.0, 0.0, 4.0]
d2_enu_m = [100.0, 0.0, 4.0]
vel_leader_mps = 2.0
"""


def surveying(
    sensing: dict[str, Any] | None, survey: dict[str, Any] | None = None, at_end: str = "hold", covers_s: float = 60.0
) -> Mission:
    route = {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [100.0, 0.0, 4.0], "vel_leader_mps": 2.0, "at_end": at_end}
    tables = {"survey": survey or {}, "sensing": sensing, "coverage": {"duration_s": covers_s}}
    return Mission.model_validate({"schema": 1, "route": route, **tables})


def test_sectors_are_refused_since_they_tell_no_diameter() -> None:
    with pytest.raises(ValueError, match=r"sensing.sensor.*no diameter"):
        surveying({"sensor": "sectors"})


def test_a_survey_needs_a_sensor() -> None:
    with pytest.raises(ValueError, match=r"sensing: missing; \[survey\] needs \[sensing\]"):
        surveying(None)


def test_mission_check_names_the_table_that_a_survey_lacks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "survey.toml"
    file.write_text(FILE.format(sensing=""))
    assert check.run([str(file)], as_json=False) != 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "sensing: missing; [survey] needs [sensing] with a lidar that tells every ray" in line
    assert '"scan-0.5deg"' in line
    assert "reach_m" not in line


def test_a_hanging_lidar_of_layers_cuts_breast_height() -> None:
    near_m, far_m = cut_distances_m(surveying(HANGING)) or (0.0, 0.0)
    assert near_m == pytest.approx(2.7 / 1.28, rel=0.01)  # tan 52 degrees
    assert far_m == 7.0


@pytest.mark.parametrize(
    "sensing",
    [{"sensor": "scan-1deg"}, {"sensor": "scan-0.5deg"}, {"sensor": "multi-layer", "range_m": 12.0}],
    ids=["1 degree", "0.5 degree", "layers that look up"],
)
def test_other_lidars_cut_at_flight_height(sensing: dict[str, Any]) -> None:
    assert cut_distances_m(surveying(sensing)) is None


@pytest.mark.parametrize(
    ("sensing", "said"),
    [
        (
            'sensing = { sensor = "multi-layer", upside_down = true, range_m = 12.0 }',
            "cut stems at breast height, 1.3 m, where they pass 2.1 to 7.0 m away",
        ),
        ('sensing = { sensor = "scan-1deg" }', "cut at flight height, 4 m"),
    ],
)
def test_mission_check_says_where_stems_are_cut(
    sensing: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "survey.toml"
    file.write_text(FILE.format(sensing=sensing))
    assert check.run([str(file)], as_json=False) == 0
    assert said in capsys.readouterr().out


UNTIL = {"until": {"basal_area_pct": 10.0}}


def test_coverage_may_end_once_the_stand_is_known() -> None:
    until = surveying(HANGING, UNTIL, at_end="return").survey
    assert until is not None
    assert until.until is not None
    assert (until.until.confidence, until.until.after_s) == (0.95, 10.0)


def test_a_mission_that_holds_has_no_until_which_would_never_count() -> None:
    with pytest.raises(ValueError, match=r"route.at_end.*never ends coverage"):
        surveying(HANGING, UNTIL)


def test_until_needs_less_time_than_coverage_takes() -> None:
    with pytest.raises(ValueError, match=r"survey.until.after_s = 10.0: must be less"):
        surveying(HANGING, UNTIL, at_end="land", covers_s=10.0)
