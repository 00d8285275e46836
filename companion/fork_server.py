"""Companions by fork: the program is loaded once, each companion starts in milliseconds and shares what was loaded.

Internal: `sim-bridge` starts its companions so; on a vehicle, one companion is executed. Standard input is a stream
socket on which both ends speak JSON, one object a line. The launcher asks with {"run": arguments of `companion`,
"folder": where it works, "errors": file for its standard error}; the answer is {"started": pid}. When a companion ends,
the server says {"ended": pid, "code": as subprocess.Popen's returncode}, and keeps the pid taken until {"reap": pid}.
When the launcher's end closes, the server ends all companions, then itself.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import io
import json
import os
import select
import signal
import socket
import sys
import time
import traceback
from argparse import Namespace
from pathlib import Path
from typing import Any

from companion.cli import build_parser, main
from companion.mavlink.endpoint import Endpoint
from companion.preflight.computer import is_clock_set, now
from companion.preflight.report import clearance
from companion.run_command import EXIT_BROKEN, RefusedError, mission_of, run
from mission.document.load import parse_mission
from mission.document.model import Mission

PR_SET_PDEATHSIG = 1  # linux/prctl.h
END_LIMIT_S = 3.0
READ_BYTES = 65536
REHEARSED = """
schema = 1
route = { d1_enu_m = [0, 0, 5], d2_enu_m = [50, 0, 5], vel_leader_mps = 2.0 }
swarm = { size = 2 }
origin = { lat_deg = 47.0, lon_deg = 8.0, alt_m = 400.0 }
"""
GRANDCHILD = 1  # exit code of a companion whose server is gone before it has begun


class ForkServer:
    """The companions of one launcher."""

    def __init__(self, launcher: socket.socket) -> None:
        self._launcher = launcher
        self._waker, self._woken = socket.socketpair()
        self._waker.setblocking(False)
        self._woken.setblocking(False)
        signal.signal(signal.SIGCHLD, lambda _number, _frame: None)
        signal.set_wakeup_fd(self._waker.fileno(), warn_on_full_buffer=False)
        self._living: set[int] = set()
        self._ended: set[int] = set()  # and not reaped: nobody else can get their pid
        self._unread = b""
        self._mission: tuple[tuple[bytes, str], Mission] | None = None  # the last file and its path, and what it says
        self._parser = build_parser()  # one: each new one would be written over memory that companions share
        libc = ctypes.CDLL(None)
        self._prctl = libc.prctl if sys.platform == "linux" else None

    def serve(self) -> None:
        """Until the launcher closes its end."""
        rehearse()
        gc.collect()
        gc.freeze()  # what is shared now is not written to by a companion's collections
        while True:
            ready, _, _ = select.select([self._launcher, self._woken], (), ())
            if self._woken in ready:
                self._report_ended()
            if self._launcher in ready and not self._read_request():
                break
        self._end_all()

    def _read_request(self) -> bool:
        """Do what is asked for; False when there is nobody any more."""
        try:
            data = self._launcher.recv(READ_BYTES)
        except ConnectionError:
            return False
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            word = json.loads(line)
            if "run" in word:
                self._start(word)
            elif word["reap"] in self._ended:
                self._ended.discard(word["reap"])
                os.waitpid(word["reap"], 0)
        return bool(data)

    def _start(self, word: dict[str, Any]) -> None:
        server = os.getpid()
        prepared = self._prepared(word)
        pid = os.fork()
        if pid == 0:
            os._exit(self._companion(server, word, prepared))
        with contextlib.suppress(OSError):  # by both: whichever comes first; the launcher signals the group at once
            os.setpgid(pid, pid)
        self._living.add(pid)
        self._send_reply(started=pid)

    def _prepared(self, word: dict[str, Any]) -> tuple[Namespace, Mission] | None:
        """Arguments and mission, which all then share; None where the companion itself has to say what is wrong."""
        try:
            os.chdir(word["folder"])
            with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
                arguments = self._parser.parse_args(word["run"])
            if arguments.command != "run":
                return None
            text = Path(arguments.mission).read_bytes()
            if self._mission is None or self._mission[0] != (text, arguments.mission):
                self._mission = (text, arguments.mission), mission_of(arguments)
                gc.collect()
                gc.freeze()
        except (SystemExit, OSError, ValueError, RefusedError):
            return None
        mission = self._mission[1]
        return (arguments, mission) if 1 <= arguments.id <= mission.swarm.size else None

    def _companion(self, server: int, word: dict[str, Any], prepared: tuple[Namespace, Mission] | None) -> int:
        """In the child: as if it had been executed. Its exit code."""
        if self._prctl is not None:
            self._prctl(PR_SET_PDEATHSIG, signal.SIGKILL)  # one that is stopped does not see SIGTERM
        if os.getppid() != server:
            return GRANDCHILD
        os.setpgid(0, 0)
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for end in (self._launcher, self._waker, self._woken):
            end.close()
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        os.dup2(nothing, 1)
        try:
            errors = os.open(word["errors"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
            os.dup2(errors, 2)
            os.close(errors)
            os.close(nothing)
            os.chdir(word["folder"])
            return main(word["run"]) if prepared is None else run(*prepared)
        except SystemExit as end_of_program:
            return end_of_program.code if isinstance(end_of_program.code, int) else EXIT_BROKEN
        except BaseException:  # noqa: BLE001  not swallowed: the process ends here
            traceback.print_exc()
            return EXIT_BROKEN
        finally:
            with contextlib.suppress(OSError):
                sys.stderr.flush()

    def _report_ended(self) -> None:
        with contextlib.suppress(BlockingIOError):
            self._woken.recv(READ_BYTES)
        for pid in sorted(self._living):
            ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
            if ended is not None:
                self._living.discard(pid)
                self._ended.add(pid)
                code = ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status
                self._send_reply(ended=pid, code=code)

    def _send_reply(self, **word: int) -> None:
        with contextlib.suppress(OSError):  # nobody there any more: the next read says so
            self._launcher.sendall(json.dumps(word).encode() + b"\n")

    def _end_all(self) -> None:
        """SIGTERM, and SIGKILL for what is left; a stopped one is woken for it."""
        for number in (signal.SIGTERM, signal.SIGCONT):
            self._signal_all(number)
        deadline_s = time.monotonic() + END_LIMIT_S
        while self._living and (left_s := deadline_s - time.monotonic()) > 0.0:
            select.select([self._woken], (), (), left_s)
            self._report_ended()
        self._signal_all(signal.SIGKILL)
        for pid in self._living | self._ended:
            os.waitpid(pid, 0)

    def _signal_all(self, number: signal.Signals) -> None:
        for pid in self._living | self._ended:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(pid, number)


def rehearse() -> None:
    """Do once what every companion does at its start: what that loads and builds is then shared by all."""
    mission = parse_mission(REHEARSED)
    clearance(None, ("all",), "", 1, now=now(), is_clock_set=is_clock_set)
    Endpoint(mission, 1).tick(0.0)


if __name__ == "__main__":
    ForkServer(socket.socket(fileno=os.dup(0))).serve()
