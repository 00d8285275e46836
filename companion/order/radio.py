"""The operator's station on the swarm's radio, opened by its key: heard and sent in the turns of a program's loop."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Final

from companion.keys.key_file import load_keyring
from companion.keys.keyring import OPERATOR
from companion.keys.process import harden_process
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.session import OPERATOR_ID
from companion.order.order_file import SUFFIX, OperatorFile
from companion.order.station import OperatorStation, OrderFileError, reason_of
from companion.shell.floods import FloodLog
from companion.shell.links import Link, open_link
from companion.shell.radio_keys import mission_digest, open_radio_session
from companion.shell.urls import Url

TICK_S: Final = 0.05
READS_MAX: Final = 512  # datagrams before the next turn,
READS_S: Final = 0.03  # and for how long: a flood keeps no order waiting


class OperatorRadio:
    """A station and its link. `hear_radio` and `send_due` in each turn, the next one at `due_s` at the latest."""

    def __init__(self, station: OperatorStation, link: Link, *, knows_flight: bool, trouble: str = "") -> None:
        """`knows_flight`: this mission was started with this key before. `trouble`: of the count; or none."""
        self.station: Final = station
        self.link: Final = link
        self.knows_flight: Final = knows_flight
        self.trouble: Final = trouble
        self.due_s = time.monotonic()

    def hear_radio(self, now_s: float, also: Callable[[bytes], object] = lambda _data: None) -> None:
        """Datagrams that have come, to the station, and to `also`."""

        def receive(data: bytes, at_s: float) -> None:
            self.station.receive(data, at_s)
            also(data)

        drain(self.link, receive, now_s)

    def send_due(self, now_s: float, floods: FloodLog, show: Callable[[str], None]) -> None:
        """Sends what is due; `show`: takes the station's lines."""
        if now_s < self.due_s:
            return
        self.due_s = max(self.due_s + TICK_S, now_s)
        for datagram in self.station.datagrams(now_s):
            self.link.send(datagram)
        for line in self.station.lines():
            show(line)
        floods.update(now_s)


def open_operator(key: str, mission: str, size: int, peers: Url, opened: ExitStack) -> OperatorRadio:
    """`key`, `mission`: files. The process has no core dump from now on. KeyFileError, LinkError."""
    harden_process()
    keyring = load_keyring(key, OPERATOR)
    digest = mission_digest(mission)
    file = OperatorFile(Path(f"{key}{SUFFIX}"), lambda: time.time_ns() // 1_000_000)
    knows_flight, trouble = False, ""
    try:
        knows_flight = file.knows_flight(digest)
    except (OSError, OrderFileError) as error:  # what only stops goes out all the same
        trouble = f"the count of orders cannot be read: {reason_of(error)}: no START can be ordered"
    link = open_radio_link(peers, opened)
    guard = SignedGuard(open_radio_session(keyring, OPERATOR_ID, mission))
    station = OperatorStation(keyring.seed, digest, size, file=file, draw=secrets.token_bytes, guard=guard)
    return OperatorRadio(station, link, knows_flight=knows_flight, trouble=trouble)


def open_radio_link(url: Url, opened: ExitStack) -> Link:
    """A link that hears everybody, closed with `opened`. LinkError."""
    link = open_link(url, hears_all=True)
    opened.callback(link.close)
    return link


def drain(link: Link, receive: Callable[[bytes, float], None], now_s: float) -> None:
    """Hand over the datagrams that have come on a link, within the bounds of a turn."""
    until_s = time.monotonic() + READS_S
    for _ in range(READS_MAX):
        data = link.recv()
        if data is None:
            return
        receive(data, now_s)
        if time.monotonic() >= until_s:
            return
