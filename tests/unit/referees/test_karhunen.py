"""The protocol of Karhunen et al.: its flights, its table beside theirs, and one of the flights."""

from __future__ import annotations

from collections import Counter

import pytest

from tests.referees.karhunen import cases, fly_through
from tests.referees.karhunen_table import section
from tests.referees.referee import Case

STAND = {"density_per_ha": 1000.0, "dbh_m": 0.18, "free_m": 11.4}


def test_each_forest_is_flown_fifteen_times_at_each_speed() -> None:
    assert Counter(case.name for case in cases()) == {
        f"{forest} {speed} m/s": 30 for forest in ("medium", "dense") for speed in (1, 2, 3)
    }
    assert {(case.n, case.estimates, case.sensor) for case in cases()} == {
        (1, "recorded", "scan-1deg"),
        (1, "recorded", "sectors"),
    }


def test_the_table_stands_beside_theirs() -> None:
    first, second, third = cases()[:3]
    rows = [
        first.row("clear", way_m=57.0, time_s=60.0, **STAND),
        second.row("clear", way_m=54.4, time_s=64.0, **STAND),
        third.row("contact", way_m=None, time_s=None, **STAND),
    ]
    text = section(rows, "abc")
    assert "seeds 1000 to 1002, JSBSim, n = 1, estimates `recorded`, heights by range finder." in text
    line = "| medium | 1 | 1000, 18 cm | 11 m | 12/15 | `scan-1deg` | 2/3 (21% to 94%) | 1 | 0 | 0.90 ± 0.07 | 62 ± 3 |"
    assert line in text


def test_a_flight_of_the_protocol() -> None:
    row = fly_through(Case("medium 3 m/s", 1, 1000, "recorded", "scan-1deg"))
    assert row["grade"] == "clear", row["verdict"]
    assert 50.0 < row["way_m"] < 65.0
    assert 0.0 < row["way_m"] / row["time_s"] < 3.3
    assert row["free_m"] == pytest.approx(1e4 / (1000.0 * (row["dbh_m"] + 0.7)))
