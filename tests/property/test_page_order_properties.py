"""Whatever is sent as an order of the page: nothing raises, and nothing is ordered without the key."""

from __future__ import annotations

import json
from http import HTTPStatus

from hypothesis import given
from hypothesis import strategies as st

from companion.watch.orders.desk import OrderDesk
from companion.watch.orders.order_key import OrderKey
from companion.watch.orders.page_order import read_page_order
from tests.unit.watch.page_orders_kit import SIZE

HEX = st.text("0123456789abcdef", min_size=14, max_size=66)
SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
JSON = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner))
FIELDS = {
    "kind": st.sampled_from(["START", "HOLD", "LAND", "ABORT"]) | JSON,
    "hand_back": st.integers(-1, SIZE + 1) | JSON,
    "without": st.lists(st.integers(-1, SIZE + 1), max_size=5) | JSON,
    "nonce": HEX | JSON,
    "mac": HEX | JSON,
}
BODIES = (
    st.binary(max_size=200)
    | JSON.map(lambda said: json.dumps(said).encode())
    | st.fixed_dictionaries(FIELDS).map(lambda said: json.dumps(said).encode())
)


@given(BODIES)
def test_no_body_is_an_order_without_the_key(body: bytes) -> None:
    desk = OrderDesk(OrderKey(), SIZE, lambda: 100.0, wait_s=0.0)
    assert desk.answer_request(body, "10.0.0.1").status in (HTTPStatus.BAD_REQUEST, HTTPStatus.FORBIDDEN)
    assert not list(desk.take_asked())


@given(BODIES)
def test_what_is_read_is_within_the_mission_and_has_one_text(body: bytes) -> None:
    try:
        order = read_page_order(body, SIZE)
    except ValueError:
        return
    assert 0 <= order.hand_back <= SIZE
    assert all(1 <= vehicle <= SIZE for vehicle in order.without)
    assert order.text.count("\n") == 4
    assert order.text.splitlines()[1:3] == [order.nonce, order.kind.name]
