"""The air between the vehicles: which frame reaches whom, and when. It carries any bytes."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.common.frames import Vec3
from mission.document.model import RadioTrunks, Sim
from mission.stand.stand import Stand, StandTree
from sim_bridge.trunk_attenuation import range_share
from sim_bridge.world.radio import QUEUE_LIMIT, Radio

FRAME = b"any bytes"


def radio(*, range_m: float = 30.0, loss: float = 0.0, delay_s: float = 0.0, seed: int = 1) -> Radio:
    return Radio(range_m=range_m, loss=loss, delay_s=delay_s, seed=seed)


def send(air: Radio, sender: int, frame: bytes, places: dict[int, Vec3], now_s: float) -> None:
    air.place(places)
    air.send(sender, frame, now_s)


def numbered(k: int) -> bytes:
    """Four bytes, which `frames` tells apart."""
    return k.to_bytes(4, "big")


def frames(data: bytes) -> list[bytes]:
    return [data[at : at + 4] for at in range(0, len(data), 4)]


def in_a_row(*north_m: float) -> dict[int, Vec3]:
    return {k: (x, 0.0, -8.0) for k, x in enumerate(north_m, start=1)}


CLOSE = in_a_row(0.0, 5.0, 10.0)


def test_frame_reaches_everyone_in_range_but_its_sender_unmodified() -> None:
    air = radio()
    places = in_a_row(0.0, 30.0, 30.001, -29.0)
    send(air, 1, FRAME, places, 0.0)
    assert {k: air.deliver(k, 0.0) for k in places} == {1: b"", 2: FRAME, 3: b"", 4: FRAME}
    assert air.deliver(2, 0.0) == b""  # once


def test_range_is_in_three_dimensions() -> None:
    air = radio()
    places = {1: (0.0, 0.0, 0.0), 2: (20.0, 20.0, -10.0), 3: (20.0, 20.0, -10.2)}
    send(air, 1, FRAME, places, 0.0)
    assert air.deliver(2, 0.0) != b""
    assert air.deliver(3, 0.0) == b""


@given(st.floats(1.0, 100.0), st.floats(1.0, 100.0), st.floats(0.0, 120.0))
@settings(max_examples=50)
def test_link_needs_both_ranges_so_it_is_the_same_both_ways(one_m: float, other_m: float, apart_m: float) -> None:
    air = radio(range_m=1000.0)
    places = in_a_row(0.0, apart_m)
    air.set_range(1, one_m)
    air.set_range(2, other_m)
    for k in places:
        send(air, k, FRAME, places, 0.0)
    back, there = air.deliver(1, 0.0), air.deliver(2, 0.0)
    assert bool(there) == bool(back) == (apart_m <= min(one_m, other_m))


def test_radio_has_the_given_range_until_it_is_set_to_another() -> None:
    air = radio(range_m=42.0)
    assert air.range_m(1) == 42.0
    air.set_range(1, 55.0)
    assert air.range_m(1) == 55.0
    assert air.range_m(2) == 42.0


# --- loss ---


def received(air: Radio, places: dict[int, Vec3], n: int = 400) -> dict[int, list[bool]]:
    """For each receiver of vehicle 1's beacons: which came through."""
    came: dict[int, list[bool]] = {k: [] for k in places if k != 1}
    for k in range(n):
        send(air, 1, numbered(k), places, float(k))
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
    sent = {k: numbered(k) for k in places}
    for k, one in sent.items():
        send(air, k, one, places, 0.0)
    assert [air.deliver(k, 0.0) for k in places] == [sent[2], sent[1], sent[4], sent[3]]
    air.cut_off = ()
    send(air, 1, sent[1], places, 0.0)
    assert air.deliver(4, 0.0) == sent[1]


def test_a_link_that_is_cut_is_that_link_alone_and_counts_as_missed() -> None:
    air = radio()
    places = in_a_row(0.0, 1.0, 2.0)
    air.cut_links = frozenset({(1, 2)})
    sent = {k: numbered(k) for k in places}
    for k, one in sent.items():
        send(air, k, one, places, 0.0)
    assert [air.deliver(k, 0.0) for k in places] == [sent[2] + sent[3], sent[3], sent[1] + sent[2]]
    assert [air.missed_share(k) for k in places] == [0.0, 0.5, 0.0]


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
        send(air, 1, FRAME, {1: CLOSE[1], 2: CLOSE[2]}, sent_s)
        assert air.deliver(2, sent_s - 1e-9) == b""
        delays.append(next(0.005 * j for j in range(1000) if air.deliver(2, sent_s + 0.005 * j)))
    assert max(delays) <= 0.4 + 0.005
    assert sum(delays) / len(delays) == pytest.approx(0.2, abs=0.02)
    assert min(delays) < 0.05


def test_frames_come_in_the_order_of_their_arrival_not_of_their_sending() -> None:
    air = radio(delay_s=1.0)
    sent = [numbered(k) for k in range(30)]
    for k, one in enumerate(sent):
        send(air, 1, one, CLOSE, 0.01 * k)
    arrived: list[bytes] = []
    for k in range(400):
        arrived += frames(air.deliver(2, 0.01 * k))
    assert sorted(arrived) == sorted(sent)
    assert arrived != sent


def test_frames_due_at_once_keep_the_order_of_their_sending() -> None:
    air = radio()
    sent = [numbered(k) for k in range(20)]
    for one in sent:
        send(air, 1, one, CLOSE, 0.0)
    assert air.deliver(2, 0.0) == b"".join(sent)


def test_queue_is_bounded_and_loses_the_oldest() -> None:
    air = radio()
    sent = [numbered(k) for k in range(QUEUE_LIMIT + 5)]
    for k, one in enumerate(sent):
        send(air, 1, one, CLOSE, 0.001 * k)
    assert frames(air.deliver(2, 1e6)) == sent[5:]


# --- where the radios are ---


def test_radios_are_where_they_were_placed_last() -> None:
    air = radio()
    send(air, 1, FRAME, in_a_row(0.0, 31.0), 0.0)
    assert air.deliver(2, 0.0) == b""
    send(air, 1, FRAME, in_a_row(0.0, 29.0), 0.0)
    assert air.deliver(2, 0.0) == FRAME


def test_a_radio_that_is_nowhere_hears_nothing() -> None:
    air = radio()
    send(air, 1, FRAME, {1: CLOSE[1], 3: CLOSE[3]}, 0.0)
    assert [air.deliver(k, 0.0) for k in CLOSE] == [b"", b"", FRAME]


@given(st.lists(st.tuples(*[st.floats(-40.0, 40.0)] * 3), min_size=2, max_size=9), st.data())
@settings(max_examples=50)
def test_each_frame_reaches_exactly_those_within_both_ranges(points: list[Vec3], data: st.DataObject) -> None:
    places = dict(enumerate(points, start=1))
    ranges_m = {k: data.draw(st.floats(1.0, 80.0)) for k in places}
    air = radio()
    for k, range_m in ranges_m.items():
        air.set_range(k, range_m)
    for sender in places:
        send(air, sender, numbered(sender), places, 0.0)
    for k, here in places.items():
        near = [j for j in places if j != k and math.dist(here, places[j]) <= min(ranges_m[j], ranges_m[k])]
        assert frames(air.deliver(k, 0.0)) == [numbered(j) for j in near]


def forest(*trunks: tuple[float, float], radius_m: float = 0.2) -> Stand:
    """Trunks of 20 m at these places, north and east."""
    return Stand([StandTree(east_m, north_m, radius_m, 20.0, 20.0, radius_m) for north_m, east_m in trunks])


def heard(model: str, stand: Stand, places: dict[int, Vec3], *, range_m: float = 30.0, db: float = 6.0) -> set[int]:
    """Who hears vehicle 1."""
    sim = Sim(radio_trunks=RadioTrunks(model), radio_trunk_db=db)
    air = Radio(range_m=range_m, loss=0.0, delay_s=0.0, seed=1, share=range_share(sim, stand))
    send(air, 1, FRAME, places, 0.0)
    return {k for k in places if air.deliver(k, 0.0)}


def test_one_trunk_across_cuts_a_link_halves_its_range_or_does_nothing() -> None:
    stand, places = forest((4.0, 0.0)), in_a_row(0.0, 10.0, 14.9, 15.1, 29.0, -29.0)
    assert heard("disc", stand, places) == {2, 3, 4, 5, 6}
    assert heard("attenuated", stand, places, db=20.0 * math.log10(2.0)) == {2, 3, 6}
    assert heard("cut", stand, places) == {6}


def test_each_trunk_across_takes_its_share_of_the_range() -> None:
    stand, places = forest((2.0, 0.0), (3.0, 0.0)), in_a_row(0.0, 7.4, 7.6, 15.0)
    assert heard("attenuated", stand, places, db=20.0 * math.log10(2.0)) == {2}
    assert heard("attenuated", stand, places, db=0.0) == {2, 3, 4}


def test_a_trunk_beside_the_line_or_below_it_takes_nothing() -> None:
    assert heard("cut", forest((5.0, 0.21)), in_a_row(0.0, 10.0)) == {2}
    assert heard("cut", forest((5.0, 0.19)), in_a_row(0.0, 10.0)) == set()
    for up_m, hear in ((19.75, set()), (19.85, {2}), (20.1, {2})):  # antennas are 0.2 m above
        above = {k: (north_m, east_m, -up_m) for k, (north_m, east_m, _) in in_a_row(0.0, 10.0).items()}
        assert heard("cut", forest((5.0, 0.0)), above) == hear


@settings(derandomize=True, deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=20), st.data())
def test_a_link_through_trunks_is_the_same_both_ways(trunks: list[tuple[float, float]], data: st.DataObject) -> None:
    place = st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-22, 0))
    share = range_share(Sim(radio_trunks=RadioTrunks.ATTENUATED), forest(*trunks))
    assert share is not None
    a, b = data.draw(place), data.draw(place)
    assert share(a, b) == share(b, a)


def test_trunks_change_no_draw_of_the_links_beside_them() -> None:
    places = {1: (0.0, 0.0, -3.0), 2: (10.0, 0.0, -3.0), 3: (0.0, 10.0, -3.0)}

    def heard_by_3(stand: Stand) -> bytes:
        share = range_share(Sim(radio_trunks=RadioTrunks.CUT), stand)
        air = Radio(range_m=30.0, loss=0.5, delay_s=0.1, seed=7, share=share)
        for k in range(50):
            send(air, 1, numbered(k), places, 0.1 * k)
        return air.deliver(3, 100.0)

    assert heard_by_3(forest((5.0, 0.0))) == heard_by_3(Stand())


def test_a_radio_that_moves_on_is_looked_at_anew() -> None:
    share = range_share(Sim(radio_trunks=RadioTrunks.CUT), forest((5.0, 0.0)))
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1, share=share)
    send(air, 1, FRAME, in_a_row(0.0, 10.0), 0.0)
    assert air.deliver(2, 0.0) == b""
    send(air, 1, FRAME, {1: (0.0, 0.0, -3.0), 2: (10.0, 1.0, -3.0)}, 0.1)
    assert air.deliver(2, 0.1) == FRAME


# --- what goes aside, and a slow channel ---


def test_beacons_are_lost_and_late_as_without_what_is_sent_aside() -> None:
    def heard(with_records: bool) -> list[bytes]:
        air = radio(loss=0.4, delay_s=0.1, seed=5)
        air.place(CLOSE)
        found = []
        for k in range(100):
            if with_records:
                air.send(1, b"side", k / 10.0, aside=True)
            air.send(1, numbered(k), k / 10.0)
            found.append(air.deliver(2, k / 10.0))
        return found

    beacons = [b"".join(part for part in frames(data) if part != b"side") for data in heard(True)]
    assert beacons == heard(False)


def slow_radio(kbps: float) -> Radio:
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1, bit_rate_kbps=kbps)
    air.place(CLOSE)
    return air


def test_a_frame_takes_its_time_on_a_slow_channel() -> None:
    air = slow_radio(8.0)  # a byte a millisecond
    air.send(1, bytes(84), 0.0)  # and 16 of the radio's own
    assert air.deliver(2, 0.099) == b""
    assert air.deliver(2, 0.1001) == bytes(84)


def test_frames_of_all_wait_for_one_another_on_a_slow_channel() -> None:
    air = slow_radio(8.0)
    air.send(1, b"\1" * 84, 0.0)
    air.send(2, b"\2" * 84, 0.0)
    assert air.deliver(3, 0.15) == b"\1" * 84
    assert air.deliver(3, 0.2001) == b"\2" * 84
    air.send(1, b"\3" * 84, 1.0)  # it is free again
    assert air.deliver(3, 1.1001) == b"\3" * 84


def test_what_would_wait_too_long_for_a_busy_channel_is_lost() -> None:
    air = slow_radio(8.0)
    for _ in range(100):
        air.send(1, bytes(84), 0.0)
    assert len(air.deliver(2, 1000.0)) == 11 * 84
