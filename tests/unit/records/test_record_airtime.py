"""Airtime that records may take."""

from __future__ import annotations

from companion.records.airtime import LEAST_SHARE, OVERHEAD_BYTES, USABLE_SHARE, Airtime

FRAME = 200
TICK_S = 0.05


def taken_bps(rate_kbps: float, beacon_bytes: int, heard: int, for_s: float = 60.0) -> float:
    """Bytes a second that a node with always something to send gets, after the first 10 s."""
    airtime = Airtime(rate_kbps)
    taken = 0
    for tick in range(round(for_s / TICK_S)):
        airtime.refill(tick * TICK_S, beacon_bytes + OVERHEAD_BYTES if tick % 2 == 0 else 0, heard)
        while airtime.take_tokens(FRAME):
            taken += (FRAME + OVERHEAD_BYTES) * (tick * TICK_S >= 10.0)
    return taken / (for_s - 10.0)


def test_records_take_the_share_that_beacons_leave() -> None:
    beacons_bps = 10 * (150 + OVERHEAD_BYTES)
    wanted = (250e3 / 8 * USABLE_SHARE - 4 * beacons_bps) / 4
    assert abs(taken_bps(250.0, 150, heard=3) - wanted) < 0.06 * wanted


def test_all_together_never_take_more_than_is_left() -> None:
    for heard in range(1, 11):
        beacons_bps = 10 * (150 + OVERHEAD_BYTES)
        left = max(250e3 / 8 * USABLE_SHARE - beacons_bps * (heard + 1), 250e3 / 8 * LEAST_SHARE)
        assert taken_bps(250.0, 150, heard) * (heard + 1) <= 1.05 * left + 100.0  # the measure of the beacons swings


def test_records_get_through_however_many_beacons_there_are() -> None:
    assert 0.0 < taken_bps(250.0, 150, heard=40, for_s=600.0) * 41 <= 1.05 * 250e3 / 8 * LEAST_SHARE


def test_a_clock_that_stood_still_or_leapt_gives_no_burst() -> None:
    airtime = Airtime(1000.0)
    for now_s in (0.0, 0.0, 1e6, 1e6):
        airtime.refill(now_s, 0, 0)
    assert sum(airtime.take_tokens(FRAME) for _ in range(100)) == 1
