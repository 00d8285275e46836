"""What is said of a mission's obstacle sensor: a view too narrow for what is made of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mission.cli import check
from mission.document.load import dump_mission
from mission.document.model import Mission


@pytest.mark.parametrize(
    ("sensor", "view_deg", "is_told"), [("scan-1deg", 30, True), ("scan-1deg", 180, False), ("sectors", 30, False)]
)
def test_check_says_that_a_raw_lidar_hardly_sees_its_motion_by_less_than_half_a_turn(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sensor: str, view_deg: float, is_told: bool
) -> None:
    route = {"d1_enu_m": [0, 0, 4], "d2_enu_m": [130, 0, 4], "vel_leader_mps": 3}
    sensing = {"sensor": sensor, "field_of_view_deg": view_deg}
    file = tmp_path / "narrow.toml"
    file.write_text(dump_mission(Mission.model_validate({"schema": 1, "route": route, "sensing": sensing})))
    assert check.run([str(file)], as_json=False) == 0
    assert ("sensing.field_of_view_deg = 30: a raw lidar" in capsys.readouterr().out) is is_told
