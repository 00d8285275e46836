"""`companion run`: the mission looked at, the links opened, the flight flown until it is stopped."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import os
import sys
import time
import traceback
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from companion.cloud.returns_log import ReturnsLog
from companion.journal.recorder import BlackBox, Recorder, start_body
from companion.keys.key_file import KeyFileError
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.frames import DATAGRAM_MAX_BYTES
from companion.mavlink.makes import load_installed_makes
from companion.mavlink.peers.session import Session
from companion.payload.recorder import payload_of
from companion.preflight.computer import is_clock_set, now
from companion.preflight.report import Clearance, clearance
from companion.sensors.table import SENSORS, kinds_of, sensors_of
from companion.shell.box.opening import box_folder, file_in_the_way, open_black_box, read_mission_file
from companion.shell.flight_log import ChangeLogger, FlightLog, summary
from companion.shell.links import RECV_BYTES, Link, LinkError, open_link
from companion.shell.orders import OldOrdersError
from companion.shell.radio_keys import NoKeyError, RadioKeys, choose_key, open_keys
from companion.shell.runner import Runner, Stop
from companion.shell.service import Service
from companion.shell.urls import Scheme, Url
from companion.survey.of_mission import survey_of
from mission import __version__
from mission.common.compiled import STATE
from mission.common.entry_points import TITLE_MAX_CHARS, EntryPointError
from mission.common.problems import MissionError, printable
from mission.document.load import MAX_PLACE_CHARS, load_mission
from mission.document.model import Mission

if TYPE_CHECKING:
    from companion.records.exchange import RecordExchange

SIGNING = "signing"  # the check that saw the autopilot refuse who has no key
EXIT_DONE = 0
EXIT_BROKEN = 1  # a broken invariant; the traceback is in the log
EXIT_REFUSED = 2  # wrong usage or a bad mission; argparse uses the same
EXIT_ENVIRONMENT = 3  # a port, a device or a file that cannot be opened
REST_S = 1.0  # systemd waits for 2 s (TimeoutStopSec), and the black box is to be closed, too
POLL_S = 0.01


class RefusedError(Exception):
    """The flight cannot start."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


def main(arguments: argparse.Namespace) -> int:
    """`run` or `preflight`; returns the exit code."""
    try:
        mission = mission_of(arguments)
        if arguments.command == "preflight":
            from companion.preflight.command import preflight  # not kept by a flight

            return preflight(arguments, mission)
    except RefusedError as refusal:
        return _refused(refusal)
    return run(arguments, mission)


def run(arguments: argparse.Namespace, mission: Mission) -> int:
    """`companion run`, its command line parsed and its mission loaded (`mission_of`); returns the exit code."""
    try:
        with ExitStack() as opened:
            return _run(arguments, mission, opened)
    except RefusedError as refusal:
        return _refused(refusal)


def _refused(refusal: RefusedError) -> int:
    print(f"companion: {refusal}", file=sys.stderr)
    return refusal.code


def mission_of(arguments: argparse.Namespace) -> Mission:
    """The mission, fit for a real flight of this vehicle. RefusedError."""
    path: str = arguments.mission
    vehicle_id: int = arguments.id
    try:
        load_installed_makes()
    except EntryPointError as error:
        raise RefusedError(EXIT_REFUSED, f"make of autopilot {printable(str(error), TITLE_MAX_CHARS)}") from None
    try:
        mission = load_mission(path)
        flown = kinds_of(mission)
    except MissionError as error:
        raise RefusedError(EXIT_REFUSED, f"the mission is refused\n{error}") from None
    if not 1 <= vehicle_id <= mission.swarm.size:
        raise RefusedError(
            EXIT_REFUSED, f"--id {vehicle_id}: {printable(path)} has the vehicles 1 to {mission.swarm.size}"
        )
    if mission.origin is None:
        raise RefusedError(
            EXIT_REFUSED,
            f"{printable(path)}: a real flight needs [origin], where on Earth its frame starts. Add\n"
            "  [origin]\n  lat_deg = ...\n  lon_deg = ...\n  alt_m = ...  # of the ground, above sea level",
        )
    for name, url in arguments.sensors.items():
        if name not in flown:
            raise RefusedError(EXIT_REFUSED, f"--sensor {name}={url}: {printable(path)} {_unused(name)}")
    if arguments.command == "run" and arguments.records is not None and not mission.keeps_records:
        raise RefusedError(
            EXIT_REFUSED, f"--records: {printable(path)} has no [survey], no [[payload]]: there are none"
        )
    for kind in flown.values() if arguments.command == "run" and not arguments.sensors else ():
        if kind.NEEDS_LINK:
            raise RefusedError(
                EXIT_REFUSED,
                f"{printable(path)}: {kind.NEEDS_LINK}, so --sensor {kind.NAME}=URL is needed: the link to the "
                f"{kind.TITLE}'s driver",
            )
    return mission


def _unused(name: str) -> str:
    """Words for a mission that does not fly by this sensor."""
    return SENSORS[name].UNUSED if name in SENSORS else f'does not name it: sensors = ["{name}"]'


def _run(arguments: argparse.Namespace, mission: Mission, opened: ExitStack) -> int:
    """Open what the flight needs, fly, say why it ended."""
    by_vehicle = arguments.clock == "vehicle"
    try:
        key = choose_key(arguments.key, unsigned=arguments.unsigned, what="this vehicle", size=mission.swarm.size)
    except NoKeyError as error:
        raise RefusedError(EXIT_REFUSED, str(error)) from None
    if arguments.sign_autopilot and key is None:
        raise RefusedError(EXIT_REFUSED, "--sign-autopilot: signs with the vehicle's key: --key FILE is needed")
    urls: dict[str, Url] = arguments.sensors
    stop = opened.enter_context(Stop())
    log_fd = _log_fd(arguments.log, opened)
    log = FlightLog(log_fd)
    # A simulator in lockstep hands over what has gathered at once, and nobody else is on its links.
    most = RECV_BYTES if by_vehicle else DATAGRAM_MAX_BYTES
    autopilot = _open("--autopilot", arguments.autopilot, opened, most, may_be_absent=True)
    peers = _open("--peers", arguments.peers, opened, most)
    sensors = {
        name: _open(f"--sensor {name}", url, opened, most, may_be_absent=True, hears_all=True)
        for name, url in urls.items()
    }
    try:
        survey = survey_of(mission, arguments.id, keeps_returns=True)
    except ModuleNotFoundError as error:
        raise RefusedError(
            EXIT_ENVIRONMENT,
            f"the mission has [survey], which needs {error.name}: in the checkout, pip install -e '.[survey]'",
        ) from None
    radio = _radio_keys(key, arguments, mission, opened)
    records, unstored = _records(arguments, mission, opened, log, radio.session)
    returns = _returns(arguments, mission, opened, log)
    needs = (SIGNING,) if arguments.sign_autopilot else ()
    report = (arguments.preflight, arguments.waive, arguments.mission, arguments.id)
    cleared = clearance(*report, now=now(), is_clock_set=is_clock_set, needs=needs)
    if unstored:  # in the air it flies on, as a card may fail between two starts
        cleared = replace(cleared, grounded="; ".join(filter(None, (f"records: {unstored}", cleared.grounded))))
    box = _black_box(arguments, mission, cleared, radio)
    endpoint = Endpoint(
        mission,
        arguments.id,
        sensors=sensors_of(mission),
        autopilot_is_stream=arguments.autopilot.scheme is Scheme.SERIAL,
        sensor_streams={name: url.scheme is Scheme.SERIAL for name, url in urls.items()},
        survey=survey,
        payload=payload_of(mission, arguments.id),
        records=records if box is None else box.record_link(records),
        guard=radio.guard if box is None else box.record_guard(radio.guard),
        orders=radio.orders if box is None else box.record_orders(radio.orders),
        autopilot_gate=radio.autopilot_gate if box is None else box.record_gate(radio.autopilot_gate),
    )
    endpoint.agent.ground(cleared.grounded)
    endpoint.agent.waive(",".join(cleared.waived), cleared.unknown, unsigned=key is None)
    recorder = None if box is None else box.record_endpoint(endpoint)
    changes = ChangeLogger(log, endpoint, autopilot, peers, sensors, (recorder or endpoint).report_surroundings)
    service = Service(os.environ, os.getpid())
    opened.callback(service.close)
    runner = Runner(endpoint, autopilot, peers, changes, stop, service, sensors, recorder, returns)
    log.line(None, _start_line(arguments, mission))
    for line in radio.lines:
        log.line(None, line)
    for link, url in ((autopilot, arguments.autopilot), *((link, urls[name]) for name, link in sensors.items())):
        if not link.up:  # USB is late at boot; the companion says so in its status too
            log.line(
                None,
                f"no {url.place}: is it plugged in? Opened once it is there (ls /dev/tty* /dev/serial/by-id lists all)",
            )
    faulthandler.enable(log_fd)  # where it hung: the watchdog ends a hung companion by SIGABRT
    opened.callback(faulthandler.disable)
    if cleared.waived:
        log.line(None, f"preflight WAIVED: {', '.join(cleared.waived)}")
    if cleared.unknown:
        log.line(None, cleared.unknown)
    log.line(None, f"GROUNDED, nothing is armed: {cleared.grounded}" if cleared.grounded else "cleared to arm")
    gc.collect()
    gc.freeze()  # what is there now stays: later collections need not look at it
    try:
        if by_vehicle:
            runner.by_vehicle((recorder or endpoint).hello())
        else:
            runner.by_monotonic()
    except Exception:  # noqa: BLE001  not swallowed: the process ends here, and setpoints with it
        log.broken(runner.now_s, traceback.format_exc())
        _close(recorder, "broken", changes, runner)
        _write_rest(records, returns, log, runner.now_s)
        return EXIT_BROKEN
    service.stopping()
    _write_rest(records, returns, log, runner.now_s)
    changes.log_records(runner.now_s)
    _close(recorder, f"stopped by {stop.reason}", changes, runner)
    log.line(
        runner.now_s,
        f"stopped by {stop.reason}, nothing is commanded any more; ticks {runner.ticks}, "
        f"missed {runner.missed}, {summary(changes.counters())}, log lines lost {log.lost}",
    )
    return EXIT_DONE


def _radio_keys(key: str | None, arguments: argparse.Namespace, mission: Mission, opened: ExitStack) -> RadioKeys:
    try:
        return open_keys(
            key,
            arguments.mission,
            arguments.id,
            mission.swarm.size,
            arguments.log,
            opened,
            beside_loop=arguments.clock == "monotonic",
            signs_autopilot=arguments.sign_autopilot,
        )
    except KeyFileError as error:
        raise RefusedError(EXIT_REFUSED, f"--key {error}") from None
    except OldOrdersError as error:
        raise RefusedError(EXIT_REFUSED, str(error)) from None
    except OSError as error:
        raise RefusedError(
            EXIT_ENVIRONMENT, f"the file of the operator's orders: {error.filename}: {error.strerror}"
        ) from None


def _records(
    arguments: argparse.Namespace, mission: Mission, opened: ExitStack, log: FlightLog, session: Session | None
) -> tuple[RecordExchange | None, str]:
    """Of a mission that keeps some; and why they are in memory alone, or "". `session`: of a radio with keys."""
    if not mission.keeps_records:
        return None, ""
    from companion.records.store import StoreError  # SQLite, which other flights need not keep
    from companion.shell.records import records_of, records_path

    path = records_path(arguments.records, arguments.log, mission, arguments.id)
    mission_file, beside_loop = Path(arguments.mission), arguments.clock == "monotonic"
    try:
        records = records_of(
            *(mission, arguments.id, path, opened), mission_file=mission_file, beside_loop=beside_loop, session=session
        )
    except StoreError as error:
        raise RefusedError(EXIT_REFUSED, f"--records {printable(str(path), MAX_PLACE_CHARS)}: {error}") from None
    where = f"in memory alone, not in {path}, {records.unstored}" if records.unstored else f"in {path}"
    log.line(None, f"records {where}: {records.progress()}")
    return records, records.unstored


def _returns(arguments: argparse.Namespace, mission: Mission, opened: ExitStack, log: FlightLog) -> ReturnsLog | None:
    """The file of a survey's returns."""
    if mission.survey is None:
        return None
    from companion.shell.records import open_returns, records_path

    path = records_path(arguments.records, arguments.log, mission, arguments.id)
    returns, file = open_returns(path, opened, beside_loop=arguments.clock == "monotonic")
    log.line(None, f"returns of stems in {file}")
    return returns


def _black_box(
    arguments: argparse.Namespace, mission: Mission, cleared: Clearance, radio: RadioKeys
) -> BlackBox | None:
    """A black box, where one is asked for, or the service has a place for it. No disk keeps a flight from starting.

    A path that was given and can be no folder does: it is a slip, of which the flight would have no box.
    """
    folder = box_folder(arguments.black_box)
    if folder is None:
        return None
    if arguments.black_box is not None and (file := file_in_the_way(folder)) is not None:
        raise RefusedError(EXIT_ENVIRONMENT, f"--black-box {printable(str(file), MAX_PLACE_CHARS)}: is not a folder")
    text, sha256 = read_mission_file(arguments.mission)
    urls: dict[str, Url] = arguments.sensors
    start = start_body(
        mission,
        text,
        sha256,
        arguments.id,
        sensors=list(kinds_of(mission)),
        clock=arguments.clock,
        started=datetime.now(UTC),
        autopilot_is_stream=arguments.autopilot.scheme is Scheme.SERIAL,
        sensor_streams={name: url.scheme is Scheme.SERIAL for name, url in urls.items()},
        has_survey=mission.survey is not None,
        has_records=mission.keeps_records,
        grounded=cleared.grounded,
        waived=",".join(cleared.waived),
        unknown=cleared.unknown,
        unsigned=radio.guard is None,
        guard=radio.guard,
        orders=radio.orders,
        autopilot_signed=radio.autopilot_gate is not None,
    )
    return open_black_box(folder, start, beside_loop=arguments.clock == "monotonic")


def _write_rest(
    records: RecordExchange | None, returns: ReturnsLog | None, log: FlightLog, now_s: float | None
) -> None:
    """Write records and returns that wait for the disk; those that it does not take in time are told as lost."""
    until_s, at_s = time.monotonic() + REST_S, now_s or 0.0
    while True:
        left = (0 if records is None else records.finish(at_s), 0 if returns is None else returns.finish())
        if not any(left) or time.monotonic() >= until_s:
            break
        time.sleep(POLL_S)
    lines = [*([] if records is None else records.lines()), *([] if returns is None else returns.take_lines())]
    for name, count in zip(("records", "returns"), left, strict=True):
        if count:
            lines.append(f"{name}: {count} LOST: not on the disk by the end")
    for line in lines:
        log.line(now_s, line)


def _close(recorder: Recorder | None, why: str, changes: ChangeLogger, runner: Runner) -> None:
    """The end of the black box; its last link, so that nobody can write another log that ends so."""
    if recorder is not None:
        recorder.close(why)
        head = f"black box: {recorder.journal.ticks} ticks, head of the chain {recorder.journal.link.hex()}"
        changes.log_lines(runner.now_s, [*recorder.take_lines(), head])


def _start_line(arguments: argparse.Namespace, mission: Mission) -> str:
    utc = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    sensors = "".join(f"{name} {url}, " for name, url in arguments.sensors.items())
    return (
        f"companion {__version__}, {STATE}, vehicle {arguments.id} of {mission.swarm.size}, "
        f"mission {mission.name or 'unnamed'!r}, autopilot {arguments.autopilot}, peers {arguments.peers}, "
        f"{sensors}clock {arguments.clock}, started {utc}"
    )


def _log_fd(path: str | None, opened: ExitStack) -> int:
    if path is None:
        return sys.stderr.fileno()
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NONBLOCK
    try:
        fd = os.open(path, flags, 0o644)
    except (OSError, ValueError) as error:
        reason = (isinstance(error, OSError) and error.strerror) or str(error)
        raise RefusedError(
            EXIT_ENVIRONMENT, f"--log {printable(path)}: cannot be opened for writing: {reason}"
        ) from None
    opened.callback(os.close, fd)
    return fd


def _open(
    option: str, url: Url, opened: ExitStack, most: int, *, may_be_absent: bool = False, hears_all: bool = False
) -> Link:
    """`most`: bytes of a datagram."""
    try:
        link = open_link(url, may_be_absent=may_be_absent, hears_all=hears_all, datagram_max_bytes=most)
    except LinkError as error:
        raise RefusedError(EXIT_ENVIRONMENT, f"{option} {error}") from None
    opened.callback(link.close)
    return link
