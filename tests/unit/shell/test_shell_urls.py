"""Where links go: what is accepted, and that every refusal names the value and what is allowed."""

from __future__ import annotations

import pytest

from companion.shell.urls import AUTOPILOT_SCHEMES, FORMS, PEERS_SCHEMES, Scheme, Url, UrlError, parse_url


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udpin://127.0.0.1:14540", Url(Scheme.UDP_IN, "127.0.0.1", 14540)),
        ("udpin://0.0.0.0:14540", Url(Scheme.UDP_IN, "0.0.0.0", 14540)),
        ("udpout://autopilot-3.local:1", Url(Scheme.UDP_OUT, "autopilot-3.local", 1)),
        ("serial:///dev/ttyAMA0:921600", Url(Scheme.SERIAL, "/dev/ttyAMA0", 921600)),
        (
            "serial:///dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0:57600",
            Url(Scheme.SERIAL, "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0", 57600),
        ),
    ],
)
def test_autopilot_urls(text: str, expected: Url) -> None:
    url = parse_url(text, AUTOPILOT_SCHEMES)
    assert url == expected
    assert str(url) == text


def test_peers_may_broadcast() -> None:
    url = parse_url("udpbcast://192.168.4.255:14660", PEERS_SCHEMES)
    assert url == Url(Scheme.UDP_BROADCAST, "192.168.4.255", 14660)


@pytest.mark.parametrize(
    ("text", "allowed", "why"),
    [
        ("", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("127.0.0.1:14540", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin:127.0.0.1:14540", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1:", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1:port", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1:1\n", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1:-1", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("udpin://127.0.0.1:٤٢", AUTOPILOT_SCHEMES, "SCHEME://PLACE:NUMBER"),
        ("tcpout://127.0.0.1:5760", AUTOPILOT_SCHEMES, "'tcpout' is not for this link"),
        ("http://127.0.0.1:80", PEERS_SCHEMES, "'http' is not for this link"),
        ("udpbcast://192.168.4.255:14660", AUTOPILOT_SCHEMES, "'udpbcast' is not for this link"),
        ("serial:///dev/ttyS0:57600", PEERS_SCHEMES, "'serial' is not for this link"),
        ("udpin://:14540", AUTOPILOT_SCHEMES, "must stand before the port"),
        ("udpin://a b:14540", AUTOPILOT_SCHEMES, "must stand before the port"),
        ("udpin://[::1]:14540", AUTOPILOT_SCHEMES, "IPv4"),
        ("udpin://-x:14540", AUTOPILOT_SCHEMES, "must stand before the port"),
        ("udpin://127.0.0.1:0", AUTOPILOT_SCHEMES, "port must be 1..65535"),
        ("udpout://127.0.0.1:65536", AUTOPILOT_SCHEMES, "port must be 1..65535"),
        ("udpout://0.0.0.0:14540", AUTOPILOT_SCHEMES, "no address to send to"),
        ("udpbcast://0.0.0.0:14540", PEERS_SCHEMES, "no address to send to"),
        ("udpbcast://mesh:14540", PEERS_SCHEMES, "must be IPv4"),
        ("serial://dev/ttyS0:57600", AUTOPILOT_SCHEMES, "starts with /"),
        ("serial://:57600", AUTOPILOT_SCHEMES, "starts with /"),
        ("serial:///dev/tty\x1b[2J:57600", AUTOPILOT_SCHEMES, "starts with /"),
        ("serial:///dev/ttyS0:0", AUTOPILOT_SCHEMES, "baud rate must be"),
        ("serial:///dev/ttyS0:99999999", AUTOPILOT_SCHEMES, "baud rate must be"),
    ],
)
def test_refusals_name_the_value_and_what_is_allowed(text: str, allowed: frozenset[Scheme], why: str) -> None:
    with pytest.raises(UrlError) as refusal:
        parse_url(text, allowed)
    message = str(refusal.value)
    assert why in message
    assert message.isprintable()
    assert all(FORMS[scheme] in message for scheme in allowed)
    if text.isprintable():
        assert repr(text) in message or len(text) > 60
