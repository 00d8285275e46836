"""`companion lidar`: read the lidar, and send its scans until it is stopped; or check how it is mounted."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import select
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from enum import Enum, auto
from typing import Final, Generic, Protocol, TypeVar

from companion.lidar.driver import Driver, Return
from companion.lidar.livox import COMMAND_PORT, Mid360
from companion.lidar.models import MODELS
from companion.lidar.mounting import Mounting
from companion.lidar.rays import RayScan
from companion.lidar.sectors import Limits, SectorScan, obstacle_distance
from companion.lidar.walk_around import WalkAround
from companion.mavlink.framing import wire
from companion.mavlink.lidar_scan import LIDAR_SCAN_ID, RAYS_MIN_SHARE
from companion.sensors.view import BAND_M, describe_view
from companion.shell.links import Link, LinkError, open_link, resolved
from companion.shell.urls import Scheme, Url, UrlError, is_ipv4, parse_url
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.files import os_words
from mission.common.problems import printable
from mission.common.signals import Stop
from mission.schema.kinds import RAW_LIDARS, SensorClass

EXIT_FAIL: Final = 1
EXIT_INTERRUPTED: Final = 130  # a check that a signal ended
WAIT_S: Final = 0.02  # the shortest pause between two requests of a driver
READS_PER_TURN: Final = 512  # a Mid-360 sends 2,100 datagrams/s
# Of these, the newest that are decoded: a computer that is too slow sees fewer points, not older ones.
FRESH_MAX: Final = 128
SILENT_S: Final = 2.0  # without a scan; the motor of one that begins takes as long
PATIENCE_S: Final = 10.0  # of a check
VIEW_S: Final = 1.0
HALF_DEG_RAYS: Final = 720  # a turn
ANSWERED: Final = 2  # that nobody listens to the one is told when the next is sent


def read_lidar(arguments: argparse.Namespace) -> int:
    """Until SIGINT or SIGTERM, or a check's end; the exit code."""
    problem = _usage_problem(arguments)
    if problem:
        return _refused(EXIT_BAD_FILE, problem)
    limits, mounting = _limits(arguments), Mounting(arguments.yaw_deg, arguments.upside_down, arguments.mask)
    with ExitStack() as opened:
        try:
            if arguments.check:
                return _check(arguments, limits, mounting, opened)
            _send(arguments, limits, mounting, opened)
        except (LinkError, UrlError) as error:
            return _refused(EXIT_ENVIRONMENT, str(error))
        except OSError as error:
            return _refused(EXIT_ENVIRONMENT, os_words(error))
    return EXIT_DONE


Told = TypeVar("Told")


class Collector(Protocol[Told]):
    """Makes of returns what is told: `SectorScan`, `RayScan`."""

    def update(self, returns: Iterable[Return], now_s: float) -> list[Told]:
        """Takes in returns; the scans, or pieces, that they complete. `now_s`: when they were read, monotonic."""


class State(Enum):
    """Of a lidar that is read."""

    UNPLUGGED = auto()
    SILENT = auto()
    SCANNING = auto()


class Reader(Generic[Told]):
    """A lidar's link, driver and scans in turns; says what changes on stderr."""

    def __init__(self, url: Url, link: Link, driver: Driver, scan: Collector[Told], control: Link | None) -> None:
        """`control`: the link to a Mid-360's command port; a serial lidar takes requests where it is read."""
        self.scanned_s = time.monotonic()  # the last scan, or the beginning
        self._url, self._link, self._driver, self._scan, self._control = url, link, driver, scan, control
        self._bytes = 0
        self._state: State | None = None

    def read_scans(self) -> list[Told]:
        """Scans, or pieces, that one turn completes: requests are sent, what there is is read, or waited for."""
        request = self._driver.poll(time.monotonic())
        if request:
            (self._control or self._link).send(request)
        links = [link for link in (self._link, self._control) if link is not None and link.fileno() >= 0]
        select.select([link.fileno() for link in links], [], [], WAIT_S)
        fresh: deque[bytes] = deque(maxlen=FRESH_MAX)
        for _ in range(READS_PER_TURN):
            data = self._link.recv()
            if data is None:
                break
            self._bytes += len(data)
            fresh.append(data)
        scans: list[Told] = []
        for data in fresh:
            scans += self._scan.update(self._driver.decode(data), time.monotonic())
        self._read_control()
        self._tell_changes(bool(scans))
        return scans

    def stop_lidar(self) -> None:
        """Its laser and motor, where it can be told."""
        request = self._driver.shutdown()
        if request:
            self._link.send(request)

    def describe_silence(self) -> str:
        """The reasons that there may be for no scan, for people."""
        if not self._link.up:
            return f"no {self._url.place}: is it plugged in? Opened once it is there (ls /dev/serial/by-id lists all)"
        if not self._bytes:
            if self._link.lost:
                return f"{self._link.lost} datagrams at {self._url} are too long for a lidar: another program's?"
            return f"nothing is received at {self._url}: power, wiring, address?"
        if isinstance(self._driver, Mid360):
            return (
                f"no scan in {self._bytes} bytes received at {self._url}, {self._driver.bad} datagrams are no points "
                "of a Mid-360: is one at this port? Its data type and return mode (Livox Viewer 2), or --configure"
            )
        return (
            f"no scan in {self._bytes} bytes received at {self._url}, {self._driver.bad} of them part of no packet: is "
            "--model right, and the baud rate? Does it turn?"
        )

    def _read_control(self) -> None:
        if self._control is not None and isinstance(self._driver, Mid360):
            while (answer := self._control.recv()) is not None:
                self._driver.decode_answer(answer)

    def _tell_changes(self, has_scan: bool) -> None:
        for note in self._driver.notes:
            log_line(note)
        self._driver.notes.clear()
        now_s = time.monotonic()
        if has_scan:
            self.scanned_s = now_s
        before = self._state
        if not self._link.up:
            self._state = State.UNPLUGGED
        elif now_s - self.scanned_s > SILENT_S:
            self._state = State.SILENT
        elif has_scan:
            self._state = State.SCANNING
        if self._state is State.SCANNING and before is not State.SCANNING:
            log_line(f"scans arrive from {self._url}")
        elif self._state is not before:
            log_line(self.describe_silence())


def log_line(text: str) -> None:
    """A line of the log."""
    with contextlib.suppress(OSError):
        print(f"companion lidar: {text}", file=sys.stderr, flush=True)


def _send(arguments: argparse.Namespace, limits: Limits, mounting: Mounting, opened: ExitStack) -> None:
    """Until it is stopped. LinkError, OSError, UrlError."""
    sender = wire.Sender(arguments.id, arguments.component)

    def frame_sectors(scan_cm: list[int]) -> bytes:
        return sender.pack(obstacle_distance(scan_cm, limits, time.monotonic()))

    def frame_rays(payload: bytes) -> bytes:
        return sender.frame(LIDAR_SCAN_ID, payload)

    if arguments.raw is None:
        _forward(_open_reader(arguments, SectorScan(limits, mounting), opened), frame_sectors, arguments, opened, None)
    else:
        rays = RayScan(limits, mounting, RAW_LIDARS[SensorClass(arguments.raw)])
        count = RayCount(rays, arguments.raw)
        _forward(_open_reader(arguments, rays, opened), frame_rays, arguments, opened, count)


def _forward(
    reader: Reader[Told],
    frame: Callable[[Told], bytes],
    arguments: argparse.Namespace,
    opened: ExitStack,
    count: RayCount | None,
) -> None:
    out = open_link(arguments.to)
    opened.callback(out.close)
    stop = opened.enter_context(Stop())
    refusals = Refusals(arguments.to)
    due_s, sent = time.monotonic(), 0
    while not stop.asked:
        for told in reader.read_scans():
            out.send(frame(told))
            sent += 1
        if time.monotonic() >= due_s:
            due_s = time.monotonic() + SILENT_S
            for change in (refusals.update(sent, out.errors), count.update() if count else ""):
                if change:
                    log_line(change)
    reader.stop_lidar()


class RayCount:
    """Says when too few of a turn's rays are sampled for the class that is sent, and when enough are again.

    They are sent nevertheless: in flight a lidar with gaps is better than none, and before it the preflight fails.
    """

    def __init__(self, rays: RayScan, raw: str) -> None:
        self._rays, self._raw = rays, raw
        self._is_short = False

    def update(self) -> str:
        """A line that follows from the turns since the last call, or ""."""
        counted = self._rays.take_rays_a_turn()
        is_short = self._is_short if counted is None else counted[0] < RAYS_MIN_SHARE * counted[1]
        if counted is None or is_short is self._is_short:
            return ""
        self._is_short = is_short
        found = f"{counted[0]} of {counted[1]} rays a turn are sampled"
        if not is_short:
            return f"{found}: enough for --raw {self._raw}"
        return f"{found}: ERROR, too few for --raw {self._raw}, no preflight passes; more samples, or a coarser class"


class Refusals:
    """Says when what is sent begins to be refused, and when it ceases: UDP tells no more of who listens."""

    def __init__(self, to: Url) -> None:
        self._to = to
        self._sent = self._errors = 0
        self._refused = False

    def update(self, sent: int, errors: int) -> str:
        """A line that follows from the counts until now, or ""; of a while in which nothing is sent nothing does."""
        is_refused = errors > self._errors
        if not is_refused and sent < self._sent + ANSWERED:
            return ""
        self._sent, self._errors = sent, errors
        if is_refused is self._refused:
            return ""
        self._refused = is_refused
        return f"nobody listens at {self._to}" if is_refused else f"scans to {self._to} are refused no more"


def _check(arguments: argparse.Namespace, limits: Limits, mounting: Mounting, opened: ExitStack) -> int:
    """By sectors, whatever is sent later: a person is wide. LinkError, OSError, UrlError."""
    reader = _open_reader(arguments, SectorScan(limits, mounting), opened)
    stop = opened.enter_context(Stop())
    max_cm = round(limits.max_m * 100.0)
    walk = WalkAround(max_cm, yaw_deg=mounting.yaw_deg, upside_down=mounting.upside_down)
    _show(walk.begin())
    shown_s = -VIEW_S
    while walk.passed is None and not stop.asked:
        for scan_cm in reader.read_scans():
            _show(walk.update(scan_cm))
            if time.monotonic() - shown_s >= VIEW_S:
                shown_s = time.monotonic()
                _show([f"  {describe_view(scan_cm, max_cm)}"])
        if time.monotonic() - reader.scanned_s > PATIENCE_S:
            return _refused(EXIT_ENVIRONMENT, reader.describe_silence())
    reader.stop_lidar()
    if walk.passed is None:
        _show(["STOPPED: the check was not walked to its end"])
        return EXIT_INTERRUPTED
    return EXIT_DONE if walk.passed else EXIT_FAIL


def _show(lines: list[str]) -> None:
    for line in lines:
        print(line, flush=True)


def _usage_problem(arguments: argparse.Namespace) -> str:
    """Options that do not go together; "" when they do."""
    is_mid360 = arguments.model == "mid360"
    wanted = Scheme.UDP_IN if is_mid360 else Scheme.SERIAL
    if arguments.lidar.scheme is not wanted:
        return f"--lidar {arguments.lidar}: a {arguments.model} is read at {wanted}://"
    if not arguments.check and (arguments.id is None or arguments.to is None):
        return "--id and --to are needed, but for --check"
    if arguments.id is not None and not 1 <= arguments.id <= 250:
        return f"--id {arguments.id}: must be 1 to 250"
    if not 2 <= arguments.component <= 255:
        return f"--component {arguments.component}: must be 2 to 255; 1 is the autopilot's"
    if not -360.0 <= arguments.yaw_deg <= 360.0:
        return f"--yaw-deg {arguments.yaw_deg:g}: must be -360 to 360"
    limits = MODELS[arguments.model].limits
    if arguments.range_m is not None and not limits.min_m < arguments.range_m <= limits.max_m:
        return f"--range-m {arguments.range_m:g}: must be above {limits.min_m:g}, and at most {limits.max_m:g}"
    if arguments.raw is not None and (arguments.raw == SensorClass.MULTI_LAYER) is not is_mid360:
        return f"--raw {arguments.raw}: a mid360 is multi-layer, and no other is"
    rays = MODELS[arguments.model].rays_a_turn
    if arguments.raw == SensorClass.SCAN_HALF_DEG and rays is not None and rays < HALF_DEG_RAYS:
        return f"--raw {arguments.raw}: an {arguments.model} is scan-1deg, of {rays} rays a turn, not {HALF_DEG_RAYS}"
    if arguments.band_m is not None and not is_mid360:
        return f"--band-m: is for a mid360; a {arguments.model} measures in one plane"
    return _configure_problem(arguments)


def _configure_problem(arguments: argparse.Namespace) -> str:
    """As `_usage_problem`: of --configure."""
    if arguments.configure is not None:
        if arguments.model != "mid360":
            return f"--configure {printable(arguments.configure)}: is for a mid360"
        try:
            address = _command_url(arguments.configure).place
        except UrlError:
            address = ""
        if not is_ipv4(address):
            return f"--configure {printable(arguments.configure)}: must be the lidar's ADDRESS[:PORT], as 192.168.1.112"
        if not is_ipv4(arguments.lidar.place) or arguments.lidar.place == "0.0.0.0":
            return (
                f"--lidar {arguments.lidar}: with --configure, this computer's own IPv4 address on the lidar's network"
            )
    return ""


def _limits(arguments: argparse.Namespace) -> Limits:
    limits = MODELS[arguments.model].limits
    if arguments.range_m is not None:
        limits = dataclasses.replace(limits, max_m=arguments.range_m)
    # What is measured in one plane is all in the band
    return dataclasses.replace(limits, band_m=arguments.band_m or BAND_M) if arguments.model == "mid360" else limits


def _open_reader(arguments: argparse.Namespace, scan: Collector[Told], opened: ExitStack) -> Reader[Told]:
    """LinkError, OSError, UrlError."""
    url: Url = arguments.lidar
    # The motor of an RPLIDAR A1 turns while its adapter's DTR is off.
    link = open_link(url, may_be_absent=True, dtr=False)
    opened.callback(link.close)
    driver, control = MODELS[arguments.model].make(), None
    if arguments.configure is not None:
        control = open_link(_command_url(arguments.configure))
        opened.callback(control.close)
        driver = Mid360(resolved(url))
    return Reader(url, link, driver, scan, control)


def _command_url(address: str) -> Url:
    """Of a Mid-360's command port, by `ADDRESS[:PORT]`. UrlError."""
    address = address if ":" in address else f"{address}:{COMMAND_PORT}"
    return parse_url(f"udpout://{address}", frozenset({Scheme.UDP_OUT}))


def _refused(code: int, why: str) -> int:
    print(f"companion: {why}", file=sys.stderr)
    return code
