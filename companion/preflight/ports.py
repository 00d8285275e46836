"""Rows about this computer's ports: which users may open them, which program has them."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil
from serial.tools import list_ports

from companion.preflight.report import Check, doubt, good, problem
from companion.shell.urls import Scheme, Url
from mission.common.files import os_words

DEV = Path("/dev")
UNLISTED = "ttyTHS*"  # a Jetson's, which pyserial's list does not have


def serial_ports(urls: Iterable[Url] = ()) -> Iterator[Check]:
    """Each port that is there, and those of `urls`: which users may open it, which program has it."""
    links = {os.path.realpath(url.place) for url in urls if url.scheme is Scheme.SERIAL}
    listed = {port.device for port in list_ports.comports()}
    ports = sorted(links | listed | set(map(str, DEV.glob(UNLISTED))))
    if not ports:
        fix = "with a serial link: is it plugged in? On a Raspberry Pi: enable_uart=1, no console on it (raspi-config)"
        yield doubt("serial", "no serial port", "one, unless the link is UDP", fix)
    holders = _holders(frozenset(ports))
    for port in ports:
        yield _serial_port(port, holders.get(port, []))


def _serial_port(port: str, holders: list[str]) -> Check:
    wanted = "readable, writable, free"
    try:
        status = os.stat(port)
    except OSError as error:
        return problem(port, str(error.strerror), wanted, "is it plugged in, and is this its name?")
    if not os.access(port, os.R_OK | os.W_OK):
        group = _group(status.st_gid)
        fix = f'sudo usermod -aG {group} "$USER", and log in again (a service: its unit\'s SupplementaryGroups={group})'
        return problem(port, f"no permission: {stat.filemode(status.st_mode)}, group {group}", wanted, fix)
    if holders:
        fix = "end that program, or let mavlink-router own the port and give both a UDP port of it"
        return doubt(port, f"open in {', '.join(holders)}", wanted, fix)
    return good(port, "free, as far as this user can see", wanted)


def _group(gid: int) -> str:
    import grp

    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def _holders(devices: frozenset[str]) -> dict[str, list[str]]:
    """Device -> programs that have it open; those of other users are seen by root only."""
    found: dict[str, list[str]] = {}
    for process in psutil.process_iter(["pid", "name"]):
        folder = Path(f"/proc/{process.info['pid']}/fd")
        targets = set()
        with suppress(OSError):  # another user's process
            for entry in folder.iterdir():
                with suppress(OSError):  # closed meanwhile
                    targets.add(os.readlink(entry))
        for device in targets & devices:
            found.setdefault(device, []).append(f"{process.info['name']} ({process.info['pid']})")
    return found


def udp_port(url: Url) -> Check:
    """Names the program on this link's port. Swarm radio is shared: several may listen to one broadcast address."""
    name = f"udp {url.number}"
    try:
        bound = [(c.laddr.ip, c.laddr.port, c.pid) for c in psutil.net_connections("udp") if c.laddr]
    except psutil.AccessDenied as error:
        return doubt(name, f"cannot be read: {error}", "free", "run it as root")
    except OSError as error:
        return doubt(name, f"cannot be read: {os_words(error)}", "free", "run it as root")
    found = ", ".join(sorted(f"{ip}:{port} by {_program(pid)}" for ip, port, pid in bound if port == url.number))
    if not found:
        return good(name, "free", "free")
    if url.scheme is Scheme.UDP_BROADCAST:
        return good(name, found, "free, or other companions")
    return doubt(name, found, "free", "end that program, or choose another port")


def _program(pid: int | None) -> str:
    if pid is None:
        return "another user's program, which root sees"
    try:
        return f"{psutil.Process(pid).name()} ({pid})"
    except psutil.Error:
        return str(pid)
