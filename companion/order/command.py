"""`companion order`: listen, order, and see who acts on it; or a ground station's commands made orders."""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Final

from companion.keys.key_file import KeyFileError
from companion.keys.process import harden_process
from companion.mavlink.orders.order import OrderKind
from companion.order.ground_station import GroundStation
from companion.order.order_file import SUFFIX
from companion.order.radio import OperatorRadio, drain, open_operator, open_radio_link
from companion.order.station import OperatorStation, OrderFileError, list_ids, reason_of
from companion.shell.floods import FloodLog
from companion.shell.links import Link, LinkError
from companion.shell.runner import Stop
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT, EXIT_INTERRUPTED
from mission.common.problems import MissionError, printable
from mission.document.load import load_mission

EXIT_NOT_ALL = 1
LISTEN_S: Final = 3.0  # before a START, and where no flight is known: a boot is proven once a second
SETTLE_S: Final = 1.0  # after the last question, for what came meanwhile
SEEN_S: Final = 1.0  # sent at least so long: somebody may not have been heard yet
SHOWN_S: Final = 1.0  # between lines


class _RefusedError(Exception):
    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


def order(arguments: argparse.Namespace) -> int:
    """The exit code."""
    harden_process()
    output = _Output()
    try:
        with ExitStack() as opened:
            code = _order(arguments, opened, output)
            return code if output.is_whole else EXIT_ENVIRONMENT
    except _RefusedError as refusal:
        _warn(str(refusal))
        return refusal.code
    except OrderFileError as error:  # of a START: it was not sent
        _warn(f"{error}: nothing was ordered")
        return EXIT_BAD_FILE
    except OSError as error:
        _warn(f"{arguments.key}{SUFFIX}: {reason_of(error)}: nothing was ordered")
        return EXIT_ENVIRONMENT


def _order(arguments: argparse.Namespace, opened: ExitStack, output: _Output) -> int:
    try:
        mission = load_mission(arguments.mission)
        size = mission.swarm.size
        operator = open_operator(arguments.key, arguments.mission, size, arguments.peers, opened)
        is_gateway = arguments.order_command == "gateway"
        ground = open_radio_link(arguments.ground_station, opened) if is_gateway else None
    except KeyFileError as error:
        raise _RefusedError(EXIT_BAD_FILE, str(error)) from None
    except MissionError as error:
        raise _RefusedError(EXIT_BAD_FILE, f"the mission is refused\n{error}") from None
    except LinkError as error:
        raise _RefusedError(EXIT_ENVIRONMENT, str(error)) from None
    if operator.trouble:
        _warn(operator.trouble)
    station = operator.station
    with Stop() as stop:
        links = {"radio": operator.link} | ({} if ground is None else {"ground station's link": ground})
        radio = _Radio(operator, stop, FloodLog(links, lambda _now_s, text, _is_over: output.show(text)), output)
        if ground is not None:
            output.show(f"orders of {printable(str(arguments.ground_station))} go to {arguments.peers}")
            radio.serve(GroundStation(station, size, output.show), ground)
            return EXIT_DONE
        kind = OrderKind[arguments.order_command.upper()]
        if kind is OrderKind.START or not operator.knows_flight:
            radio.run(LISTEN_S)
        hand_back = 0
        if kind is OrderKind.START:
            hand_back = arguments.hand_back
            if not 0 <= hand_back <= size:
                raise _RefusedError(EXIT_BAD_FILE, f"--hand-back {hand_back}: the mission has the vehicles 1 to {size}")
            _refuse_stopped(stop)
            _confirm(station, size, arguments.yes, stop, output)
            radio.run(0.0 if arguments.yes else SETTLE_S)
        _refuse_stopped(stop)
        return _send(radio, kind, hand_back, arguments.for_s)


def _refuse_stopped(stop: Stop) -> None:
    if stop.reason:
        raise _RefusedError(EXIT_INTERRUPTED, f"{stop.reason}: nothing was ordered")


def _confirm(station: OperatorStation, size: int, yes: bool, stop: Stop, output: _Output) -> None:
    now_s = time.monotonic()
    heard, missing = station.vehicles(now_s), station.not_ready(now_s)
    output.show(f"ready: {list_ids([k for k in heard if k not in missing]) or 'none'}")
    for vehicle, why in missing.items():
        output.show(f"vehicle {vehicle}: {why}")
    if not heard:
        raise _RefusedError(EXIT_NOT_ALL, "no vehicle is heard: nothing was ordered")
    if yes:
        return
    if not sys.stdin.isatty():
        raise _RefusedError(EXIT_BAD_FILE, "a start is confirmed at a terminal, or with --yes: nothing was ordered")
    without = f", without {list_ids(list(missing))}" if missing else ""
    output.show(f"Start {size - len(missing)} of {size} vehicles{without}? [y/N] ", end="")
    if not output.is_whole:
        raise _RefusedError(EXIT_ENVIRONMENT, "the question cannot be shown: nothing was ordered")
    select.select((sys.stdin, stop.fileno()), (), ())
    _refuse_stopped(stop)
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):  # empty: its end
        raise _RefusedError(EXIT_BAD_FILE, "not confirmed: nothing was ordered")


def _send(radio: _Radio, kind: OrderKind, hand_back: int, for_s: float) -> int:
    """Until all that are heard act on it, or the time is up."""
    station, show, begun_s = radio.station, radio.output.show, time.monotonic()
    if warning := station.send_order(kind, begun_s, hand_back=hand_back):
        _warn(warning)

    def is_done(now_s: float) -> bool:
        return now_s - begun_s >= SEEN_S and bool(station.vehicles(now_s)) and not station.waits_for(now_s)

    radio.run(for_s, is_done)
    now_s = time.monotonic()
    heard, waits_for = station.vehicles(now_s), station.waits_for(now_s)
    aborted = station.overruled(now_s)
    acting = [vehicle for vehicle in heard if vehicle not in waits_for and vehicle not in aborted]
    if aborted:
        show(f"{kind.name}: ABORT stays in force, which is above it: {list_ids(aborted)}")
    if acting or not aborted:
        show(f"{kind.name}: {f'acting on it: {list_ids(acting)}' if acting else 'nobody is heard to act on it'}")
    if waits_for:
        show(f"{kind.name}: heard, and not acting on it: {list_ids(waits_for)}")
    if heard and not waits_for:
        return EXIT_DONE
    if radio.stopped:
        _warn(f"{radio.stopped}: {kind.name} is not sent any more")
        return EXIT_INTERRUPTED
    return EXIT_NOT_ALL


class _Radio:
    """The loop."""

    def __init__(self, operator: OperatorRadio, stop: Stop, floods: FloodLog, output: _Output) -> None:
        self.station = operator.station
        self.output = output
        self._operator, self._stop, self._floods = operator, stop, floods

    @property
    def stopped(self) -> str:
        """By which signal, or ""."""
        return self._stop.reason

    def run(self, for_s: float, is_done: Callable[[float], bool] = lambda _now_s: False) -> None:
        """Hear and send, for so long."""
        end_s = time.monotonic() + for_s
        while not self._stop.reason:
            now_s = self._turn()
            if now_s >= end_s or is_done(now_s):
                return

    def serve(self, ground_station: GroundStation, link: Link) -> None:
        """The same, with a ground station's commands, until it is stopped."""
        while not self._stop.reason:
            now_s = self._turn(link.fileno())
            drain(link, ground_station.receive, now_s)
            for datagram in ground_station.datagrams(now_s):
                link.send(datagram)

    def _turn(self, *fds: int) -> float:
        """Wait for data, or until something is due; hear, and send. The time."""
        operator = self._operator
        wait_s = max(0.0, operator.due_s - time.monotonic())
        select.select((operator.link.fileno(), *fds, self._stop.fileno()), (), (), wait_s)
        now_s = time.monotonic()
        operator.hear_radio(now_s)
        operator.send_due(now_s, self._floods, self.output.show)
        return now_s


class _Output:
    """Standard output. Nobody may read it any more, or its disk be full: an order is sent all the same."""

    def __init__(self) -> None:
        self.is_whole = True

    def show(self, line: str, end: str = "\n") -> None:
        """A line, to be read at once."""
        try:
            print(line, end=end, flush=True)
        except OSError as error:
            if self.is_whole and not isinstance(error, BrokenPipeError):
                _warn(f"cannot write: {os.strerror(error.errno or 0)}")
            self.is_whole = False


def _warn(line: str) -> None:
    with contextlib.suppress(OSError):
        print(f"companion: {line}", file=sys.stderr, flush=True)
