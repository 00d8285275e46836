"""The air between the vehicles: who hears whom, when, and in whose name."""

from __future__ import annotations

from typing import Any

import pytest
from core_kit import beacon
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect, wire
from companion.mavlink.codec import Codec
from mission.frames import LocalFrame, Vec3, Wgs84
from sim_bridge.world.radio import QUEUE_LIMIT, Radio

_CODEC = Codec(1, LocalFrame(Wgs84(47.0, 8.0, 400.0)))
_CODEC.home(dialect.MAVLink_home_position_message(470_000_000, 80_000_000, 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))
_CODEC.position(dialect.MAVLink_local_position_ned_message(0, 0, 0, -8, 0, 0, 0))


def frame(sender: int, *, range_m: float = 30.0, component: int = swarm_beacon.COMPONENT, **changes: Any) -> bytes:
    payload = _CODEC.encode_beacon(beacon(sender, range_m=range_m, **changes))
    assert payload is not None
    return wire.frame(swarm_beacon.MESSAGE_ID, payload, seq=0, system=sender, component=component)


def radio(*, range_m: float = 30.0, loss: float = 0.0, delay_s: float = 0.0, seed: int = 1) -> Radio:
    return Radio(range_m=range_m, loss=loss, delay_s=delay_s, seed=seed)


def in_a_row(*north_m: float) -> dict[int, Vec3]:
    return {k: (x, 0.0, -8.0) for k, x in enumerate(north_m, start=1)}


CLOSE = in_a_row(0.0, 5.0, 10.0)


def test_beacon_reaches_everyone_in_range_but_its_sender_unmodified() -> None:
    air = radio()
    places = in_a_row(0.0, 30.0, 30.001, -29.0)
    sent = frame(1)
    assert air.send(1, sent, places, 0.0) == [sent]
    assert {k: air.deliver(k, 0.0) for k in places} == {1: b"", 2: sent, 3: b"", 4: sent}
    assert air.deliver(2, 0.0) == b""  # once


def test_range_is_in_three_dimensions() -> None:
    air = radio()
    places = {1: (0.0, 0.0, 0.0), 2: (20.0, 20.0, -10.0), 3: (20.0, 20.0, -10.2)}
    air.send(1, frame(1), places, 0.0)
    assert air.deliver(2, 0.0) != b""
    assert air.deliver(3, 0.0) == b""


@given(st.floats(1.0, 100.0), st.floats(1.0, 100.0), st.floats(0.0, 120.0))
@settings(max_examples=50)
def test_link_needs_both_ranges_so_it_is_the_same_both_ways(one_m: float, other_m: float, apart_m: float) -> None:
    air = radio(range_m=1000.0)
    places = in_a_row(0.0, apart_m)
    for _ in range(2):  # the first round announces the ranges
        for k, range_m in ((1, one_m), (2, other_m)):
            air.send(k, frame(k, range_m=range_m), places, 0.0)
        back, there = air.deliver(1, 0.0), air.deliver(2, 0.0)
    assert bool(there) == bool(back) == (apart_m <= min(air.range_m(1), air.range_m(2)))
    assert air.range_m(1) == pytest.approx(one_m, abs=0.06)


def test_radio_starts_at_the_given_range_and_follows_its_own_beacons() -> None:
    air = radio(range_m=42.0)
    assert air.range_m(1) == 42.0
    air.send(1, frame(1, range_m=55.0), CLOSE, 0.0)
    assert air.range_m(1) == 55.0
    assert air.range_m(2) == 42.0


def test_what_was_heard_is_kept_for_reports() -> None:
    air = radio()
    air.send(2, frame(2, hop=3), CLOSE, 0.0)
    assert {k: wire.hop for k, wire in air.heard.items()} == {2: 3}


# --- loss ---


def received(air: Radio, places: dict[int, Vec3], n: int = 400) -> dict[int, list[bool]]:
    """For each receiver of vehicle 1's beacons: which came through."""
    came: dict[int, list[bool]] = {k: [] for k in places if k != 1}
    for k in range(n):
        air.send(1, frame(1, time_ms=k), places, float(k))
        for receiver, got in came.items():
            got.append(air.deliver(receiver, float(k)) != b"")
    return came


def test_loss_is_its_share_and_independent_for_each_receiver() -> None:
    came = received(radio(loss=0.3), CLOSE, 1000)
    for got in came.values():
        assert sum(got) == pytest.approx(700, abs=45)
    both = sum(a and b for a, b in zip(came[2], came[3], strict=True))
    assert both == pytest.approx(490, abs=50)


def test_same_seed_loses_the_same_beacons_and_another_seed_others() -> None:
    assert received(radio(loss=0.3, seed=4), CLOSE) == received(radio(loss=0.3, seed=4), CLOSE)
    assert received(radio(loss=0.3, seed=4), CLOSE) != received(radio(loss=0.3, seed=5), CLOSE)


def test_who_else_is_in_range_does_not_change_ones_luck() -> None:
    crowd = {**CLOSE, 4: (1.0, 1.0, -8.0), 5: (2.0, 2.0, -8.0)}
    alone, crowded = received(radio(loss=0.5), CLOSE), received(radio(loss=0.5), crowd)
    assert alone[3] == crowded[3]


def test_no_loss_and_total_loss() -> None:
    assert all(received(radio(), CLOSE)[2])
    assert not any(received(radio(loss=1.0), CLOSE)[2])


# --- parts ---


def test_a_group_that_is_cut_off_hears_nobody_outside_and_is_not_heard_there() -> None:
    air = radio()
    places = in_a_row(0.0, 1.0, 2.0, 3.0)
    air.cut_off = (frozenset({1, 2}),)
    sent = {k: frame(k) for k in places}
    for k, one in sent.items():
        air.send(k, one, places, 0.0)
    assert [air.deliver(k, 0.0) for k in places] == [sent[2], sent[1], sent[4], sent[3]]
    air.cut_off = ()
    air.send(1, sent[1], places, 0.0)
    assert air.deliver(4, 0.0) == sent[1]


def test_being_cut_off_does_not_change_the_luck_of_others() -> None:
    parted = radio(loss=0.5, delay_s=0.1)
    parted.cut_off = (frozenset({2}),)
    whole = radio(loss=0.5, delay_s=0.1)
    assert received(parted, CLOSE)[3] == received(whole, CLOSE)[3]


# --- delay ---


def test_delay_is_even_over_twice_its_mean() -> None:
    air = radio(delay_s=0.2)
    delays = []
    for k in range(300):
        sent_s = 10.0 * k
        air.send(1, frame(1), {1: CLOSE[1], 2: CLOSE[2]}, sent_s)
        assert air.deliver(2, sent_s - 1e-9) == b""
        delays.append(next(0.005 * j for j in range(1000) if air.deliver(2, sent_s + 0.005 * j)))
    assert max(delays) <= 0.4 + 0.005
    assert sum(delays) / len(delays) == pytest.approx(0.2, abs=0.02)
    assert min(delays) < 0.05


def test_frames_come_in_the_order_of_their_arrival_not_of_their_sending() -> None:
    air = radio(delay_s=1.0)
    sent = [frame(1, time_ms=k) for k in range(30)]
    for k, one in enumerate(sent):
        air.send(1, one, CLOSE, 0.01 * k)
    arrived: list[bytes] = []
    for k in range(400):
        arrived += [found for _, found, _ in swarm_beacon.beacons(air.deliver(2, 0.01 * k))]
    assert sorted(arrived) == sorted(sent)
    assert arrived != sent


def test_frames_due_at_once_keep_the_order_of_their_sending() -> None:
    air = radio()
    sent = [frame(1, time_ms=k) for k in range(20)]
    for one in sent:
        air.send(1, one, CLOSE, 0.0)
    assert air.deliver(2, 0.0) == b"".join(sent)


def test_queue_is_bounded_and_loses_the_oldest() -> None:
    air = radio()
    sent = [frame(1, time_ms=k) for k in range(QUEUE_LIMIT + 5)]
    for k, one in enumerate(sent):
        air.send(1, one, CLOSE, 0.001 * k)
    assert [found for _, found, _ in swarm_beacon.beacons(air.deliver(2, 1e6))] == sent[5:]


# --- in whose name ---


def test_beacon_in_anothers_name_is_refused_and_goes_nowhere() -> None:
    air = radio()
    assert air.send(1, frame(2), CLOSE, 0.0) == []
    assert air.refused == 1
    assert [air.deliver(k, 0.0) for k in CLOSE] == [b"", b"", b""]
    assert air.heard == {}


def test_forged_beacon_in_a_datagram_does_not_stop_the_genuine_one() -> None:
    air = radio()
    good = frame(1)
    assert air.send(1, frame(3, range_m=1.0) + good + frame(2), CLOSE, 0.0) == [good]
    assert air.refused == 2
    assert air.range_m(3) == 30.0


@pytest.mark.parametrize("data", [b"", b"\xfd" * 500, frame(1)[:-1], frame(1, component=1), bytes(300)])
def test_what_is_no_beacon_of_a_companion_goes_nowhere(data: bytes) -> None:
    air = radio()
    assert air.send(1, data, CLOSE, 0.0) == []
    assert air.deliver(2, 0.0) == b""


def test_damaged_beacon_goes_nowhere() -> None:
    good = frame(1)
    for at in range(len(good)):
        air = radio()
        bad = bytearray(good)
        bad[at] ^= 0x40
        assert air.send(1, bytes(bad), CLOSE, 0.0) == []
        assert air.deliver(2, 0.0) == b""
