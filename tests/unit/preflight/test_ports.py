"""Rows about ports: which users may open them, which program has them."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from companion.preflight import ports
from companion.preflight.report import Check, Verdict
from companion.shell.urls import AUTOPILOT_SCHEMES, PEERS_SCHEMES, parse_url

UDP_IN = parse_url("udpin://0.0.0.0:14540", AUTOPILOT_SCHEMES)


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """One serial port: the near end of a pseudo-terminal, closed."""
    far, near = os.openpty()
    name = os.ttyname(near)
    os.close(near)
    monkeypatch.setattr(list_ports, "comports", lambda: [ListPortInfo(name)])
    yield name
    os.close(far)


def only(checks: Iterator[Check]) -> Check:
    (check,) = checks
    return check


def test_serial_port_that_is_free_taken_or_forbidden(port: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert only(ports.serial_ports()).verdict is Verdict.PASS
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    taken = only(ports.serial_ports())
    os.close(fd)
    assert taken.verdict is Verdict.WARN
    assert f"({os.getpid()})" in taken.found
    monkeypatch.setattr(os, "access", lambda *_: False)
    forbidden = only(ports.serial_ports())
    assert forbidden.verdict is Verdict.FAIL
    assert "usermod -aG" in forbidden.fix


def test_port_that_no_list_has_is_looked_at_where_a_link_is_on_it_or_a_jetson_has_it(
    port: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(list_ports, "comports", list)
    by_id = tmp_path / "by-id"
    by_id.symlink_to(port)
    link = parse_url(f"serial://{by_id}:57600", AUTOPILOT_SCHEMES)
    fd = os.open(port, os.O_RDWR | os.O_NOCTTY)
    taken = only(ports.serial_ports([link, UDP_IN]))
    os.close(fd)
    assert (taken.name, taken.verdict) == (port, Verdict.WARN)
    assert f"({os.getpid()})" in taken.found
    (tmp_path / "ttyTHS1").touch()
    monkeypatch.setattr(ports, "DEV", tmp_path)
    assert only(ports.serial_ports()).name == str(tmp_path / "ttyTHS1")


def test_port_of_a_link_that_is_not_there_is_a_problem(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", list)
    link = parse_url(f"serial://{tmp_path}/ttyTHS0:57600", AUTOPILOT_SCHEMES)
    check = only(ports.serial_ports([link]))
    assert (check.verdict, check.found) == (Verdict.FAIL, "No such file or directory")


def test_no_serial_port_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(list_ports, "comports", list)
    assert only(ports.serial_ports()).verdict is Verdict.WARN


def test_udp_port_that_a_link_wants_is_told_with_who_has_it() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        check = ports.udp_port(parse_url(f"udpin://127.0.0.1:{port}", AUTOPILOT_SCHEMES))
        assert check.verdict is Verdict.WARN
        assert check.found.startswith(f"127.0.0.1:{port} by ")
        assert check.found.endswith(f"({os.getpid()})")
        shared = ports.udp_port(parse_url(f"udpbcast://127.255.255.255:{port}", PEERS_SCHEMES))
        assert (shared.verdict, shared.found) == (Verdict.PASS, check.found)
    assert ports.udp_port(parse_url(f"udpin://127.0.0.1:{port}", AUTOPILOT_SCHEMES)).found == "free"
