"""Ports and addresses on a command line."""

from __future__ import annotations

import argparse
import ipaddress
import socket

from mission.common.problems import printable

LOOPBACK = "127.0.0.1"
PORT_MAX = 65535
PORT_FIELD = "{port}"  # in a URL or a command: one for each vehicle

Address = tuple[str, int]


def port(text: str) -> int:
    """A number of a port."""
    number = int(text) if text.isascii() and text.isdecimal() and len(text) <= 5 else 0
    if not 1 <= number <= PORT_MAX:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be 1..{PORT_MAX}")
    return number


def loopback(text: str) -> Address:
    """HOST:PORT, with a host that is this machine: the bridge speaks to no other."""
    host, _, number = text.rpartition(":")
    try:
        address = socket.gethostbyname(host)
    except (OSError, UnicodeError):
        address = ""
    if not address or not ipaddress.ip_address(address).is_loopback:
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be on this machine, as 127.0.0.1:14550")
    return address, port(number)


def add_map(parser: argparse.ArgumentParser, watched: str) -> None:
    """--map [ADDRESS:PORT]; `watched`: what happens while somebody looks."""
    parser.add_argument(
        "--map",
        nargs="?",
        type=_here_or_anywhere,
        const=(LOOPBACK, 0),
        metavar="ADDRESS:PORT",
        help=f"serve a live map, and print where{watched}. {LOOPBACK} and a free port by default; viewers on other "
        "machines cannot interfere",
    )


def _here_or_anywhere(text: str) -> Address:
    """ADDRESS:PORT of a server; port 0: a free one."""
    host, _, number = text.rpartition(":")
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        host = ""
    if not host or not (
        number == "0" or 1 <= int(number if number.isascii() and number.isdecimal() else 0) <= PORT_MAX
    ):
        raise argparse.ArgumentTypeError(f"{printable(text)}: must be ADDRESS:PORT, as {LOOPBACK}:8080")
    return host.removeprefix("[").removesuffix("]"), int(number)
