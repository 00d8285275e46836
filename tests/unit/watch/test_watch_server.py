"""Who may look at what was heard, and that nobody can tell the server anything."""

from __future__ import annotations

import http.client
import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.shell.urls import HEARING_SCHEMES, UrlError, parse_url
from companion.watch import server as watch_server
from companion.watch.address import PORT, address_of
from companion.watch.server import Stream, WatchServer
from companion.watch.udp_receiver import UdpReceiver
from mission.basemap.charts import open_chart
from mission.common.network import own_addresses
from mission.common.network.connections import CONNECTIONS_MAX
from tests.unit.watch.watch_kit import mbtiles

PNG = b"\x89PNG\r\n\x1a\n"
TILES = {(0, 0, 0): PNG + b"all", (9, 267, 179): PNG + b"a picture"}


@pytest.fixture
def serving(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[WatchServer]:
    """With a map of some tiles; the parameter: its address."""
    chart = open_chart(mbtiles(tmp_path / "m.mbtiles", TILES))
    server = WatchServer((getattr(request, "param", "127.0.0.1"), 0), Stream(), chart)
    server.stream.show({"vehicles": []})
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield server
    server.stream.close()
    server.shutdown()
    thread.join()
    server.server_close()
    chart.close()


def ask(
    server: WatchServer, path: str, *, method: str = "GET", host: str = "", cookie: str = ""
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    connection.putrequest(method, path, skip_host=True)
    connection.putheader("Host", host or f"127.0.0.1:{server.server_address[1]}")
    if cookie:
        connection.putheader("Cookie", cookie)
    connection.endheaders()
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, data


def first_picture(server: WatchServer, cookie: str = "") -> dict[str, object]:
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=20)
    connection.request("GET", "/heard", headers={"Cookie": cookie} if cookie else {})
    answer = connection.getresponse()
    assert answer.getheader("Content-Type") == "text/event-stream"
    line = answer.readline()
    connection.close()
    assert line.startswith(b"data: ")
    picture: dict[str, object] = json.loads(line.removeprefix(b"data: "))
    return picture


def test_on_loopback_the_page_its_map_and_the_pictures_are_there_for_all(serving: WatchServer) -> None:
    assert serving.urls == [f"http://127.0.0.1:{serving.server_address[1]}/"]
    for path, word in (("/", b"watch.js"), ("/watch.js", b"EventSource"), ("/watch.css", b"--ground")):
        status, headers, data = ask(serving, path)
        assert status == 200
        assert word in data
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    assert ask(serving, "/map/9/267/179")[2] == TILES[9, 267, 179]
    assert ask(serving, "/map/9/267/179")[1]["content-type"] == "image/png"
    assert first_picture(serving) == {"vehicles": []}


@pytest.mark.parametrize(
    "path",
    [
        "/map/9/267/180",
        "/map/image",
        "/map/99/0/0",
        "/map/1/2/0",
        "/map/1/-1/0",
        "/../command.py",
        "/bundle/watch.js",
    ],
)
def test_nothing_else_is(serving: WatchServer, path: str) -> None:
    assert ask(serving, path)[0] == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "CONNECT"])
def test_it_takes_nothing_from_anybody(serving: WatchServer, method: str) -> None:
    assert ask(serving, "/", method=method)[0] == 501


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8650", "127.0.0.1.evil.example", "x y"])
def test_another_pages_name_does_not_lead_here(serving: WatchServer, host: str) -> None:
    assert ask(serving, "/", host=host)[0] == 403


@pytest.mark.parametrize("serving", ["0.0.0.0"], indirect=True)
def test_on_other_addresses_the_token_lets_in_and_nothing_else(serving: WatchServer) -> None:
    token = serving.token
    assert len(token) >= 20
    assert serving.urls
    for url in serving.urls:
        assert url.endswith(f":{serving.server_address[1]}/?token={token}")
        assert "//0.0.0.0:" not in url
    for path in ("/", "/heard", "/watch.js", "/map/0/0/0", "/?token=", "/?token=guess", f"/heard?token={token}"):
        status, headers, data = ask(serving, path)
        assert status == 403
        assert "set-cookie" not in headers
        assert token.encode() not in data
    name = f"understory-watch-{serving.server_address[1]}"
    for cookie in (f"{name}=guess", name, f"understory-watch={token}", ";;=", f'{name}="\\'):
        assert ask(serving, "/", cookie=cookie)[0] == 403
    status, headers, _ = ask(serving, f"/?token={token}")
    assert (status, headers["location"]) == (303, "/")
    assert "HttpOnly" in headers["set-cookie"]
    assert "SameSite=Strict" in headers["set-cookie"]
    cookie = headers["set-cookie"].partition(";")[0]
    assert ask(serving, "/", cookie=cookie)[0] == 200
    assert ask(serving, "/map/0/0/0", cookie=cookie)[0] == 200
    assert first_picture(serving, cookie) == {"vehicles": []}


def test_each_start_has_a_token_of_its_own() -> None:
    tokens = set()
    for _ in range(3):
        server = WatchServer(("0.0.0.0", 0), Stream())
        tokens.add(server.token)
        server.server_close()
    assert len(tokens) == 3


def test_watchers_on_two_ports_of_one_host_do_not_turn_each_others_tablets_away() -> None:
    first, second = (WatchServer(("0.0.0.0", 0), Stream()) for _ in range(2))
    try:
        assert first.cookie != second.cookie
    finally:
        first.server_close()
        second.server_close()


def test_a_server_on_all_addresses_names_each_that_others_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    server = WatchServer(("0.0.0.0", 0), Stream())
    end = f":{server.server_address[1]}/?token={server.token}"
    try:
        monkeypatch.setattr(own_addresses, "own_ipv4", lambda: ["192.168.4.10", "10.0.0.2"])
        assert server.urls == [f"http://192.168.4.10{end}", f"http://10.0.0.2{end}"]
        monkeypatch.setattr(own_addresses, "own_ipv4", list)
        assert server.urls == [f"http://ADDRESS{end}"]
    finally:
        server.server_close()


def test_an_address_of_this_computer_is_one_that_a_socket_can_have() -> None:
    for address in own_addresses.own_ipv4():
        assert not address.startswith("127.")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
            own.bind((address, 0))
    assert own_addresses.reached_at("192.168.4.10") == ["192.168.4.10"]


def test_there_are_at_most_so_many_who_look(serving: WatchServer) -> None:
    serving.streams = threading.BoundedSemaphore(1)
    connection = http.client.HTTPConnection("127.0.0.1", serving.server_address[1], timeout=20)
    connection.request("GET", "/heard")
    answer = connection.getresponse()
    assert answer.readline().startswith(b"data: ")
    assert ask(serving, "/heard")[0] == 503
    assert ask(serving, "/")[0] == 200
    connection.close()
    assert watch_server.STREAMS_MAX < CONNECTIONS_MAX


def test_a_stream_gives_the_newest_picture_and_never_waits_for_a_slow_reader() -> None:
    stream = Stream()
    for number in range(5):
        stream.show({"number": number})
    count, picture = stream.after(0, 0.0)
    assert (count, json.loads(picture)) == (5, {"number": 4})
    assert stream.after(5, 0.0) == (count, picture)


# --- UDP receiver -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["udpin", "udpbcast"])
def test_the_socket_that_hears_cannot_send(scheme: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    host = "127.0.0.1" if scheme == "udpin" else "127.255.255.255"
    udp_receiver = UdpReceiver(parse_url(f"{scheme}://{host}:{port}", HEARING_SCHEMES))
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            vehicle.bind(("127.0.0.1", 0))
            vehicle.settimeout(0.1)
            vehicle.sendto(b"one", (host, port))
            vehicle.sendto(b"two", (host, port))
            assert next(iter(udp_receiver.receive_datagrams(5.0))) == b"one"
            assert [*udp_receiver.receive_datagrams(0.0)] == [b"two"]
            sock = udp_receiver._sock
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            for address in (vehicle.getsockname(), ("127.255.255.255", port)):
                with pytest.raises(BrokenPipeError):
                    sock.sendto(b"land", address)
            with pytest.raises(TimeoutError):
                vehicle.recv(100)
    finally:
        udp_receiver.close()


def test_a_link_that_would_have_to_send_is_refused() -> None:
    with pytest.raises(UrlError, match=r"'udpout' is not for this link; allowed: .*udpin"):
        parse_url("udpout://127.0.0.1:14660", HEARING_SCHEMES)


@pytest.mark.parametrize(
    ("text", "address"),
    [("192.168.4.10", ("192.168.4.10", PORT)), ("0.0.0.0:0", ("0.0.0.0", 0)), ("localhost:80", ("127.0.0.1", 80))],
)
def test_an_address_to_listen_at(text: str, address: tuple[str, int]) -> None:
    assert address_of(text) == address


@pytest.mark.parametrize(
    "text", ["", "tablet", "1.2.3", "127.0.0.1:", "127.0.0.1:65536", "127.0.0.1:-1", "::1", "[::1]:80", "localhosts"]
)
def test_what_is_no_address_is_named_whole_with_what_is_allowed(text: str) -> None:
    with pytest.raises(
        ValueError, match=r"must be (an IPv4 address .* or localhost, as 192|0 \(a free one\))"
    ) as refused:
        address_of(text)
    assert str(refused.value).startswith(f"{text!r}: ")
