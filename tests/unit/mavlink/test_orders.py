"""SWARM_ORDER on the wire: what its signature covers, and which boots it names."""

from __future__ import annotations

import hashlib
from typing import Any

import pytest

from companion.keys.crypto import Signer, Verifier, public_key
from companion.mavlink import dialect
from companion.mavlink.orders.desk import SignedOrders
from companion.mavlink.orders.order import (
    ORDER_ID,
    OrderKind,
    boot_bits,
    names_boot,
    order_holds,
    order_payload,
    pack_boots,
    read_order,
)
from companion.mavlink.orders.repeats import SLACK_S, Repeats
from tests.unit.mavlink.orders_kit import BOOTS, FLIGHT, OPERATOR_SEED, VEHICLE_SEED, frame, order

OPERATOR = Verifier(public_key(OPERATOR_SEED))


def test_order_comes_through_a_frame_as_it_was_made() -> None:
    payload = order(OrderKind.HOLD, (1 << 64) - 1, hand_back=3)
    read = order_payload(frame(payload))
    assert read == payload
    said = read_order(payload)
    assert said is not None
    assert (said.kind, said.counter, said.flight, said.hand_back) == (OrderKind.HOLD, (1 << 64) - 1, FLIGHT, 3)
    assert order_holds(payload, OPERATOR)


def test_pymavlink_reads_the_same_fields() -> None:
    payload = order(OrderKind.ABORT, 77)
    said = dialect.MAVLink(None).parse_buffer(frame(payload))[0]
    assert (said.order_counter, said.order_kind, bytes(said.flight_nonce)) == (77, 4, FLIGHT)


def test_every_byte_is_signed() -> None:
    payload = order(OrderKind.START, 5)
    for at in range(len(payload)):
        for bit in (1, 128):
            changed = payload[:at] + bytes([payload[at] ^ bit]) + payload[at + 1 :]
            assert not order_holds(changed, OPERATOR), at


def test_key_of_a_vehicle_makes_no_order() -> None:
    assert not order_holds(order(OrderKind.START, 5, seed=VEHICLE_SEED), OPERATOR)


@pytest.mark.parametrize("size", [1, 2, 12, 41, 42, 50, 164, 250])
def test_each_vehicle_is_named_by_its_own_boot(size: int) -> None:
    boots = {k: 0xFFFFFFFF - 7919 * k for k in range(1, size + 1, 2)}
    packed = pack_boots(boots, size)
    for k in range(1, size + 1):
        if k in boots:
            assert names_boot(packed, k, size, boots[k])
            assert not names_boot(packed, k, size, boots[k] + 1)
        else:
            assert not any(names_boot(packed, k, size, boot) for boot in (1, 2, 31, 32, 0xFFFFFFFF))


def test_a_boot_has_32_bits_up_to_41_vehicles_and_5_of_250() -> None:
    assert [boot_bits(size) for size in (1, 41, 42, 50, 250)] == [32, 32, 31, 26, 5]


@pytest.mark.parametrize("value", [0, 5, 255])
def test_kind_that_is_none_is_no_order(value: int) -> None:
    payload = order(OrderKind.START, 5)
    assert read_order(payload[:25] + bytes([value]) + payload[26:]) is None


def test_order_of_another_version_or_without_a_count_is_none() -> None:
    payload = order(OrderKind.START, 5)
    assert read_order(payload[:24] + b"\2" + payload[25:]) is None
    assert read_order(bytes(8) + payload[8:]) is None
    assert read_order(payload[:-1]) is None


def test_boots_of_no_vehicle_of_the_swarm_are_left_out() -> None:
    assert pack_boots({0: 5, 5: 6, 300: 7}, 4) == bytes(164)
    assert names_boot(pack_boots(BOOTS, 4), 4, 4, BOOTS[4])


def test_what_the_key_signs_for_another_purpose_is_no_order() -> None:
    """The same fields, without the words that begin an order."""
    payload = order(OrderKind.START, 5)
    signature = Signer(OPERATOR_SEED).sign(payload[:27] + payload[91:])
    assert not order_holds(payload[:27] + signature + payload[91:], OPERATOR)
    with_words = Signer(OPERATOR_SEED).sign(b"understory order 1" + payload[:27] + payload[91:])
    assert payload[27:91] == with_words


def test_order_is_the_same_bytes_as_in_every_later_release() -> None:
    """Another layout, or another signed part, is not understood by companions in the field."""
    assert hashlib.sha256(order(OrderKind.START, 5)).hexdigest()[:32] == "d91bd773fc8912216264edb46be02a74"
    assert (ORDER_ID, dialect.MAVLink_swarm_order_message.crc_extra) == (52106, 87)


class Kept:
    """A book that keeps what it is handed."""

    def __init__(self) -> None:
        self.calls: list[tuple[bytes, float, bool]] = []

    def receive(self, frame: bytes, now_s: float, *, is_proven: bool = False) -> bool:
        self.calls.append((frame, now_s, is_proven))
        return True


@pytest.mark.sources
@pytest.mark.parametrize("is_proven", [True, False])
def test_desk_hands_frames_to_the_book_with_the_links_word(*, is_proven: bool) -> None:
    book: Any = Kept()
    assert SignedOrders(book).receive(b"frame", 7.0, is_proven=is_proven)
    assert book.calls == [(b"frame", 7.0, is_proven)]


def test_an_order_is_sent_twice_a_tick_then_with_each_period_then_once_a_second() -> None:
    repeats = Repeats(10.0)
    sent = [(k, repeats.copies(10.0 + 0.05 * k)) for k in range(121)]
    assert [copies for k, copies in sent if k < 10] == [2] * 10
    assert [k for k, copies in sent if 10 <= k < 40 and copies] == list(range(11, 40, 2))
    assert [copies for k, copies in sent if k >= 10 and copies] == [1] * len([k for k, c in sent if k >= 10 and c])
    assert [k for k, copies in sent if k >= 40 and copies] == [59, 79, 99, 119]
    anew = Repeats(late_period_s=5.0)
    assert [anew.copies(0.0), anew.copies(4.0), anew.copies(5.0 - SLACK_S - 1e-6)] == [1, 0, 0]
    assert anew.copies(5.0) == 1
