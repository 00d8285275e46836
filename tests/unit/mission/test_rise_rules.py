"""`survey.rise_to_m`: with which sensors, heights and coverage it is refused, and what `mission check` says of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from mission.cli import check
from mission.document.load import dump_mission
from mission.document.model import Mission
from mission.rules.rise_rules import upward_view

UPRIGHT = {"sensor": "multi-layer", "range_m": 40.0}


def rising(
    rise_to_m: float | None = 25.0,
    sensing: dict[str, Any] | None = None,
    coverage: dict[str, Any] | None = None,
    **tables: Any,
) -> Mission:
    route = {"d1_enu_m": [0.0, 0.0, 4.0], "d2_enu_m": [100.0, 0.0, 4.0], "vel_leader_mps": 2.0}
    values = {
        "survey": {} if rise_to_m is None else {"rise_to_m": rise_to_m},
        "sensing": sensing or UPRIGHT,
        "coverage": coverage or {},
        "fence": {"altitude_max_m": 5.6},
        **tables,
    }
    return Mission.model_validate({"schema": 1, "route": route, **values})


def test_nobody_rises_by_default_and_the_ceiling_is_the_fences() -> None:
    assert rising(None).rise_to_m is None
    assert rising(None).ceiling_m == 5.6


def test_autopilots_fences_allow_the_rise() -> None:
    assert rising().ceiling_m == 25.0


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"rise_to_m": 5.6}, r"survey.rise_to_m.*must be above the height that holds all others"),
        ({"sensing": {**UPRIGHT, "upside_down": True}}, r"hangs, and looks 7 degrees up \(.*sensing.upside_down"),
        ({"sensing": {"sensor": "scan-1deg", "range_m": 12.0}}, r"has no layers that look up"),
        ({"sensing": {**UPRIGHT, "range_m": 12.0}}, r"by rays of 27.9 m: needs sensing.range_m of at least 28.9"),
        ({"coverage": {"duration_s": 10.0}}, r"needs more than 10 s of coverage"),
        ({"coverage": {"shape": "sphere", "radius_m": 1.0}, "rise_to_m": 30.0}, r'in a "ring" alone'),
    ],
)
def test_refused_with_its_reason(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        rising(**changes)


def test_a_swarm_that_flies_by_ranges_does_not_rise() -> None:
    places = [[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0]]
    with pytest.raises(ValueError, match=r"survey.rise_to_m.*a leader rises by satellite positions alone"):
        rising(
            swarm={"size": 3, "gnss": "leader", "leader_priority": [1]},
            ranging={"start_enu_m": places},
        )


def test_the_top_is_seen_from_afar_and_by_rays_so_long() -> None:
    away_m, ray_m = upward_view(rising()) or (0.0, 0.0)
    assert away_m == pytest.approx(22.0 / 1.2799, rel=1e-3)  # tan 52 degrees, and a metre above the top
    assert ray_m == pytest.approx(22.0 / 0.7880, rel=1e-3)


def test_mission_check_says_who_rises_and_from_where_that_is_seen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rise.toml"
    file.write_text(dump_mission(rising()))
    assert check.run([str(file)], as_json=False) == 0
    shown = capsys.readouterr()
    assert "the leader alone may rise above fence.altitude_max_m = 5.6" in shown.out + shown.err
    assert "17.2 m away" in shown.out + shown.err
