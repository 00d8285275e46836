"""Range radios of the simulated world: what they measure, how often, and what trunks do to it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from companion.mavlink.packing import unpack_ranges
from mission.common.frames import Vec3
from mission.document.model import RangeTrunks, Ranging, RangingErrors
from mission.stand.stand import Stand, stand_of
from sim_bridge.world.sensors.ranging import RangeRadios, pair_rate_hz
from tests.unit.core.ranging_kit import STARTS, ranging_mission

RANGING = Ranging(start_enu_m=STARTS)
CLEAN = RangingErrors(noise_m=0.0, loss=0.0)
PLACES: dict[int, Vec3] = {1: (0.0, 0.0, -4.0), 2: (10.0, 0.0, -4.0), 3: (0.0, 6.0, -4.0), 4: (40.0, 0.0, -4.0)}


def measured(
    errors: RangingErrors,
    seconds: float,
    *,
    places: dict[int, Vec3] = PLACES,
    stand: Stand | None = None,
) -> dict[tuple[int, int], list[float]]:
    """By who measured whom."""
    radios = RangeRadios(sorted(places), RANGING, errors, stand, seed=1)
    found: dict[tuple[int, int], list[float]] = {}
    for tick in range(round(seconds / 0.05)):
        for k, data in radios.measure(places, tick * 0.05).items():
            for incoming in Framing({dialect.MAVLINK_MSG_ID_SWARM_RANGES}).read_messages(data):
                assert incoming.system == k
                for other, metres, age_s in unpack_ranges(incoming.message.ranges):
                    assert age_s == 0.0
                    found.setdefault((k, other), []).append(metres)
    return found


def test_both_ends_learn_of_each_range_and_those_too_far_of_none() -> None:
    found = measured(CLEAN, 10.0)
    assert found[1, 2] == found[2, 1] == pytest.approx([10.0] * len(found[1, 2]))
    assert set(found) == {(1, 2), (2, 1), (1, 3), (3, 1), (2, 3), (3, 2)}  # 4 is out of reach
    assert len(found[1, 2]) == pytest.approx(100, abs=1)  # 10 Hz


def test_noise_and_loss_are_those_of_the_mission() -> None:
    found = measured(RangingErrors(noise_m=0.2, loss=0.3), 100.0)
    assert len(found[1, 2]) == pytest.approx(700, abs=50)
    assert np.std(found[1, 2]) == pytest.approx(0.2, rel=0.1)


@pytest.mark.parametrize(("n", "rate_hz"), [(4, 10.0), (8, 10.0), (12, 320.0 / 66.0)])
def test_many_vehicles_share_the_time_on_the_air(n: int, rate_hz: float) -> None:
    assert pair_rate_hz(n, RANGING, RangingErrors()) == pytest.approx(rate_hz)


def test_a_lost_range_or_a_far_vehicle_changes_no_others_luck() -> None:
    moved = PLACES | {4: (0.0, 12.0, -4.0)}
    noisy = RangingErrors()
    assert measured(noisy, 20.0)[1, 2] == measured(noisy, 20.0, places=moved)[1, 2]


@pytest.mark.parametrize("trunks", list(RangeTrunks))
def test_a_trunk_between_makes_ranges_late_or_cuts_them_off(trunks: RangeTrunks) -> None:
    forest = {"trees": [{"base_enu_m": [0.0, 35.0], "trunk_radius_m": 0.4, "height_m": 20.0}]}
    stand = stand_of(ranging_mission(forest=forest))
    places: dict[int, Vec3] = {k: (n + 30.0, e, d) for k, (n, e, d) in PLACES.items()}
    found = measured(CLEAN.model_copy(update={"trunks": trunks}), 10.0, places=places, stand=stand)
    assert found[1, 3] == pytest.approx([6.0] * len(found[1, 3]))  # nothing stands there
    match trunks:
        case RangeTrunks.CLEAR:
            assert found[1, 2] == pytest.approx([10.0] * len(found[1, 2]))
        case RangeTrunks.LATE:
            assert 10.2 <= min(found[1, 2]) == max(found[1, 2]) <= 11.2  # the same for as long as it stands there
        case RangeTrunks.CUT:
            assert (1, 2) not in found


def test_late_ranges_come_anywhere_and_are_never_early() -> None:
    found = measured(CLEAN.model_copy(update={"late": 0.25}), 100.0)[1, 2]
    late = [metres for metres in found if metres > 10.1]
    assert len(late) / len(found) == pytest.approx(0.25, abs=0.05)
    assert math.isclose(min(found), 10.0)
    assert max(late) <= 11.2
