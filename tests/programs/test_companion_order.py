"""`companion order` as a program: an order of the key goes out, and its exit code says who acts on it."""

from __future__ import annotations

import os
import pty
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil

from companion.core.model.states import Order
from tests.programs.operated_kit import LIMIT_S, Vehicles, free_port, make_fleet

mavlink = mavutil.mavlink


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mission, and the keys of its fleet."""
    return make_fleet(tmp_path_factory.mktemp("operator"))


def order(folder: Path, *words: str, key: str = "fleet/operator.key") -> list[str]:
    arguments = ["companion", "order", *words, "--key", str(folder / key), "--mission", str(folder / "m.toml")]
    return [sys.executable, "-m", *arguments]


@pytest.fixture
def port() -> int:
    return free_port()


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


def test_a_land_after_an_abort_is_told_as_what_it_is(folder: Path, port: int, vehicles: Vehicles) -> None:
    peers = ["--peers", f"udpin://127.0.0.1:{port}"]
    assert run(order(folder, "abort", *peers))[0] == 0
    code, out, err = run(order(folder, "land", *peers))
    assert (code, out, err) == (0, "LAND: ABORT stays in force, which is above it: 1, 2\n", "")
    assert len(vehicles.obeyed) == 2


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


@pytest.mark.parametrize(("kind", "airborne"), [("start", False), ("abort", True)])
def test_order_is_sent_though_nobody_reads_what_is_told(folder: Path, port: int, kind: str, airborne: bool) -> None:
    """A pager that was closed."""
    vehicles = Vehicles(folder, port, airborne=airborne)
    reader, writer = os.pipe()
    os.close(reader)
    words = [kind, *(["--yes"] if kind == "start" else []), "--peers", f"udpin://127.0.0.1:{port}"]
    try:
        done = subprocess.run(
            order(folder, *words),
            stdout=writer,
            stderr=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            timeout=LIMIT_S,
        )
    finally:
        os.close(writer)
        vehicles.close()
    assert (done.returncode, done.stderr) == (3, "")
    assert vehicles.obeyed == {1: [Order[kind.upper()]], 2: [Order[kind.upper()]]}


def test_gateway_serves_on_though_its_output_cannot_be_written(folder: Path, port: int, vehicles: Vehicles) -> None:
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255, dialect="common")
    ground = station.port.getsockname()[1]
    words = ["gateway", "--peers", f"udpin://127.0.0.1:{port}", "--ground-station", f"udpout://127.0.0.1:{ground}"]
    with open("/dev/full", "w") as full:
        gateway = subprocess.Popen(order(folder, *words), stdout=full, stderr=subprocess.PIPE, text=True)
    try:
        assert station.recv_match(type="HEARTBEAT", blocking=True, timeout=LIMIT_S)
        station.mav.command_long_send(1, 191, mavlink.MAV_CMD_NAV_LAND, 0, *(0.0,) * 7)
        while not (vehicles.obeyed[1] and vehicles.obeyed[2]):
            assert station.recv_match(type="HEARTBEAT", blocking=True, timeout=LIMIT_S) is not None
        gateway.send_signal(signal.SIGINT)
        assert gateway.communicate(timeout=LIMIT_S)[1] == "companion: cannot write: No space left on device\n"
        assert gateway.returncode == 3
    finally:
        gateway.kill()
        gateway.communicate()
        station.close()
    assert vehicles.obeyed == {1: [Order.ABORT], 2: [Order.ABORT]}


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


def test_what_stops_goes_out_beside_a_bad_count_and_a_start_does_not(
    folder: Path, port: int, vehicles: Vehicles
) -> None:
    count = folder / "fleet" / "operator.key.orders"
    kept = count.read_bytes() if count.exists() else None
    count.write_text("garbage")
    try:
        peers = ["--peers", f"udpin://127.0.0.1:{port}"]
        code, out, err = run(order(folder, "abort", *peers))
        assert (code, out) == (0, "ABORT: acting on it: 1, 2\n")
        assert "ABORT goes out, counted by the clock alone" in err
        code, _, err = run(order(folder, "start", "--yes", *peers))
        assert code == 2
        assert "is no file of an operator's orders: move it away to begin anew: nothing was ordered" in err
    finally:
        count.unlink()
        if kept is not None:
            count.write_bytes(kept)
    assert vehicles.obeyed == {1: [Order.ABORT], 2: [Order.ABORT]}


@pytest.mark.parametrize("for_s", ["nan", "inf", "-5", "0", "x"])
def test_time_to_send_for_is_a_number_above_0(folder: Path, port: int, for_s: str) -> None:
    code, _, err = run(order(folder, "hold", "--peers", f"udpin://127.0.0.1:{port}", f"--for-s={for_s}"))
    assert code == 2
    assert f"--for-s: {for_s}: must be a number of seconds above 0" in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_order_that_is_interrupted_says_who_acts_and_ends_so(folder: Path, port: int, number: signal.Signals) -> None:
    vehicles = Vehicles(folder, port, deaf=2)
    arguments = order(folder, "abort", "--peers", f"udpin://127.0.0.1:{port}", "--for-s", "60")
    sending = subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        while not vehicles.obeyed[1]:
            assert sending.poll() is None
            time.sleep(0.05)
        sending.send_signal(number)
        out, err = sending.communicate(timeout=LIMIT_S)
    finally:
        sending.kill()
        sending.communicate()
        vehicles.close()
    assert out.startswith("ABORT: ")  # who is heard to act by then
    assert err == f"companion: {number.name}: ABORT is not sent any more\n"
    assert sending.returncode == 130


def test_order_that_is_interrupted_while_it_listens_was_not_sent(folder: Path, port: int) -> None:
    arguments = order(folder, "start", "--yes", "--peers", f"udpout://127.0.0.1:{port}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", port))
        ours.settimeout(LIMIT_S)
        listening = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
        ours.recv(65536)  # its own proof: it listens
        listening.send_signal(signal.SIGINT)
        assert listening.communicate(timeout=LIMIT_S)[1] == "companion: SIGINT: nothing was ordered\n"
    assert listening.returncode == 130


@pytest.mark.parametrize(("is_signal", "words", "code"), [(True, "SIGINT", 130), (False, "not confirmed", 2)])
def test_question_of_a_start_is_ended_by_ctrl_c_and_ctrl_d(
    folder: Path, port: int, vehicles: Vehicles, is_signal: bool, words: str, code: int
) -> None:
    ours, theirs = pty.openpty()
    arguments = order(folder, "start", "--peers", f"udpin://127.0.0.1:{port}")
    started = subprocess.Popen(arguments, stdin=theirs, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert started.stdout is not None
        while started.stdout.read(1) != "?":
            assert started.poll() is None
        if is_signal:
            started.send_signal(signal.SIGINT)
        else:
            os.write(ours, b"\x04")
        assert started.communicate(timeout=LIMIT_S)[1] == f"companion: {words}: nothing was ordered\n"
        assert started.returncode == code
    finally:
        started.kill()
        started.communicate()
        os.close(ours)
        os.close(theirs)
    assert vehicles.obeyed == {1: [], 2: []}


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
