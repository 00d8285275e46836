"""--map: where a live map is served, and when it is told something."""

from __future__ import annotations

import argparse
import socket

import pytest

from mission.common.network import own_addresses
from sim_bridge.drive.live.map import ROWS_HZ, UNSEEN_HZ, Map
from sim_bridge.errors import StartError
from sim_bridge.options.ports import add_map


def asked(*words: str) -> tuple[str, int] | None:
    parser = argparse.ArgumentParser(exit_on_error=False)
    add_map(parser, "")
    where: tuple[str, int] | None = parser.parse_args(words).map
    return where


def test_a_map_is_served_only_where_it_is_asked_for_and_then_on_loopback() -> None:
    assert asked() is None
    assert asked("--map") == ("127.0.0.1", 0)
    assert asked("--map", "0.0.0.0:8080") == ("0.0.0.0", 8080)
    assert asked("--map", "[::1]:0") == ("::1", 0)


@pytest.mark.parametrize(
    "where", ["", "8080", "127.0.0.1", "localhost:80", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:70000", ":80"]
)
def test_what_is_no_address_is_refused(where: str) -> None:
    with pytest.raises(argparse.ArgumentError, match=r"must be ADDRESS:PORT, as 127\.0\.0\.1:8080"):
        asked("--map", where)


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(StartError, match=f"^--map 127.0.0.1:{port}: "):
            Map(("127.0.0.1", port), ())


@pytest.mark.parametrize(("bound", "local"), [("0.0.0.0", "127.0.0.1"), ("127.0.0.1", "127.0.0.1")])
def test_what_is_printed_can_be_opened_here_and_where_others_may_look_elsewhere(
    monkeypatch: pytest.MonkeyPatch, bound: str, local: str
) -> None:
    monkeypatch.setattr(own_addresses, "own_ipv4", lambda: ["192.168.4.10"])
    map_ = Map((bound, 0), ())
    try:
        port = map_.urls[0].rpartition(":")[2]
        elsewhere = [f"http://192.168.4.10:{port}"] if bound == "0.0.0.0" else []
        assert map_.urls == [f"http://{local}:{port}", *elsewhere]
    finally:
        map_.close()


def test_where_no_own_address_is_known_it_is_said_what_to_put_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert own_addresses.lines("live map:", ["http://127.0.0.1:1/"]) == ["live map: http://127.0.0.1:1/"]
    monkeypatch.setattr(own_addresses, "own_ipv4", list)
    url = f"http://{own_addresses.reached_at('0.0.0.0')[0]}:1/"
    assert own_addresses.lines("open", [url]) == [
        "open http://ADDRESS:1/",
        "ADDRESS: put there this computer's address in the other one's network",
    ]


def test_rows_are_told_seldom_while_nobody_looks_and_ten_times_a_second_to_viewers() -> None:
    map_ = Map(("127.0.0.1", 0), ())
    try:
        ticks_s = [0.05 * k for k in range(200)]
        assert sum(map(map_.due, ticks_s)) == 10.0 * UNSEEN_HZ
        map_.viewers = 1
        assert sum(map_.due(10.0 + tick_s) for tick_s in ticks_s) == 10.0 * ROWS_HZ
        map_.gone = "killed"
        assert not map_.due(100.0)
    finally:
        map_.close()
