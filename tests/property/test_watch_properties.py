"""Whatever is sent to `companion watch`: nothing raises, and what is shown can be sent to its page."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import BEACON_PAYLOAD
from companion.mavlink.relative import RELATIVE_ID
from companion.mavlink.schema.rows import Field
from companion.mavlink.schema.tables.beacon import BEACON
from companion.watch.command import view
from companion.watch.heard import Heard
from tests.flights import short_mission

MISSION = short_mission(fence={"polygon_enu_m": ((-50, -70), (-50, 70), (70, 70), (70, -70))})
INTEGERS = {
    "uint8_t": (0, 2**8 - 1),
    "uint16_t": (0, 2**16 - 1),
    "uint32_t": (0, 2**32 - 1),
    "int32_t": (-(2**31), 2**31 - 1),
}


def value(field: Field, *, believed: bool) -> st.SearchStrategy[float | bytes]:
    """Of the wire; `believed`: one that a receiver takes."""
    if field.type == "float":
        if believed:
            return st.floats(max(field.least, -(2.0**99)), min(field.most, 2.0**99), width=32)
        return st.floats(width=32)
    if field.type in INTEGERS:
        low, high = INTEGERS[field.type]
        if believed and field.is_checked:
            low, high = int(max(low, field.least)), int(min(high, field.most))
        return st.integers(low, high)
    return st.binary(min_size=96, max_size=96)


@st.composite
def beacons(draw: st.DrawFn) -> bytes:
    believed = draw(st.booleans())
    fields = [draw(value(field, believed=believed)) for field in BEACON.on_wire]
    sender = wire.Sender(draw(st.integers(0, 255)), draw(st.sampled_from((191, 1))))
    return sender.frame(swarm_beacon.MESSAGE_ID, BEACON_PAYLOAD.pack(*fields))


@st.composite
def words(draw: st.DrawFn) -> bytes:
    sender = wire.Sender(draw(st.integers(0, 255)), 191)
    return sender.frame(RELATIVE_ID, draw(st.binary(min_size=152, max_size=152)))


DATAGRAMS = st.lists(st.one_of(beacons(), words(), st.binary(max_size=300)), max_size=8)


@given(DATAGRAMS, st.floats(0.0, 1e9))
def test_no_datagram_raises_and_every_picture_is_json_without_infinities(
    datagrams: list[bytes], later_s: float
) -> None:
    heard = Heard()
    for number, data in enumerate(datagrams):
        heard.receive_datagram(data, number / 10.0)
        for mission in (None, MISSION):
            json.dumps(view(heard, mission, number / 10.0), allow_nan=False)
    shown = view(heard, MISSION, 1.0 + later_s)
    json.dumps(shown, allow_nan=False)
    assert len(shown["vehicles"]) <= len(datagrams)
