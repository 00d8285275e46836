"""Orders of the page of `companion watch` in a whole flight: over HTTP, by its key, to signed frames, to vehicles."""

from __future__ import annotations

import time

import pytest

from companion.core.model.states import FlightState
from companion.watch.orders.desk import Answer, Asked
from companion.watch.orders.radio import CHANGED, OrderClerk
from tests.scenario.signed_swarm import READY_S, SignedSwarm
from tests.unit.watch.page_orders_kit import body, ordering

pytestmark = pytest.mark.sources


def test_a_swarm_starts_holds_goes_on_and_aborts_by_the_page_and_by_nobody_else() -> None:
    swarm, lines = SignedSwarm(4), list[str]()
    clerk = OrderClerk(swarm.operator.station, 4, lines.append)

    def order(asked: Asked) -> Answer:  # the swarm stands still meanwhile
        return clerk.order(asked.order, asked.address, swarm.now_s)

    with ordering(order=order) as page:
        status, why = page.post(page.genuine("START", without=[1, 2, 3, 4]))
        assert status == 412  # nobody is heard yet
        swarm.until("READY", READY_S)
        swarm.run(2.0)
        assert clerk.picture(swarm.now_s) == {"ready": [1, 2, 3, 4], "missing": {}, "sent": None}
        status, why = page.post(page.genuine("START", without=[3]))  # the page is a look behind
        assert (status, CHANGED in why) == (412, True)
        swarm.run(3.0)
        assert set(swarm.states()) == {FlightState.READY}
        assert page.post(page.genuine("START"))[0] == 200
        swarm.until("TRANSIT", 60.0)
        swarm.run(1.0)

        recorded = page.genuine("HOLD")
        assert page.post(recorded)[0] == 200
        swarm.run(2.0)
        assert set(swarm.states()) == {FlightState.HOLD}
        sent = clerk.picture(swarm.now_s)["sent"]
        assert (sent["kind"], sent["acting"], sent["waits_for"]) == ("HOLD", [1, 2, 3, 4], [])
        assert page.post(page.genuine("START"))[0] == 200
        swarm.run(1.0)
        assert set(swarm.states()) == {FlightState.TRANSIT}

        nonce = page.key.nonce(time.monotonic())
        forged = [body("another key", nonce, "ABORT"), body(page.key.fragment, nonce, "ABORT")]
        assert [page.post(data)[0] for data in [recorded, *forged]] == [409, 403, 403]
        swarm.run(2.0)
        assert set(swarm.states()) == {FlightState.TRANSIT}

        assert page.post(page.genuine("ABORT"))[0] == 200
        swarm.run(0.5)
        assert set(swarm.states()) <= {FlightState.LANDING, FlightState.LANDED}
        swarm.until("LANDED", 30.0)
        assert clerk.picture(swarm.now_s)["sent"]["acting"] == [1, 2, 3, 4]
    told = ["START", "HOLD", "START", "ABORT"]
    assert lines == [f"{kind}: ordered on the page, from 127.0.0.1" for kind in told]
