"""Between the server's threads and the loop that has the radio: who asks for an order proves it, and waits for it.

A wrong MAC costs its sender alone: however many come, a genuine order is looked at, so nobody locks the operator out.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Final

from companion.watch.orders.order_key import Nonce, OrderKey
from companion.watch.orders.page_order import PageOrder, read_page_order

WAITING_MAX: Final = 16  # for the loop, which takes all of them in a turn
WAIT_S: Final = 5.0  # for the loop's answer; it turns 20 times a second
WRONG_MAX: Final = 8  # wrong MACs that are answered in words
WRONG_S: Final = 10.0  # within so long
WRONG_KEY: Final = "wrong key: open the whole address that `companion watch --orders` prints"


@dataclass(frozen=True, slots=True)
class Answer:
    """`why`: for whoever asked; empty: it was ordered. `notice`: for the terminal, or empty."""

    status: HTTPStatus
    why: str = ""
    notice: str = ""


@dataclass(frozen=True, slots=True)
class Asked:
    """A genuine order, and where its answer is waited for."""

    order: PageOrder
    address: str
    answer: Future[Answer] = field(default_factory=Future)


class OrderDesk:
    """`answer_request` for any thread, `take_asked` for the loop."""

    def __init__(self, key: OrderKey, size: int, clock: Callable[[], float], *, wait_s: float = WAIT_S) -> None:
        """`size`: of the mission's swarm. `clock`: s."""
        self._key, self._size, self._clock, self._wait_s = key, size, clock, wait_s
        self._asked: queue.Queue[Asked] = queue.Queue(WAITING_MAX)
        self._wrong_s: deque[float] = deque(maxlen=WRONG_MAX)
        self._lock = threading.Lock()  # of the last

    @property
    def fragment(self) -> str:
        """Of the page's address. A secret."""
        return self._key.fragment

    def nonce(self) -> str:
        """The newest."""
        return self._key.nonce(self._clock())

    def picture(self) -> dict[str, str]:
        """Values by which a page proves an order, and sees that its key is the right one."""
        return {"check": self._key.check, "nonce": self.nonce()}

    def answer_request(self, body: bytes, address: str) -> Answer:
        """An order's body, from this address. Waits until the loop has ordered it, or refused."""
        try:
            order = read_page_order(body, self._size)
        except ValueError as error:
            return Answer(HTTPStatus.BAD_REQUEST, str(error))
        if not self._key.proves(order.text, order.mac):
            return self._refuse_wrong()
        state = self._key.use_nonce(order.nonce, self._clock())
        if state is not Nonce.FRESH:
            notice = f"{order.kind.name}: the same request a second time" if state is Nonce.USED else ""
            return Answer(HTTPStatus.CONFLICT, "the nonce is used or too old: again with a new one", notice)
        asked = Asked(order, address)
        try:
            self._asked.put_nowait(asked)
            return asked.answer.result(self._wait_s)
        except (queue.Full, TimeoutError):
            if asked.answer.cancel():
                return Answer(HTTPStatus.SERVICE_UNAVAILABLE, "the computer is too busy: nothing was ordered")
            return asked.answer.result()  # it was taken at this moment

    def take_asked(self) -> Iterator[Asked]:
        """Yield orders that wait, and that nobody has given up; each is to be answered."""
        while True:
            try:
                asked = self._asked.get_nowait()
            except queue.Empty:
                return
            if asked.answer.set_running_or_notify_cancel():
                yield asked

    def _refuse_wrong(self) -> Answer:
        now_s = self._clock()
        with self._lock:
            is_many = len(self._wrong_s) == WRONG_MAX and now_s - self._wrong_s[0] < WRONG_S
            if not is_many:
                self._wrong_s.append(now_s)
        status = HTTPStatus.TOO_MANY_REQUESTS if is_many else HTTPStatus.FORBIDDEN
        return Answer(status, "" if is_many else WRONG_KEY, "an order with a wrong key")
