"""`companion base`: the base station on a laptop, until it is stopped."""

from __future__ import annotations

import argparse
import contextlib
import select
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Final, TextIO

from companion.base.pace import Pace
from companion.base.station import BaseStation
from companion.keys.key_file import KeyFileError
from companion.mavlink.peers.guard import SignedGuard
from companion.records.node import open_base
from companion.records.signed.intake import FORGED
from companion.records.store import StoreError
from companion.shell.floods import FloodLog
from companion.shell.links import Link, LinkError, open_link
from companion.shell.radio_keys import NoKeyError, choose_key, open_base_session
from companion.shell.records import draw_log
from companion.shell.runner import Stop
from mission.common.exit_codes import EXIT_BAD_FILE, EXIT_DONE, EXIT_ENVIRONMENT
from mission.common.problems import MissionError, printable
from mission.document.load import load_mission
from mission.document.model import Mission

TICK_S: Final = 0.05
READS_MAX: Final = 512  # datagrams before the next tick,
READS_S: Final = 0.03  # and for how long: a flood keeps no answer waiting
SHOWN_S: Final = 1.0  # between lines of progress, where they overwrite one another,
LOGGED_S: Final = 10.0  # and where each stays
UNSIGNED: Final = "UNSIGNED (--unsigned): whoever is in radio range can write records, and have vehicles delete theirs"
NAMED_MAX: Final = 8  # vehicles out of range that are named; more are counted
GAPS_MAX: Final = 8  # logs whose missing numbers are named at the end


def base(arguments: argparse.Namespace) -> int:
    """Until SIGINT or SIGTERM; the exit code."""
    with ExitStack() as opened:
        try:
            mission = _mission(arguments.mission)
            size = mission.swarm.size
            key = choose_key(
                arguments.key, unsigned=arguments.unsigned, what="the swarm, and writes records", size=size
            )
            session = open_base_session(key, arguments.mission)
            file = Path(arguments.records)
            records = open_base(mission, file, draw_log, made_s=int(time.time()), session=session)
            opened.callback(records.store.close)
            link = open_link(arguments.listen, hears_all=True)
            opened.callback(link.close)
        except MissionError as error:
            return _refused(EXIT_BAD_FILE, error)
        except KeyFileError as error:
            return _refused(EXIT_BAD_FILE, f"companion: --key {error}")
        except (NoKeyError, ValueError) as error:
            return _refused(EXIT_BAD_FILE, f"companion: {error}")
        except StoreError as error:
            return _refused(EXIT_ENVIRONMENT, f"companion: --records {printable(arguments.records, 200)}: {error}")
        except LinkError as error:
            return _refused(EXIT_ENVIRONMENT, f"companion: --listen {error}")
        station = BaseStation(records, None if session is None else SignedGuard(session))
        shown = Terminal(sys.stdout)
        shown.line(
            f"base station of {mission.name or 'unnamed'!r} on {arguments.listen}, records in {arguments.records}"
        )
        if key is None:
            shown.line(UNSIGNED)
        with Stop() as stop:
            serve(station, link, stop, shown)
        more = describe_unknown(station, time.monotonic())
        shown.line(f"{station.text}{more and f'; {more}'}")
        for line in gaps(station):
            shown.line(line)
        forged = records.dropped.get(FORGED, 0)
        if forged:
            shown.line(f"refused, as forged by a member of the swarm: {forged}")
    return EXIT_DONE


def serve(station: BaseStation, link: Link, stop: Stop, shown: Terminal) -> None:
    """Hear and answer until `stop` has a reason."""
    pace = Pace()
    floods = FloodLog({"radio": link}, lambda _now_s, text, _is_over: shown.line(text))
    deadline_s = time.monotonic()
    while not stop.reason:
        select.select((link.fileno(), stop.fileno()), (), (), max(0.0, deadline_s - time.monotonic()))
        now_s = time.monotonic()
        for _ in range(READS_MAX):
            data = link.recv()
            if data is None:
                break
            station.receive(data, now_s)
            if time.monotonic() - now_s >= READS_S:
                break
        if now_s < deadline_s:
            continue
        deadline_s = max(deadline_s + TICK_S, now_s)
        for datagram in station.tick(now_s):
            link.send(datagram)
        for line in station.lines():
            shown.line(line)
        floods.update(now_s)
        shown.progress(describe(station, pace, now_s), now_s)


def describe(station: BaseStation, pace: Pace, now_s: float) -> str:
    """The progress, the stand so far, how fast records arrive, and who is near, in a line."""
    near = station.in_range(now_s)
    vehicles = f"vehicles {', '.join(map(str, near))} in range" if near else "no vehicle in range"
    more = describe_unknown(station, now_s)
    progress = station.progress
    rate = pace.describe(progress.delivered, progress.made, now_s)
    return f"{station.text}{rate}, {vehicles}{more and f'; {more}'}"


def describe_unknown(station: BaseStation, now_s: float) -> str:
    """Vehicles whose newest records are not among those counted; "": none that is known of."""
    away = station.may_hold_more(now_s)
    if not away:
        return ""
    named = ", ".join(map(str, away)) if len(away) <= NAMED_MAX else f"{len(away)} others"
    return f"{named} out of range: may hold more"


def gaps(station: BaseStation) -> list[str]:
    """Records that somebody told of, and that never came."""
    found = station.records.missing()
    lines = []
    for key, missing in list(found.items())[:GAPS_MAX]:
        numbers = ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in missing[:GAPS_MAX])
        lines.append(f"missing of vehicle {key.vehicle_id}, log {key.log_id:08x}: {numbers}")
    return lines


class Terminal:
    """Lines, and one of progress: in its place on a terminal, else from time to time."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._overwrites = out.isatty()
        self._shown = ""
        self._shown_s = float("-inf")

    def line(self, text: str) -> None:
        """Print a line that stays."""
        self._write(f"{self._cleared()}{printable(text, 300)}\n")
        self._shown = ""

    def progress(self, text: str, now_s: float) -> None:
        """The newest progress, where it has changed."""
        if text == self._shown or now_s - self._shown_s < (SHOWN_S if self._overwrites else LOGGED_S):
            return
        self._write(f"{self._cleared()}{text}" + ("" if self._overwrites else "\n"))
        self._shown, self._shown_s = text, now_s

    def _cleared(self) -> str:
        return "\r\x1b[K" if self._overwrites else ""

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError):  # nobody reads it: records are stored all the same
            self._out.write(text)
            self._out.flush()


def _mission(path: str) -> Mission:
    mission = load_mission(path)
    if not mission.keeps_records:
        raise ValueError(f"{printable(path)} has no [survey], no [[payload]]: its vehicles keep no records")
    return mission


def _refused(code: int, why: object) -> int:
    print(why, file=sys.stderr)
    return code
