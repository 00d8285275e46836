"""Bytes of the radio never raise, and never change what is stored."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.base.station import BaseStation
from companion.mavlink.beacon import COMPONENT
from companion.mavlink.framing import wire
from companion.records.exchange import RecordExchange
from companion.records.frames import RECORD_ID, VECTOR_ID
from companion.records.record import BASE_ID, RecordKind
from companion.records.signed.exchange import SignedExchange
from companion.records.signed.messages import BASE_VECTOR_ID, SIGNED_RECORD_ID
from companion.records.store import MEMORY, RecordStore
from companion.records.write_queue import DirectWriter
from tests.unit.records.signed_kit import keys_of


def node(me: int, *, signed: bool = False) -> RecordExchange:
    keys = keys_of(me) if signed else None
    store = RecordStore(MEMORY, me, lambda: 7, keys=keys)
    common = (store, DirectWriter(store), me, 3, 1000.0)
    exchange = RecordExchange(*common, epoch=1) if keys is None else SignedExchange(*common, keys=keys, epoch=1)
    if me != BASE_ID:
        exchange.append(RecordKind.STEM, b"mine", 0.0)
    exchange.frames(0.0, 0)
    return exchange


payloads = st.tuples(
    st.sampled_from((RECORD_ID, VECTOR_ID, SIGNED_RECORD_ID, BASE_VECTOR_ID)),
    st.one_of(
        st.binary(min_size=255, max_size=255),
        # near what is valid: a log that is there, small numbers
        st.builds(
            lambda head, rest: (head + rest).ljust(255, b"\0"),
            st.binary(max_size=8),
            st.lists(st.sampled_from((0, 1, 2, 3, 7, 255)), max_size=247).map(bytes),
        ),
    ),
    st.sampled_from((0, 1, 2, 3, 4, 251, BASE_ID, 255)),
)


@settings(max_examples=200, deadline=None)
@given(st.lists(payloads, max_size=12), st.booleans())
def test_any_valid_frames_leave_the_own_log_as_it_is(frames: list[tuple[int, bytes, int]], signed: bool) -> None:
    one = node(1, signed=signed)
    base = BaseStation(node(BASE_ID, signed=signed))
    for k, (message_id, payload, sender) in enumerate(frames):
        if message_id == VECTOR_ID:
            payload = payload[:4] + bytes(4) + payload[4:237]  # of this mission: another's would be ignored
        if message_id == BASE_VECTOR_ID:
            payload = payload[:12] + bytes(4) + payload[12:245]
        frame = wire.frame(message_id, payload, seq=k, system=sender, component=COMPONENT)
        one.receive(frame, float(k))
        one.frames(float(k), 0)
        one.lines()
        base.receive(frame, float(k))
        base.tick(float(k))
    own = [
        body for vehicle_id, number, _, body in one.store.records(RecordKind.STEM) if vehicle_id == 1 and number == 1
    ]
    assert b"mine" in own
    assert sum(one.acked.get(key, 0) for key in one.acked if key == one.store.own_log) <= 1
    if signed:
        assert one.acked == {}
        assert {row[:2] for row in one.store.rows()} == {one.store.own_log}
        assert base.records.store.rows() == []


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=600))
def test_any_bytes_are_passed_over(data: bytes) -> None:
    one = node(1)
    one.receive(data, 0.0)
    BaseStation(node(BASE_ID)).receive(data, 0.0)
