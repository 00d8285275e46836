"""Constellations of trunks: which are aligned, how well, and which are not."""

from __future__ import annotations

import math
from random import Random

import pytest

from companion.core.localisation.gnss_denied.error_state import Level
from companion.core.model.beacon import ToldTrunk
from companion.core.perception.landmarks.constellation import Alignment, align, turned

THERE: Level = (6.0, -5.0)
TURN = math.radians(4.0)


def stand(rng: Random, count: int, half_m: float = 14.0) -> list[ToldTrunk]:
    """Trunks about the middle, at least 1.5 m apart."""
    found: list[ToldTrunk] = []
    while len(found) < count:
        n, e = rng.uniform(-half_m, half_m), rng.uniform(-half_m, half_m)
        if all(math.hypot(n - one[0], e - one[1]) > 1.5 for one in found):
            found.append((n, e, rng.uniform(0.15, 0.5)))
    return found


def tell(trunks: list[ToldTrunk], noise_m: float = 0.0, rng: Random | None = None) -> list[ToldTrunk]:
    """The nearest twelve as a neighbour at THERE, turned by TURN, has them."""
    told = []
    for n, e, d in trunks:
        off = (0.0, 0.0) if rng is None else (rng.gauss(0.0, noise_m), rng.gauss(0.0, noise_m))
        told.append((*turned(-TURN, n - THERE[0] + off[0], e - THERE[1] + off[1]), d))
    return sorted(told, key=lambda one: math.hypot(one[0], one[1]))[:12]


def found(told: list[ToldTrunk], known: list[ToldTrunk], *, is_wide: bool = False) -> Alignment | None:
    """From where it is thought to be 1 m and 3 degrees off."""
    return align(told, known, (THERE[0] + 0.8, THERE[1] - 0.6), TURN - math.radians(3.0), is_wide=is_wide)


def test_the_same_trunks_are_aligned_exactly() -> None:
    trunks = stand(Random(1), 30)
    fit = found(tell(trunks), trunks)
    assert fit is not None
    assert fit.matched == 12
    assert fit.place((0.0, 0.0)) == pytest.approx(THERE, abs=1e-9)
    assert fit.turn_rad == pytest.approx(TURN, abs=1e-9)


def test_errors_of_sightings_average_out_and_are_known() -> None:
    off_m, off_rad = [], []
    for seed in range(40):
        rng = Random(seed)
        trunks = stand(rng, 30)
        fit = found(tell(trunks, 0.08, rng), trunks)
        assert fit is not None
        middle = turned(TURN, *fit.there)
        off_m.append(math.hypot(fit.here[0] - THERE[0] - middle[0], fit.here[1] - THERE[1] - middle[1]))
        off_rad.append(abs(fit.turn_rad - TURN) / fit.turn_sd_rad)
    assert math.sqrt(sum(one * one for one in off_m) / 40) < 0.06
    assert math.sqrt(sum(one * one for one in off_rad) / 40) < 1.5


def test_trunks_that_the_other_has_not_seen_do_not_matter() -> None:
    rng = Random(3)
    trunks = stand(rng, 30)
    fit = found(tell(trunks[:20]), trunks[10:])
    assert fit is None or math.dist(fit.place((0.0, 0.0)), THERE) < 0.1
    told = tell(trunks)
    fit = found(told, [*tell_back(told[:8]), *stand(Random(9), 6, 8.0)])
    assert fit is not None
    assert math.dist(fit.place((0.0, 0.0)), THERE) < 0.3


def tell_back(told: list[ToldTrunk]) -> list[ToldTrunk]:
    """The same trunks about this vehicle."""
    return [(*(a + b for a, b in zip(turned(TURN, n, e), THERE, strict=True)), d) for n, e, d in told]


@pytest.mark.parametrize(("common", "is_wide"), [(5, False), (6, True)])
def test_too_few_common_trunks_are_not_aligned(common: int, is_wide: bool) -> None:
    told = tell(stand(Random(4), 30))
    far = [(40.0 + 2.0 * k, 40.0, 0.3) for k in range(10)]
    assert found(told, [*tell_back(told[:common]), *far], is_wide=is_wide) is None
    assert found(told, [*tell_back(told[: common + 1]), *far], is_wide=is_wide) is not None


def test_trunks_in_rows_fit_at_more_than_one_place_and_are_not_aligned() -> None:
    rows = [(2.0 * n, 2.0 * e, 0.3) for n in range(-8, 9) for e in range(-8, 9)]
    assert found(tell(rows), rows) is None


def test_trunks_of_other_diameters_are_others() -> None:
    told = tell(stand(Random(5), 30))
    assert found(told, [(n, e, d + 0.2) for n, e, d in tell_back(told)]) is None


def test_a_neighbour_that_is_elsewhere_than_thought_is_not_searched_for() -> None:
    trunks = stand(Random(6), 30)
    assert align(tell(trunks), trunks, (THERE[0] + 6.0, THERE[1]), TURN, is_wide=False) is None
    assert align(tell(trunks), trunks, THERE, TURN + math.radians(20.0), is_wide=False) is None


def test_a_thicket_is_aligned_with_nothing() -> None:
    """Of leaves, which are everywhere, some lie beside whatever is told."""
    for seed in range(20):
        rng = Random(seed)
        thicket = [(rng.uniform(-14.0, 14.0), rng.uniform(-14.0, 14.0), rng.uniform(0.15, 0.5)) for _ in range(128)]
        assert found(tell(stand(rng, 30)), thicket) is None


def test_strangers_are_not_aligned() -> None:
    for seed in range(150):
        rng = Random(1000 + seed)
        count = rng.choice([15, 30, 45])
        assert found(tell(stand(rng, count)), stand(rng, count)) is None
