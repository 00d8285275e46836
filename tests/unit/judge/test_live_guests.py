"""Who may open a live map, and what may be asked of it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_bridge.judge.live import guests


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "[::1]:8080", "192.168.1.5:8080"])
def test_a_request_to_our_address_is_ours(host: str) -> None:
    assert guests.is_ours(host, 8080)


@pytest.mark.parametrize(
    "host", [None, "", "127.0.0.1", "127.0.0.1:80", "evil.example:8080", "127.0.0.1.evil.example:8080", "localhost"]
)
def test_a_request_by_a_name_that_was_made_to_lead_here_is_not(host: str | None) -> None:
    assert not guests.is_ours(host, 8080)


def test_only_our_own_page_or_a_program_may_open_a_stream() -> None:
    assert guests.is_from_here("http://127.0.0.1:8080", "127.0.0.1:8080")
    assert guests.is_from_here(None, "127.0.0.1:8080")
    for origin in (
        "http://evil.example",
        "null",
        "https://127.0.0.1:8080",
        "http://127.0.0.1:8081",
        "http://localhost:8080",
    ):
        assert not guests.is_from_here(origin, "127.0.0.1:8080")


def test_only_this_machine_is_loopback() -> None:
    assert guests.is_loopback("127.0.0.1")
    assert guests.is_loopback("::1")
    assert guests.is_loopback("::ffff:127.0.0.1")
    assert not guests.is_loopback("192.168.1.5")
    assert not guests.is_loopback("fe80::1%eth0")
    assert not guests.is_loopback("")


def test_a_wish_is_one_of_those_allowed() -> None:
    assert guests.command('{"do":"kill","vehicle":3}', ["kill"]) == {"do": "kill", "vehicle": 3}
    assert guests.command('{"do":"kill"}', ["pause"]) is None
    assert guests.command('{"do":["kill"]}', ["kill"]) is None
    assert guests.command('{"do":"kill"' + " " * 2000 + "}", ["kill"]) is None


@given(st.one_of(st.text(), st.binary(), st.just("[" * 1000)))
def test_whatever_is_sent_does_not_raise(data: str | bytes) -> None:
    assert guests.command(data, ["kill"]) is None
