"""Two vehicles of a signed swarm on a UDP port, beside programs of the operator, and the files of both."""

from __future__ import annotations

import hashlib
import socket
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

from companion.core.model.states import FlightState, Order
from companion.keys.key_file import load_keyring
from companion.mavlink.beacon import Reader, encode
from companion.mavlink.framing.frames import whole
from companion.mavlink.orders.book import OrderBook
from companion.mavlink.orders.desk import SignedOrders
from companion.mavlink.orders.order import ORDER_ID
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.peers_link import PeersLink
from companion.mavlink.peers.session import open_session
from companion.shell.links import open_link
from companion.shell.urls import PEERS_SCHEMES, parse_url
from mission.common.frames import LocalFrame, Wgs84
from tests.programs.companion_kit import MISSION
from tests.unit.core.core_kit import BEACON
from tests.unit.mavlink.orders_kit import Disk

LIMIT_S = 60.0
HERE = Wgs84(47.0, 8.0, 400.0)


def make_fleet(folder: Path) -> Path:
    """A mission, and the keys of its fleet, in `folder`."""
    (folder / "m.toml").write_text(MISSION)
    arguments = ["companion", "key", "new", str(folder / "fleet"), "--vehicles", "2"]
    subprocess.run([sys.executable, "-m", *arguments], check=True, capture_output=True, timeout=LIMIT_S)
    return folder


def free_port() -> int:
    """Of UDP, on loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        number: int = found.getsockname()[1]
        return number


class Vehicles:
    """Two vehicles in a thread of their own: they send beacons to the operator's port, and obey.

    `url`: of their link instead, where more than one program hears them.
    """

    def __init__(self, folder: Path, port: int, *, deaf: int = 0, airborne: bool = True, url: str = "") -> None:
        digest = hashlib.sha256((folder / "m.toml").read_bytes()).digest()
        self._books: dict[int, OrderBook] = {}
        self._links: dict[int, PeersLink] = {}
        reader = Reader(LocalFrame(HERE))
        for k in (1, 2):
            keyring = load_keyring(folder / "fleet" / f"vehicle-{k}.key", k)
            book = OrderBook(operator=keyring.operator, digest=digest, me=k, size=2, boot=k, marks=Disk())
            guard = SignedGuard(open_session(keyring, k, digest, k))
            self._books[k] = book
            self._links[k] = PeersLink(k, reader, guard, None, SignedOrders(book), ranging=False)
        self._deaf, self._airborne = deaf, airborne
        self.obeyed: dict[int, list[Order]] = {1: [], 2: []}
        self._radio = open_link(parse_url(url or f"udpout://127.0.0.1:{port}", PEERS_SCHEMES))
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._radio.close()

    def _run(self) -> None:
        now_s = 100.0
        while not self._stop.wait(0.05):  # as fast as the operator's clock, which all go by
            now_s += 0.05
            for k in self._books:
                self._radio.send(self._beacon(k, now_s))
            while (data := self._radio.recv()) is not None:
                for k, link in self._links.items():
                    if k != self._deaf or not whole(data) or whole(data)[0][2] != ORDER_ID:
                        link.read_datagram(data, now_s)

    def _beacon(self, vehicle: int, now_s: float) -> bytes:
        book, link, obeyed = self._books[vehicle], self._links[vehicle], self.obeyed[vehicle]
        obeyed += [event.order for event in book.tick(now_s, airborne=self._airborne)]
        states = {Order.HOLD: FlightState.HOLD} if self._airborne else {}
        state = states.get(obeyed[-1] if obeyed else Order.START, FlightState.TRANSIT)
        said = replace(
            BEACON,
            sender=vehicle,
            time_ms=round(now_s * 1e3),
            airborne=self._airborne,
            state=state if self._airborne else FlightState.READY,
            start=Order.START in obeyed,
            abort=Order.ABORT in obeyed,
        )
        frames = link.send_beacon(said, encode(said, HERE), None, now_s)
        return b"".join([*frames, *link.prove(now_s), *link.send_orders(now_s)])
