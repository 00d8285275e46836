"""The loss of a trunk that docs/explanation/simulated-forest.md tells, from the diffraction past an opaque strip."""

from __future__ import annotations

import math

import pytest

SPEED_OF_LIGHT_MPGS = 0.299792458  # metres in a nanosecond: GHz to metres


def fresnel(limit: float, steps: int = 2000) -> complex:
    """C + jS from 0 to `limit`, by the middle of small steps."""
    width = limit / steps
    turns = [math.pi / 2.0 * ((k + 0.5) * width) ** 2 for k in range(steps)]
    return complex(sum(map(math.cos, turns)), sum(map(math.sin, turns))) * width


def strip_loss_db(wide_m: float, frequency_ghz: float, near_m: float, far_m: float) -> float:
    """Two knife edges, `wide_m` apart, on the line between antennas at these distances (ITU-R P.526)."""
    wavelength_m = SPEED_OF_LIGHT_MPGS / frequency_ghz
    edge = wide_m / 2.0 * math.sqrt(2.0 * (near_m + far_m) / (wavelength_m * near_m * far_m))
    return -20.0 * math.log10(abs(1.0 - 2.0 * fresnel(edge) / complex(1.0, 1.0)))


@pytest.mark.parametrize(
    ("wide_m", "table_db"),
    [
        (0.15, (1.6, 2.7, 2.5, 4.1)),
        (0.25, (2.7, 4.4, 4.1, 6.6)),
        (0.35, (3.8, 6.0, 5.7, 8.8)),
        (0.45, (4.8, 7.5, 7.1, 10.6)),
    ],
)
def test_a_trunk_takes_what_the_table_says(wide_m: float, table_db: tuple[float, ...]) -> None:
    found = [strip_loss_db(wide_m, ghz, near_m, 10.0 - near_m) for ghz in (2.4, 5.8) for near_m in (5.0, 1.0)]
    assert found == pytest.approx(table_db, abs=0.051)
