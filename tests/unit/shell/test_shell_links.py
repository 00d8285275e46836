"""Links over real sockets and pseudo-terminals: they deliver, and in flight nothing raises."""

from __future__ import annotations

import errno
import os
import select
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from companion.shell import links, serial_port
from companion.shell.links import BroadcastLink, Link, LinkError, SerialLink, UdpLink, open_link
from companion.shell.urls import Scheme, Url

LIMIT_S = 20.0


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def _socket(opened: ExitStack) -> tuple[socket.socket, int]:
    sock = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    sock.settimeout(LIMIT_S)
    sock.bind(("127.0.0.1", 0))
    return sock, sock.getsockname()[1]


def _open(opened: ExitStack, url: Url) -> Link:
    return opened.enter_context(closing(open_link(url)))


def _next(link: Link) -> bytes:
    assert select.select([link], [], [], LIMIT_S)[0]
    data = link.recv()
    assert data is not None
    return data


def test_udpout_sends_and_hears_whom_it_sends_to_only(opened: ExitStack) -> None:
    other, port = _socket(opened)
    stranger, _ = _socket(opened)
    link = _open(opened, Url(Scheme.UDP_OUT, "127.0.0.1", port))
    link.send(b"one")
    data, address = other.recvfrom(100)
    assert data == b"one"
    stranger.sendto(b"stranger", address)
    other.sendto(b"two", address)
    other.sendto(b"", address)
    assert _next(link) == b"two"
    assert _next(link) == b""
    assert link.recv() is None
    assert link.errors == 0
    assert link.up


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The links' clock, which stands still."""
    clock = SimpleNamespace(now_s=100.0)
    monkeypatch.setattr("companion.shell.links.time", SimpleNamespace(monotonic=lambda: clock.now_s))
    return clock


def _udpin(opened: ExitStack) -> tuple[UdpLink, tuple[str, int]]:
    link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0))
    opened.callback(link.close)
    return link, ("127.0.0.1", link.port)


def test_udpin_is_silent_until_spoken_to_and_then_answers(opened: ExitStack) -> None:
    link, address = _udpin(opened)
    link.send(b"to nobody")
    assert link.errors == 0
    other, _ = _socket(opened)
    other.sendto(b"first", address)
    assert _next(link) == b"first"
    link.send(b"answer")
    assert other.recv(100) == b"answer"


@pytest.mark.usefixtures("clock")
def test_udpin_neither_hears_nor_answers_a_stranger_while_the_first_speaks(opened: ExitStack) -> None:
    link, address = _udpin(opened)
    first, _ = _socket(opened)
    stranger, _ = _socket(opened)
    first.sendto(b"first", address)
    assert _next(link) == b"first"
    for _ in range(3):
        stranger.sendto(b"stranger", address)
        assert _next(link) == b""
        assert link.recv() is None
        link.send(b"setpoint")
        assert first.recv(100) == b"setpoint"
    first.sendto(b"still there", address)
    assert _next(link) == b"still there"
    assert link.errors == 3
    stranger.setblocking(False)
    with pytest.raises(BlockingIOError):
        stranger.recv(100)


def test_udpin_takes_another_end_once_the_first_has_been_silent(opened: ExitStack, clock: SimpleNamespace) -> None:
    link, address = _udpin(opened)
    first, _ = _socket(opened)
    second, _ = _socket(opened)
    first.sendto(b"first", address)
    assert _next(link) == b"first"
    clock.now_s += links.OTHER_END_S
    assert link.recv() is None
    second.sendto(b"too early", address)
    assert _next(link) == b""
    clock.now_s += 0.1
    assert link.recv() is None
    second.sendto(b"second", address)
    assert _next(link) == b"second"
    link.send(b"setpoint")
    assert second.recv(100) == b"setpoint"
    first.sendto(b"back", address)
    assert _next(link) == b""


def test_udpin_that_hears_all_hears_two_drivers_and_answers_the_last(opened: ExitStack) -> None:
    link = UdpLink(Url(Scheme.UDP_IN, "127.0.0.1", 0), hears_all=True)
    opened.callback(link.close)
    ahead, _ = _socket(opened)
    behind, _ = _socket(opened)
    for other, data in ((ahead, b"ahead"), (behind, b"behind"), (ahead, b"ahead again")):
        other.sendto(data, ("127.0.0.1", link.port))
        assert _next(link) == data
        link.send(b"heartbeat")
        assert other.recv(100) == b"heartbeat"
    assert link.errors == 0


def test_standing_still_does_not_give_udpins_other_end_away(opened: ExitStack, clock: SimpleNamespace) -> None:
    link, address = _udpin(opened)
    first, _ = _socket(opened)
    stranger, _ = _socket(opened)
    first.sendto(b"first", address)
    assert _next(link) == b"first"
    clock.now_s += 60.0  # nothing was read meanwhile
    stranger.sendto(b"stranger", address)
    first.sendto(b"queued", address)
    assert (_next(link), _next(link)) == (b"", b"queued")
    assert link.recv() is None
    link.send(b"setpoint")
    assert first.recv(100) == b"setpoint"


def test_nobody_listening_is_counted_and_ignored(opened: ExitStack) -> None:
    other, port = _socket(opened)
    link = _open(opened, Url(Scheme.UDP_OUT, "127.0.0.1", port))
    other.close()
    for _ in range(3):
        link.send(b"x")  # every other one meets the refusal of the one before
        assert link.recv() is None
    assert link.errors >= 1


def test_a_datagram_too_long_is_counted(opened: ExitStack) -> None:
    _, port = _socket(opened)
    link = _open(opened, Url(Scheme.UDP_OUT, "127.0.0.1", port))
    link.send(bytes(70_000))
    assert link.errors == 1


def test_a_taken_port_is_refused_by_name(opened: ExitStack) -> None:
    _, port = _socket(opened)
    with pytest.raises(LinkError, match=f"udpin://127.0.0.1:{port}: the port is taken.*choose another"):
        open_link(Url(Scheme.UDP_IN, "127.0.0.1", port))


def test_an_address_of_another_computer_is_refused() -> None:
    with pytest.raises(LinkError, match="no interface of this computer"):
        open_link(Url(Scheme.UDP_IN, "192.0.2.1", 14540))  # TEST-NET-1: nobody has it


def test_a_broadcast_address_needs_udpbcast() -> None:
    with pytest.raises(LinkError, match="udpbcast"):
        open_link(Url(Scheme.UDP_OUT, "255.255.255.255", 14540))


@pytest.mark.parametrize(
    ("error", "hint"),
    [
        (PermissionError(errno.EACCES, "no"), "1024"),
        (OSError(errno.ENETUNREACH, "no"), "is the network up"),
        (socket.gaierror(socket.EAI_NONAME, "no"), "no such host"),
        (OSError(errno.EMFILE, "too many files"), "too many files"),
    ],
)
def test_what_else_can_go_wrong_has_its_hint(error: OSError, hint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: Url) -> tuple[str, int]:
        raise error

    monkeypatch.setattr(links, "resolved", fail)
    with pytest.raises(LinkError, match=hint):
        open_link(Url(Scheme.UDP_IN, "127.0.0.1", 80))


@pytest.fixture
def broadcast(opened: ExitStack) -> tuple[Link, Link]:
    """Two of one mesh on the loopback network."""
    place = "127.255.255.255"
    probe = opened.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        probe.bind((place, 0))
        url = Url(Scheme.UDP_BROADCAST, place, probe.getsockname()[1])
        pair = _open(opened, url), _open(opened, url)
    except (OSError, LinkError) as error:
        pytest.skip(f"no broadcast on loopback here: {error}")
    return pair


def test_broadcast_is_heard_by_the_others_and_not_by_oneself(broadcast: tuple[Link, Link]) -> None:
    a, b = broadcast
    a.send(b"from a")
    b.send(b"from b")
    assert _next(b) == b"from a"
    assert isinstance(a, BroadcastLink)
    assert select.select([a], [], [], LIMIT_S)[0]
    heard = a.recv() or _next(a)
    assert heard == b"from b"
    assert a.recv() is None
    assert b.recv() is None
    assert (a.errors, b.errors) == (0, 0)
    a.send(bytes(70_000))
    assert a.errors == 1


class Terminal:
    """The far end of a serial cable, behind a path that outlives it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.plug()

    def plug(self) -> None:
        self.far, near = os.openpty()
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(near))
        self._near = near

    def unplug(self) -> None:
        os.close(self._near)
        os.close(self.far)

    def read(self) -> bytes:
        assert select.select([self.far], [], [], LIMIT_S)[0]
        return os.read(self.far, 65536)


@pytest.fixture
def terminal(tmp_path: Path) -> Iterator[Terminal]:
    terminal = Terminal(tmp_path / "tty")
    yield terminal
    terminal.unplug()


def _serial(opened: ExitStack, terminal: Terminal) -> SerialLink:
    link = open_link(Url(Scheme.SERIAL, str(terminal.path), 115200))
    assert isinstance(link, SerialLink)
    opened.callback(link.close)
    return link


def wait_until_done(link: SerialLink) -> None:
    """A try to open the port, if there is one."""
    if link._opening is not None:
        link._opening.wait(LIMIT_S)


def wait_for_port(link: SerialLink) -> None:
    assert link.recv() is None  # begins to open it
    wait_until_done(link)
    assert link.recv() is None
    assert link.up


def test_serial_carries_all_bytes_unchanged(opened: ExitStack, terminal: Terminal) -> None:
    link = _serial(opened, terminal)
    everything = bytes(range(256))
    assert link.recv() is None
    link.send(everything)
    assert terminal.read() == everything
    os.write(terminal.far, everything)
    assert _next(link) == everything


def test_a_full_port_drops_whole_datagrams(opened: ExitStack, terminal: Terminal) -> None:
    link = _serial(opened, terminal)
    count = 0
    while link.errors < 3:
        link.send(b"<%06d>" % count * 100)
        count += 1
    received = b""
    last = b"<%06d>" % count * 100
    while last not in received:
        received += terminal.read()
        link.send(last)
    sent = {b"<%06d>" % k * 100 for k in range(count + 1)}
    assert all(received[at : at + 800] in sent for at in range(0, len(received) - 800, 800))


def test_an_unplugged_port_is_opened_again_when_it_is_back(opened: ExitStack, terminal: Terminal) -> None:
    link = _serial(opened, terminal)
    terminal.unplug()
    assert link.recv() is None
    assert not link.up
    assert link.fileno() == -1
    link.send(b"nobody there")
    assert link.errors == 2
    terminal.plug()
    wait_for_port(link)
    link.send(b"again")
    assert terminal.read() == b"again"


def test_an_unplugged_port_is_noticed_by_sending_too(opened: ExitStack, terminal: Terminal) -> None:
    link = _serial(opened, terminal)
    terminal.unplug()
    link.send(b"x")
    assert not link.up
    terminal.plug()


def test_reopening_is_tried_once_a_second(
    opened: ExitStack, terminal: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = _serial(opened, terminal)
    terminal.unplug()
    terminal.path.unlink()
    now_s = 100.0
    tries = 0

    def refuse(_: Url, **_dtr: bool) -> None:
        nonlocal tries
        tries += 1
        raise FileNotFoundError(errno.ENOENT, "gone")

    with monkeypatch.context() as patched:
        patched.setattr(serial_port, "open_port", refuse)
        patched.setattr("companion.shell.links.time.monotonic", lambda: now_s)
        for expected in (1, 2):
            for _ in range(10):
                assert link.recv() is None
                wait_until_done(link)
            assert tries == expected
            now_s += links.REOPEN_S
    terminal.plug()


@pytest.mark.parametrize(
    ("error", "hint"),
    [
        (OSError(errno.ENOENT, "no"), "is it plugged in"),
        (OSError(errno.EACCES, "no"), "dialout"),
        (OSError(errno.EAGAIN, "no"), "another program"),
        (ValueError("Invalid baud rate: 1201"), "1201"),
    ],
)
def test_a_serial_port_that_cannot_be_opened_says_what_to_do(
    error: Exception, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: Url, **_dtr: bool) -> None:
        raise error

    monkeypatch.setattr(serial_port, "open_port", refuse)
    with pytest.raises(LinkError, match=f"serial:///dev/ttyS0:57600: .*{hint}"):
        open_link(Url(Scheme.SERIAL, "/dev/ttyS0", 57600))


@pytest.mark.parametrize("dtr", [True, False])
def test_a_serial_ports_dtr_is_set_before_it_is_opened(dtr: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """An RPLIDAR's motor hangs on it."""
    found: list[bool] = []
    monkeypatch.setattr(serial_port.serial.Serial, "open", lambda port: found.append(port.dtr))
    open_link(Url(Scheme.SERIAL, "/dev/ttyNONE", 115200), dtr=dtr)
    assert found == [dtr]


def test_a_serial_port_has_one_user(opened: ExitStack, terminal: Terminal) -> None:
    _serial(opened, terminal)
    with pytest.raises(LinkError, match="another program has it open"):
        open_link(Url(Scheme.SERIAL, str(terminal.path), 115200))


def test_a_file_is_no_serial_port(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(LinkError, match="cannot be opened as a serial port"):
        open_link(Url(Scheme.SERIAL, str(tmp_path / "file"), 115200))
