"""`companion doctor`: what keeps a companion from working on this computer, each problem with its fix."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import MappingProxyType

import psutil

from companion.mavlink import beacon as swarm_beacon
from companion.mavlink import dialect
from companion.mavlink.framing.frames import Framing
from companion.mavlink.makes import MAKES, installed_makes, load_installed_makes
from companion.mavlink.peers.frame_mac import is_signed
from companion.preflight.computer import check_disk, check_key, check_monotonic, is_clock_set, told_by
from companion.preflight.listen import SensorWindow, listen
from companion.preflight.ports import serial_ports, udp_port
from companion.preflight.report import Check, Verdict, check_of, doubt, good, problem
from companion.preflight.table import table
from companion.sensors.installed import installed_names, load_sensor
from companion.sensors.table import SENSORS, kind_of
from companion.shell.links import LinkError, open_link
from companion.shell.urls import Scheme, Url
from mission import __version__
from mission.common.compiled import STATE
from mission.common.entry_points import TITLE_MAX_CHARS, EntryPointError
from mission.common.problems import printable

PACKAGES = ("cbor2", "cryptography", "pymavlink", "fastcrc", "pydantic", "pyserial", "psutil", "mavsdk", "shtab")
PYTHON_MIN = (3, 11)
LISTEN_S = 3.0  # an autopilot sends a heartbeat a second, a companion ten beacons
UNIT = "understory-companion.service"
CPU = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
HWMON = Path("/sys/class/hwmon")
ALARM = "in0_lcrit_alarm"  # the kernel's name of a Raspberry Pi's undervoltage
BINDS = frozenset({Scheme.UDP_IN, Scheme.UDP_BROADCAST})
UNSIGNED = "--unsigned"
NEEDS_KEYS = "whoever is in radio range commands it; right in the simulator alone: docs/how-to/keys.md"
NO_SENSORS: Mapping[str, Url] = MappingProxyType({})
SLOW_GOVERNORS = frozenset({"powersave", "conservative"})


def doctor(arguments: argparse.Namespace) -> int:
    """Prints what it finds; exit code 1 when there is a problem."""
    checks = tuple(examine(arguments.autopilot, arguments.peers, arguments.sensors, arguments.key))
    problems = [check.name for check in checks if check.verdict is Verdict.FAIL]
    if arguments.json:
        print(
            json.dumps({"problems": problems, "checks": [check.model_dump(mode="json") for check in checks]}, indent=1)
        )
    else:
        print(f"{table(checks)}\n\n{f'{len(problems)} to mend: ' + ', '.join(problems) if problems else 'no problem'}")
    return 1 if problems else 0


def examine(
    autopilot: Url | None, peers: Url | None, sensors: Mapping[str, Url] = NO_SENSORS, key: str | None = None
) -> Iterator[Check]:
    """All rows."""
    yield versions()
    yield from packages()
    urls = [url for url in (autopilot, peers, *sensors.values()) if url is not None]
    yield from serial_ports(urls)
    for url in urls:
        if url.scheme in BINDS:
            yield udp_port(url)
    if autopilot is not None:
        yield autopilot_link(autopilot)
    if peers is not None:
        yield peers_link(peers)
    for name, url in sensors.items():
        yield from sensor_link(name, url)
    if key is not None:
        yield check_key(key, None)
    yield wall_clock()
    yield check_monotonic()
    yield check_disk(Path.cwd())
    yield governor()
    yield from undervoltage()
    yield service()
    yield unsigned()


def versions() -> Check:
    """Python and what the companion needs."""
    python = ".".join(map(str, sys.version_info[:3]))
    found, missing = [f"Python {python}", f"understory {__version__}, {STATE}"], []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            missing.append(name)
    wanted = f"Python {'.'.join(map(str, PYTHON_MIN))} or newer, all packages"
    if missing or sys.version_info < PYTHON_MIN:
        lacks = f"; missing: {', '.join(missing)}" if missing else ""
        return problem("versions", ", ".join(found) + lacks, wanted, "install the bundle again, or `make install`")
    return good("versions", ", ".join(found), wanted)


def packages() -> Iterator[Check]:
    """Sensors and makes of installed packages, where there are some: each is loaded."""
    names, wrong = installed_names(), ""
    for name in names:
        try:
            load_sensor(name)
        except EntryPointError as error:
            wrong = printable(str(error), TITLE_MAX_CHARS)
    try:
        load_installed_makes()
    except EntryPointError as error:
        wrong = printable(str(error), TITLE_MAX_CHARS)
    makes = [make.name for make in installed_makes()]
    found = "; ".join(
        f"{what} {', '.join(found)}" for what, found in (("sensors", names), ("makes of autopilot", makes)) if found
    )
    if wrong:
        yield problem("packages", wrong, "entry points that can be loaded", "mend or uninstall that package")
    elif found:
        yield good("packages", found, "entry points that can be loaded")


# --- links ---


def autopilot_link(url: Url) -> Check:
    """Heartbeats, and from which components."""
    wanted = f"a heartbeat of {' or '.join(make.name for make in MAKES.values())}"
    framing = Framing(frozenset({dialect.MAVLINK_MSG_ID_HEARTBEAT}), is_stream=url.scheme is Scheme.SERIAL)
    heard: dict[tuple[int, int], str] = {}
    names = {make.autopilot: make.name for make in MAKES.values()}
    size = 0
    try:
        for data in _listen(url):
            size += len(data)
            for m in framing.parse(data):
                kind = "no autopilot" if m.autopilot == dialect.MAV_AUTOPILOT_INVALID else f"autopilot {m.autopilot}"
                heard[m.get_srcSystem(), m.get_srcComponent()] = names.get(m.autopilot, kind)
    except LinkError as error:
        return problem("autopilot", "cannot be opened", wanted, str(error))
    who = ", ".join(f"{kind} {system}/{component}" for (system, component), kind in sorted(heard.items()))
    if any(kind in names.values() for kind in heard.values()):
        return good("autopilot", f"{who} (system/component)", wanted)
    if heard:
        return problem("autopilot", who, wanted, "others are on this link, the autopilot is not: is it on?")
    if size:
        fix = f"is the baud rate right ({url.number})? Is the port set to MAVLink on the autopilot (2)?"
        return problem("autopilot", f"{size} bytes, no heartbeat in them", wanted, fix)
    return problem("autopilot", f"silence for {LISTEN_S:g} s", wanted, _silence(url))


def _silence(url: Url) -> str:
    """Checks, by the kind of link."""
    match url.scheme:
        case Scheme.SERIAL:
            parameters = "; ".join(f"{make.name}: {make.serial_parameters}" for make in MAKES.values())
            return (
                "is the autopilot on, TX wired to RX and RX to TX, ground to ground? Is MAVLink on that port "
                f"({parameters}) at {url.number} baud?"
            )
        case Scheme.UDP_IN | Scheme.UDP_BROADCAST:
            return f"does the autopilot, or mavlink-router, send to port {url.number} of this computer? A firewall?"
        case Scheme.UDP_OUT:
            return f"does the autopilot, or mavlink-router, listen at {url.place}:{url.number}? Can it be pinged?"


def peers_link(url: Url) -> Check:
    """Beacons, and from which vehicles; silence is no problem, the others may be off."""
    wanted = "signed beacons of the others, if they are on"
    senders: dict[int, bool] = {}
    try:
        for data in _listen(url):
            for sender, frame, _ in swarm_beacon.beacons(data):
                senders[sender] = senders.get(sender, True) and is_signed(frame)
    except LinkError as error:
        return problem("peers", "cannot be opened", wanted, str(error))
    if senders:
        found = f"vehicles {', '.join(map(str, sorted(senders)))}"
        if all(senders.values()):
            return good("peers", found, wanted)
        bare = ", ".join(str(sender) for sender in sorted(senders) if not senders[sender])
        return doubt("peers", f"{found}; UNSIGNED: {bare}", wanted, NEEDS_KEYS)
    fix = "is another companion running, on the same mesh, channel and port? `ping` its address; `batctl n`, `iw dev`"
    return doubt("peers", f"silence for {LISTEN_S:g} s", wanted, fix)


def sensor_link(name: str, url: Url) -> Iterator[Check]:
    """Checks what drivers send there: of the sensor whose link it is, and of others that share it.

    The mission, which `companion preflight` knows, says whether that will do.
    """
    wanted = " or ".join(kind_of(name).MESSAGES.values())
    window = SensorWindow({**SENSORS, name: kind_of(name)}.values())
    try:
        link = open_link(url, hears_all=True)
    except LinkError as error:
        yield problem(name, "cannot be opened", wanted, str(error))
        return
    window.fill([link], streams=[url.scheme is Scheme.SERIAL], seconds=LISTEN_S)
    for other, tally in window.tallies.items():
        if not tally.is_empty:
            check = check_of(other, tally.describe(window.ended_s))
            heard = f"{check.found} (system/component)" if check.verdict is Verdict.PASS else check.found
            yield check.model_copy(update={"found": heard})
            if view := tally.describe_view():
                yield good(f"{other} view", view, "nearest, m, as it stands there; -: nothing, ?: unknown")
    if window.tallies[name].is_empty:
        found, fix = f"silence for {LISTEN_S:g} s", "is the driver running? Does it send there?"
        if window.byte_count:
            found, fix = f"{window.byte_count} bytes, no {wanted} in them", "does the driver send it?"
        yield problem(name, found, wanted, fix)


def _listen(url: Url) -> Iterator[bytes]:
    """All that comes in LISTEN_S. LinkError when the link cannot be opened."""
    yield from listen(open_link(url), LISTEN_S)


# --- the board ---


def wall_clock() -> Check:
    """Checks that the clock is set. Nothing in flight goes by it; logs and the age of reports do."""
    is_set = is_clock_set()
    wanted = "synchronised"
    now = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    if is_set:
        return good("clock", f"{now}, synchronised", wanted)
    state = "not synchronised" if is_set is False else "unknown whether synchronised"
    return doubt("clock", f"{now}, {state}", wanted, "timedatectl set-ntp true, or chrony with the GPS (gpsd)")


def governor() -> Check:
    """A CPU that sleeps deep answers late."""
    wanted = "performance, schedutil or ondemand"
    try:
        found = CPU.read_text().strip()
    except OSError:
        return doubt("governor", "unknown", wanted, "")
    if found in SLOW_GOVERNORS:
        fix = "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor"
        return doubt("governor", found, wanted, fix)
    return good("governor", printable(found), wanted)


def undervoltage() -> Iterator[Check]:
    """Checks the supply voltage where the board measures it (Raspberry Pi)."""
    for alarm in sorted(HWMON.glob(f"*/{ALARM}")):
        try:
            low = alarm.read_text().strip() != "0"
        except OSError:
            continue
        if low:
            yield problem("power", "undervoltage", "5 V", "a stronger supply: 5 V, 3 A, short thick wires")
        else:
            yield good("power", "5 V held", "5 V")


def unsigned() -> Check:
    """Companions on this computer that fly without keys, as they run, and as the service would start one."""
    wanted = "no companion with --unsigned"
    found = [f"{process.info['pid']}" for process in psutil.process_iter(["pid", "cmdline"]) if _is_unsigned(process)]
    if UNSIGNED in (told_by("systemctl", "show", UNIT, "--property=ExecStart") or ""):
        found.append(UNIT)
    if found:
        return doubt("unsigned", f"UNSIGNED: {', '.join(found)}", wanted, NEEDS_KEYS)
    return good("unsigned", "none", wanted)


def _is_unsigned(process: psutil.Process) -> bool:
    words = process.info["cmdline"] or ()
    return UNSIGNED in words and bool({"run", "base"} & set(words))


def service() -> Check:
    """Of systemd, if it is there."""
    told = told_by("systemctl", "show", UNIT, "--property=LoadState,ActiveState,SubState,NRestarts")
    if told is None:
        return good("service", "no systemd here")
    state = dict(line.partition("=")[::2] for line in told.splitlines())
    if state.get("LoadState") != "loaded":
        return good("service", f"{UNIT} is not installed")
    found = f"{UNIT} {state.get('ActiveState')} ({state.get('SubState')}), {state.get('NRestarts', '?')} restarts"
    restarts, wanted = state.get("NRestarts", "0"), "active, or stopped; 0 restarts"
    fix = f"journalctl -u {UNIT} -e tells why; `systemctl restart` counts from 0 again"
    is_looping = state.get("ActiveState") == "activating" and (
        restarts != "0" or "restart" in state.get("SubState", "")
    )
    if state.get("ActiveState") == "failed" or is_looping:
        return problem("service", found, wanted, fix)
    if restarts != "0":
        return doubt("service", found, wanted, fix)
    return good("service", found, wanted)
