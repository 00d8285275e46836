"""The loop's end: the operator's station hears and sends beside the page, and orders what the page has proven."""

from __future__ import annotations

import select
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final

from companion.mavlink.orders.order import OrderKind
from companion.order.radio import OperatorRadio
from companion.order.station import OperatorStation, OrderFileError, list_ids, reason_of
from companion.shell.floods import FloodLog
from companion.watch.orders.desk import Answer, Asked, OrderDesk
from companion.watch.orders.page_order import PageOrder

CHANGED: Final = "other vehicles are ready than the page had shown: look again"


@dataclass(frozen=True, slots=True)
class _Sent:
    kind: OrderKind
    hand_back: int
    number: int
    at_s: float


class OrderClerk:
    """Gives the station what the page asks for, and tells the page who acts on it. No sockets; `now_s`: local clock."""

    def __init__(self, station: OperatorStation, size: int, show: Callable[[str], None]) -> None:
        """`size`: of the mission's swarm. `show`: takes a line for the terminal."""
        self._station, self._size, self._show = station, size, show
        self._sent: _Sent | None = None

    def order(self, asked: PageOrder, address: str, now_s: float) -> Answer:
        """Begins to send it. A START goes only without those that the page had named: who has become ready since, and
        whom nobody expects to take off, does not."""
        kind = asked.kind
        if kind is OrderKind.START and {*asked.without} != {*self._station.not_ready(now_s)}:
            return Answer(HTTPStatus.PRECONDITION_FAILED, CHANGED)
        if kind is OrderKind.START and not self._station.vehicles(now_s):
            return Answer(HTTPStatus.PRECONDITION_FAILED, "no vehicle is heard: nothing was ordered")
        try:
            warning = self._station.send_order(kind, now_s, hand_back=asked.hand_back)
        except (OSError, OrderFileError) as error:
            why = reason_of(error)
            self._show(f"{kind.name}: its count cannot be written: {why}: nothing was ordered")
            return Answer(HTTPStatus.INTERNAL_SERVER_ERROR, f"its count cannot be written: {why}: nothing was ordered")
        if warning:
            self._show(warning)
        number = 1 if self._sent is None else self._sent.number + 1
        self._sent = _Sent(kind, asked.hand_back, number, now_s)
        without = f", without {list_ids(asked.without)}" if asked.without else ""
        handed = f", and vehicle {asked.hand_back} handed back" if asked.hand_back else ""
        self._show(f"{kind.name}{without}{handed}: ordered on the page, from {address}")
        return Answer(HTTPStatus.OK)

    def picture(self, now_s: float) -> dict[str, Any]:
        """For the page: who would start, and how far the last order is."""
        station = self._station
        missing = station.not_ready(now_s)
        ready = [k for k in range(1, self._size + 1) if k not in missing]
        return {"ready": ready, "missing": missing, "sent": self._progress(now_s)}

    def _progress(self, now_s: float) -> dict[str, Any] | None:
        sent = self._sent
        if sent is None:
            return None
        heard, waits_for = self._station.vehicles(now_s), self._station.waits_for(now_s)
        aborted = self._station.overruled(now_s)
        return {
            "kind": sent.kind.name,
            "hand_back": sent.hand_back,
            "number": sent.number,
            "age_s": now_s - sent.at_s,
            "acting": [k for k in heard if k not in waits_for and k not in aborted],
            "aborted": aborted,
            "waits_for": waits_for,
            "not_heard": [k for k in range(1, self._size + 1) if k not in heard],
        }


class OrderingReceiver:
    """In place of a `UdpReceiver`: what it receives the station has heard, and meanwhile it sends what is due."""

    def __init__(self, radio: OperatorRadio, clerk: OrderClerk, desk: OrderDesk, show: Callable[[str], None]) -> None:
        """`show`: takes a line for the terminal."""
        self._radio, self._clerk, self._desk, self._show = radio, clerk, desk, show
        self._floods = FloodLog({"radio": radio.link}, lambda _now_s, text, _is_over: show(text))

    def receive_datagrams(self, wait_s: float) -> Iterator[bytes]:
        """One turn, which waits so long at most."""
        radio = self._radio
        until_due_s = max(0.0, radio.due_s - time.monotonic())
        select.select((radio.link.fileno(),), (), (), min(wait_s, until_due_s))
        now_s = time.monotonic()
        heard: list[bytes] = []
        radio.hear_radio(now_s, heard.append)
        for asked in self._desk.take_asked():
            asked.answer.set_result(self._order(asked, now_s))
        radio.send_due(now_s, self._floods, self._show)
        yield from heard

    def picture(self, now_s: float) -> dict[str, Any]:
        """All that the page is told of orders."""
        return {**self._desk.picture(), **self._clerk.picture(now_s)}

    def _order(self, asked: Asked, now_s: float) -> Answer:
        return self._clerk.order(asked.order, asked.address, now_s)
