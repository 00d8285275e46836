"""WGS84 to UTM: the way back of what stem maps are read by."""

from __future__ import annotations

import pytest

from mission.stems.utm import Zone, from_wgs84, to_wgs84, zone_at


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(47.5, 8.5), (-33.9, 18.4), (0.0, -179.9), (63.4, 10.4), (-41.3, 174.8)]
)
def test_there_and_back_is_the_same_place_to_a_tenth_of_a_millimetre(lat_deg: float, lon_deg: float) -> None:
    zone = zone_at(lat_deg, lon_deg)
    back = to_wgs84(*from_wgs84(lat_deg, lon_deg, zone), zone)
    assert back == pytest.approx((lat_deg, lon_deg), abs=1e-9)


def test_on_the_central_meridian_the_easting_is_the_false_one_and_the_equator_has_the_false_northing() -> None:
    assert from_wgs84(0.0, 9.0, Zone(32, south=False)) == pytest.approx((500_000.0, 0.0), abs=1e-6)
    assert from_wgs84(0.0, 9.0, Zone(32, south=True)) == pytest.approx((500_000.0, 10_000_000.0), abs=1e-6)


def test_zones_go_by_longitude_and_half() -> None:
    assert zone_at(47.5, 8.5) == Zone(32, south=False)
    assert zone_at(-10.0, 180.0) == Zone(1, south=True)
    assert (zone_at(47.5, 8.5).epsg, zone_at(-41.3, 174.8).epsg) == (32632, 32760)
