"""What an estimator goes by beside satellites, or instead of them: read by preflight, judged, and never set."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from companion.mavlink.makes.ardupilot import ARDUPILOT
from companion.mavlink.makes.make import Make
from companion.mavlink.makes.px4 import PX4
from companion.preflight import surveyor
from companion.preflight.report import Verdict
from companion.preflight.survey import Parameter
from tests.unit.core.core_kit import mission
from tests.unit.core.ranging_kit import ranging_mission
from tests.unit.preflight.test_preflight_checks import ME, SQUARE, judged, survey


@pytest.mark.parametrize(
    ("make", "values", "good"),
    [
        (PX4, {"EKF2_OF_CTRL": 1, "EKF2_EV_CTRL": 0}, True),
        (PX4, {"EKF2_OF_CTRL": 0, "EKF2_EV_CTRL": 15}, True),
        (PX4, {"EKF2_OF_CTRL": 0, "EKF2_EV_CTRL": 4}, True),
        (PX4, {"EKF2_OF_CTRL": 0, "EKF2_EV_CTRL": 10}, False),  # height and yaw
        (PX4, {"EKF2_OF_CTRL": 0, "EKF2_EV_CTRL": 0}, False),
        (PX4, {"EKF2_OF_CTRL": math.nan, "EKF2_EV_CTRL": math.inf}, False),
        (PX4, {"EKF2_OF_CTRL": None, "EKF2_EV_CTRL": None}, False),
        (ARDUPILOT, {"EK3_SRC1_VELXY": 5, "FLOW_TYPE": 6, "VISO_TYPE": 0}, True),
        (ARDUPILOT, {"EK3_SRC1_VELXY": 6, "FLOW_TYPE": 0, "VISO_TYPE": 1}, True),
        (ARDUPILOT, {"EK3_SRC1_VELXY": 5, "FLOW_TYPE": 0, "VISO_TYPE": 1}, False),
        (ARDUPILOT, {"EK3_SRC1_VELXY": 6, "FLOW_TYPE": 6, "VISO_TYPE": 0}, False),
        (ARDUPILOT, {"EK3_SRC1_VELXY": 5, "FLOW_TYPE": None, "VISO_TYPE": None}, False),
    ],
)
def test_a_vehicle_without_satellites_needs_something_that_tells_it_how_it_moves(
    make: Make, values: dict[str, float | None], good: bool
) -> None:
    flown = ranging_mission()
    there = {r.name: Parameter(name=r.name, value=r.wanted) for r in make.rules(flown, ME)}
    there |= {name: Parameter(name=name, value=value) for name, value in values.items()}
    seen = survey(make, flown, parameters=there)
    assert judged(seen, flown)["aiding"].verdict is (Verdict.PASS if good else Verdict.FAIL)
    assert make.aids_of(flown, 1) == ()
    assert "aiding" not in judged(survey(make))


@pytest.mark.parametrize(
    ("make", "values", "good"),
    [
        (PX4, {"EKF2_HGT_REF": 2, "EKF2_RNG_CTRL": 2}, True),
        (PX4, {"EKF2_HGT_REF": 2, "EKF2_RNG_CTRL": 1}, False),  # faster than 1 m/s: by the barometer
        (PX4, {"EKF2_HGT_REF": 2, "EKF2_RNG_CTRL": 0}, False),
        (PX4, {"EKF2_HGT_REF": 0, "EKF2_RNG_CTRL": 2}, False),  # the barometer's
        (PX4, {"EKF2_HGT_REF": None, "EKF2_RNG_CTRL": None}, False),
        (ARDUPILOT, {"EK3_SRC1_POSZ": 2, "RNGFND1_ORIENT": 25, "RNGFND1_TYPE": 20}, True),
        (ARDUPILOT, {"EK3_SRC1_POSZ": 2, "RNGFND1_ORIENT": 0, "RNGFND1_TYPE": 20}, False),  # it looks ahead
        (ARDUPILOT, {"EK3_SRC1_POSZ": 1, "RNGFND1_ORIENT": 25, "RNGFND1_TYPE": 20}, False),
        (ARDUPILOT, {"EK3_SRC1_POSZ": 2, "RNGFND1_ORIENT": 25, "RNGFND1_TYPE": 0}, False),
    ],
)
def test_layers_of_height_need_a_downward_range_finder(make: Make, values: dict[str, float | None], good: bool) -> None:
    layered = mission(fence={"polygon_enu_m": SQUARE}, separation={"height_layers": True})
    there = {r.name: Parameter(name=r.name, value=r.wanted) for r in make.rules(layered)}
    there |= {name: Parameter(name=name, value=value) for name, value in values.items()}
    checked = judged(survey(make, layered, parameters=there), layered)["height"]
    assert checked.verdict is (Verdict.PASS if good else Verdict.FAIL)
    assert "height_layers" in (checked.fix or "height_layers")
    assert "height" not in judged(survey(make))


@pytest.mark.parametrize(
    ("make", "values", "good"),
    [
        (PX4, {"EKF2_EV_CTRL": 4}, True),
        (PX4, {"EKF2_EV_CTRL": 15}, True),
        (PX4, {"EKF2_EV_CTRL": 11}, False),  # place and yaw, which it is not told
        (PX4, {"EKF2_EV_CTRL": 0}, False),
        (PX4, {"EKF2_EV_CTRL": None}, False),
        (ARDUPILOT, {"EK3_SRC2_VELXY": 6, "EK3_SRC_OPTIONS": 1, "VISO_TYPE": 1}, True),
        (ARDUPILOT, {"EK3_SRC2_VELXY": 6, "EK3_SRC_OPTIONS": 0, "VISO_TYPE": 1}, False),  # one source at a time
        (ARDUPILOT, {"EK3_SRC2_VELXY": 0, "EK3_SRC_OPTIONS": 1, "VISO_TYPE": 1}, False),
        (ARDUPILOT, {"EK3_SRC2_VELXY": 6, "EK3_SRC_OPTIONS": 1, "VISO_TYPE": 0}, False),
        (ARDUPILOT, {"EK3_SRC2_VELXY": 6, "EK3_SRC_OPTIONS": 1, "VISO_TYPE": 3}, False),  # turns it by its own yaw
    ],
)
def test_an_autopilot_that_is_sent_odometry_must_use_it(
    make: Make, values: dict[str, float | None], good: bool
) -> None:
    told = mission(fence={"polygon_enu_m": SQUARE}, sensing={"sends_odometry": True})
    there = {r.name: Parameter(name=r.name, value=r.wanted) for r in make.rules(told)}
    there |= {name: Parameter(name=name, value=value) for name, value in values.items()}
    checked = judged(survey(make, told, parameters=there), told)["odometry"]
    assert checked.verdict is (Verdict.PASS if good else Verdict.FAIL)
    assert "sends_odometry" in (checked.fix or "sends_odometry")
    assert "odometry" not in judged(survey(make))


def test_what_aids_a_vehicle_without_satellites_is_read_and_never_set(monkeypatch: pytest.MonkeyPatch) -> None:
    held: dict[str, float] = {"EKF2_OF_CTRL": 0, "EKF2_EV_CTRL": 4, "EKF2_GPS_CTRL": 7}
    param = SimpleNamespace(
        get_param_int=lambda name: held.get(name, 0),
        get_param_float=lambda name: held.get(name, 0.0),
        set_param_int=held.__setitem__,
        set_param_float=held.__setitem__,
    )
    monkeypatch.setattr(surveyor, "Param", lambda _system: param)
    monkeypatch.setattr(surveyor, "_download", lambda _system: ((), ""))
    flown, seen = ranging_mission(), survey()
    aids = [name for aid in PX4.aids_of(flown, ME) for name in aid.names]
    told = surveyor._settings(Any, PX4.rules(flown, ME), flown, seen, aids=aids, apply=True)
    assert (told["parameters"]["EKF2_OF_CTRL"].value, told["parameters"]["EKF2_EV_CTRL"].value) == (0, 4)
    assert (held["EKF2_GPS_CTRL"], held["EKF2_OF_CTRL"]) == (0, 0)
    assert PX4.aids_of(flown, 1) == ()
