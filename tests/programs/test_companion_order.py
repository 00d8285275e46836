"""`companion order` as a program: an order of the key goes out, and its exit code says who acts on it."""

from __future__ import annotations

import hashlib
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink import mavutil

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
from mission.common.frames import LocalFrame, Wgs84
from tests.programs.companion_kit import MISSION
from tests.unit.core.core_kit import BEACON
from tests.unit.mavlink.orders_kit import Disk

LIMIT_S = 60.0
HERE = Wgs84(47.0, 8.0, 400.0)
mavlink = mavutil.mavlink


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission, and the keys of its fleet."""
    made = tmp_path_factory.mktemp("operator")
    (made / "m.toml").write_text(MISSION)
    arguments = ["companion", "key", "new", str(made / "fleet"), "--vehicles", "2"]
    subprocess.run([sys.executable, "-m", *arguments], check=True, capture_output=True, timeout=LIMIT_S)
    return made


def order(folder: Path, *words: str, key: str = "fleet/operator.key") -> list[str]:
    arguments = ["companion", "order", *words, "--key", str(folder / key), "--mission", str(folder / "m.toml")]
    return [sys.executable, "-m", *arguments]


class Vehicles:
    """Two vehicles in a thread of their own: they send beacons to the operator's port, and obey."""

    def __init__(self, folder: Path, port: int, *, deaf: int = 0, airborne: bool = True) -> None:
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
        self._port = port
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        now_s = 100.0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
            radio.connect(("127.0.0.1", self._port))
            while not self._stop.wait(0.05):  # as fast as the operator's clock, which all go by
                now_s += 0.05
                try:
                    for k in self._books:
                        radio.send(self._beacon(k, now_s))
                    while select.select([radio], [], [], 0.0)[0]:
                        data = radio.recv(2000)
                        for k, link in self._links.items():
                            if k != self._deaf or not whole(data) or whole(data)[0][2] != ORDER_ID:
                                link.read_datagram(data, now_s)
                except ConnectionRefusedError:  # the program is not there yet, or not any more
                    continue

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


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        number: int = found.getsockname()[1]
        return number


@pytest.fixture
def vehicles(folder: Path, port: int) -> Iterator[Vehicles]:
    made = Vehicles(folder, port)
    yield made
    made.close()


def run(arguments: list[str]) -> tuple[int, str, str]:
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=LIMIT_S, stdin=subprocess.DEVNULL)
    return done.returncode, done.stdout, done.stderr


def test_abort_and_hold_reach_all_and_the_exit_code_says_so(folder: Path, port: int, vehicles: Vehicles) -> None:
    peers = ["--peers", f"udpin://127.0.0.1:{port}"]
    code, out, err = run(order(folder, "hold", *peers))
    assert (code, out, err) == (0, "HOLD: acting on it: 1, 2\n", "")
    code, out, err = run(order(folder, "abort", *peers))
    assert (code, out, err) == (0, "ABORT: acting on it: 1, 2\n", "")
    assert vehicles.obeyed == {1: [Order.HOLD, Order.ABORT], 2: [Order.HOLD, Order.ABORT]}
    assert (folder / "fleet" / "operator.key.orders").stat().st_mode & 0o777 == 0o600


def test_vehicle_that_does_not_act_is_named_and_costs_the_exit_code(folder: Path, port: int) -> None:
    vehicles = Vehicles(folder, port, deaf=2)
    try:
        code, out, _ = run(order(folder, "abort", "--peers", f"udpin://127.0.0.1:{port}", "--for-s", "3"))
    finally:
        vehicles.close()
    assert code == 1
    assert out == "ABORT: acting on it: 1\nABORT: heard, and not acting on it: 2\n"


def test_start_names_the_boots_that_are_proven_and_says_who_is_ready(folder: Path, port: int) -> None:
    vehicles = Vehicles(folder, port, airborne=False)
    try:
        code, out, err = run(order(folder, "start", "--yes", "--peers", f"udpin://127.0.0.1:{port}"))
    finally:
        vehicles.close()
    assert (code, out, err) == (0, "ready: 1, 2\nSTART: acting on it: 1, 2\n", "")
    assert vehicles.obeyed == {1: [Order.START], 2: [Order.START]}


def test_nobody_heard_is_no_success(folder: Path, port: int) -> None:
    code, out, _ = run(order(folder, "abort", "--peers", f"udpin://127.0.0.1:{port}", "--for-s", "0.2"))
    assert (code, out) == (1, "ABORT: nobody is heard to act on it\n")
    code, _, err = run(order(folder, "start", "--yes", "--peers", f"udpin://127.0.0.1:{port}"))
    assert (code, err) == (1, "companion: no vehicle is heard: nothing was ordered\n")


def test_start_without_a_terminal_and_without_yes_is_not_ordered(folder: Path, port: int, vehicles: Vehicles) -> None:
    code, _, err = run(order(folder, "start", "--peers", f"udpin://127.0.0.1:{port}"))
    assert code == 2
    assert err == "companion: a start is confirmed at a terminal, or with --yes: nothing was ordered\n"
    assert vehicles.obeyed == {1: [], 2: []}


def test_key_of_a_vehicle_is_refused(folder: Path, port: int) -> None:
    peers = ["--peers", f"udpin://127.0.0.1:{port}"]
    code, _, err = run(order(folder, "abort", *peers, key="fleet/vehicle-1.key"))
    assert code == 2
    assert "owner: is vehicle 1: must be the operator" in err


def test_ground_station_orders_through_the_gateway(folder: Path, port: int, vehicles: Vehicles) -> None:
    """pymavlink's mavutil, as QGroundControl or MAVProxy would."""
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255, dialect="common")
    ground = station.port.getsockname()[1]
    words = ["gateway", "--peers", f"udpin://127.0.0.1:{port}", "--ground-station", f"udpout://127.0.0.1:{ground}"]
    gateway = subprocess.Popen(order(folder, *words), stdout=subprocess.PIPE, text=True)
    try:
        assert gateway.stdout is not None
        assert gateway.stdout.readline().startswith("orders of udpout://127.0.0.1:")
        beat = station.recv_match(type="HEARTBEAT", blocking=True, timeout=LIMIT_S)
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (253, 191)
        station.mav.command_long_send(1, 191, mavlink.MAV_CMD_DO_PAUSE_CONTINUE, 0, *(0.0,) * 7)
        ack = station.recv_match(type="COMMAND_ACK", blocking=True, timeout=LIMIT_S)
        assert (ack.get_srcSystem(), ack.command, ack.result) == (1, 193, mavlink.MAV_RESULT_ACCEPTED)
        assert gateway.stdout.readline() == "HOLD: ordered\n"
        while not (vehicles.obeyed[1] and vehicles.obeyed[2]):
            assert gateway.poll() is None
            assert station.recv_match(type="HEARTBEAT", blocking=True, timeout=LIMIT_S) is not None
        gateway.send_signal(signal.SIGINT)
        assert gateway.wait(LIMIT_S) == 0
    finally:
        gateway.kill()
        gateway.wait()
        gateway.stdout.close()
        station.close()
    assert vehicles.obeyed == {1: [Order.HOLD], 2: [Order.HOLD]}
