"""A serial port that is opened beside the loop: whatever the device does, the loop goes on."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.shell import links, serial_port
from companion.shell.links import SerialLink, open_link
from companion.shell.serial_port import PortOpening
from companion.shell.urls import Scheme, Url
from tests.unit.shell.test_shell_links import LIMIT_S, wait_for_port, wait_until_done

TURN_S = 0.5  # of a loop that waits for nothing, on a busy machine


class Device:
    """One that does not answer until it is told to; its port is a pseudo-terminal's."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.answers = threading.Event()
        self.opened: list[serial_port.serial.Serial] = []
        self._open = serial_port.open_port
        self._far, self._near = os.openpty()
        self.url = Url(Scheme.SERIAL, os.ttyname(self._near), 115200)
        monkeypatch.setattr(serial_port, "open_port", self._open_late)

    def _open_late(self, url: Url, *, dtr: bool) -> serial_port.serial.Serial:
        assert self.answers.wait(LIMIT_S)
        self.opened.append(self._open(url, dtr=dtr))
        return self.opened[-1]

    def close(self) -> None:
        self.answers.set()
        os.close(self._far)
        os.close(self._near)


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> Iterator[Device]:
    device = Device(monkeypatch)
    yield device
    device.close()


def linked(device: Device) -> SerialLink:
    link = open_link(device.url, may_be_absent=True)
    assert isinstance(link, SerialLink)
    return link


def test_device_that_hangs_while_it_is_opened_again_keeps_no_turn_waiting(device: Device) -> None:
    device.answers.set()
    link = linked(device)
    assert link.up
    device.answers.clear()
    link._lost()
    began_s = time.monotonic()
    for _ in range(100):
        assert link.recv() is None
        link.send(b"dropped")
    assert time.monotonic() - began_s < TURN_S
    assert not link.up
    device.answers.set()
    wait_until_done(link)
    wait_for_port(link)
    assert len(device.opened) == 2
    link.close()


def test_device_that_hangs_at_the_start_is_as_one_that_is_absent(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A companion that is started again in the air must steer, whatever a sensor's adapter does."""
    monkeypatch.setattr(links, "OPEN_S", 0.01)
    link = linked(device)
    assert (link.up, link.fileno(), link.recv()) == (False, -1, None)
    device.answers.set()
    wait_until_done(link)
    assert link.recv() is None
    assert link.up
    link.close()


def test_port_that_opens_after_its_link_was_closed_is_closed(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(links, "OPEN_S", 0.01)
    link = linked(device)
    opening = link._opening
    assert opening is not None
    link.close()
    device.answers.set()
    opening.wait(LIMIT_S)
    assert [port.is_open for port in device.opened] == [False]


def test_port_that_was_opened_and_not_taken_is_closed(device: Device) -> None:
    device.answers.set()
    opening = PortOpening(device.url, dtr=True)
    opening.wait(LIMIT_S)
    opening.give_up()
    assert [port.is_open for port in device.opened] == [False]


def test_process_that_has_no_more_threads_goes_on_without_the_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    opening = PortOpening(Url(Scheme.SERIAL, str(tmp_path), 115200), dtr=True)
    opening.wait(None)
    assert opening.is_done
    with pytest.raises(OSError, match="can't start new thread"):
        opening.take_port()
