"""Programs that a flight starts and ends: in process groups of their own, and gone when this program is."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, Protocol, Self

from mission.cli.main import EXIT_ENVIRONMENT
from sim_bridge.errors import StartError

FORK_SERVER = (sys.executable, "-P", "-m", "companion.fork_server")  # -P: as processes.PROGRAM
LOADED_LIMIT_S = 30.0  # wall time from the fork server's start to its first companion, on a busy machine
SERVER_NAME = "fork server"  # for people
END_LIMIT_S = 3.0
END_POLL_S = 0.01
READ_BYTES = 65536
PR_SET_PDEATHSIG = 1  # linux/prctl.h


class Child(Protocol):
    """A process that can be told to end: what is needed of `subprocess.Popen`."""

    @property
    def pid(self) -> int:
        """Also its group's."""

    @property
    def returncode(self) -> int | None:
        """As subprocess.Popen's; None until `poll` or `wait` has found its end."""

    def poll(self) -> int | None:
        """`returncode`, looked up now."""

    def wait(self, timeout: float | None = None) -> int:
        """Until it has ended; then it is reaped. subprocess.TimeoutExpired after so many seconds of wall time."""


def start(
    command: Sequence[str],
    *,
    stdout: int | IO[bytes],
    stderr: int | IO[bytes],
    folder: Path | None = None,
    orphaned: signal.Signals = signal.SIGTERM,
    stdin: int = subprocess.DEVNULL,
    keep: Sequence[int] = (),
) -> subprocess.Popen[bytes]:
    """A child in a process group of its own, which ends with this process: it is sent `orphaned` (Linux).

    `folder`: where it works, if not here; `keep`: open files that it has, too. OSError when there is no such program.
    """
    return subprocess.Popen(
        command,
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        cwd=folder,
        pass_fds=keep,
        start_new_session=True,  # Ctrl-C is for the launcher, which ends its children itself
        preexec_fn=_end_with(os.getpid(), orphaned) if sys.platform == "linux" else None,
    )


def fate(child: Child) -> str | None:
    """The end of a child in words, or None; it is not reaped, so that its process group stays its own."""
    if isinstance(child, Forked):
        return child.fate()
    if child.returncode is not None:
        return in_words(child.returncode)
    ended = os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    if ended is None:
        return None
    return in_words(ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status)


def in_words(code: int) -> str:
    """Describes the end of a process with this `returncode`."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


def loss(vehicle_id: int, how: str) -> str:
    """The line on a companion that is gone, for people; the same for all that a fork server has taken with it."""
    if how.startswith(SERVER_NAME):
        return f"{how}; all companions that it started are gone"
    return f"companion {vehicle_id}: {how}; the flight goes on for the others"


def end(children: Sequence[Child]) -> None:
    """End children and all of their groups, by force if need be."""
    living = [child for child in children if child.returncode is None]
    for child in living:
        signal_group(child, signal.SIGTERM)
        signal_group(child, signal.SIGCONT)  # a stopped process does not see SIGTERM
    deadline_s = time.monotonic() + END_LIMIT_S
    for child in living:
        while fate(child) is None and time.monotonic() < deadline_s:
            time.sleep(END_POLL_S)
        signal_group(child, signal.SIGKILL)  # what is left of the group, too
        with contextlib.suppress(subprocess.TimeoutExpired):  # in the kernel's hands, or its server's: see Forked.wait
            child.wait(END_LIMIT_S)


def signal_group(child: Child, number: signal.Signals) -> None:
    """To a child and all that it has started; nothing where none of them lives."""
    _signal_group(child.pid, number)


def _signal_group(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses for a group of dead ones
        os.killpg(pid, number)


class ForkClient:
    """`companion.fork_server`, started now and loading meanwhile: `fork` starts companions in milliseconds.

    Closing it ends them all; so does the end of this process. A server that ends before, or says nothing of companions
    that must have ended, is ended with all that it has started, and `failure` says why.
    """

    def __init__(self) -> None:
        self.failure: str | None = None  # it starts with SERVER_NAME
        self._living: set[int] = set()  # pids
        self._codes: dict[int, int] = {}  # by pid, of those that have ended
        self._unread = b""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  closed on exit
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._server = start(
                FORK_SERVER,
                stdin=theirs.fileno(),
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                orphaned=signal.SIGKILL,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()
        if self.failure is None:
            try:
                self._server.wait(2.0 * END_LIMIT_S)  # it gives its companions END_LIMIT_S
            except subprocess.TimeoutExpired:
                self._give_up(f"did not end within {2.0 * END_LIMIT_S:g} s")
        self._errors.close()

    def fork(self, arguments: Sequence[str], errors: Path) -> Forked:
        """`companion` with these arguments, working here; its standard error to `errors`. StartError."""
        self._send_request(run=list(arguments), folder=os.getcwd(), errors=str(errors.absolute()))
        self._socket.settimeout(LOADED_LIMIT_S)
        while self.failure is None:
            for word in self._words():
                if "started" in word:
                    return Forked(word["started"], self)
        raise StartError(f"companions cannot be started: {self._last_error() or self.failure}", EXIT_ENVIRONMENT)

    def code(self, pid: int, *, limit_s: float | None = 0.0) -> int | None:
        """This companion's exit code, as subprocess.Popen's returncode; None while it runs.

        `limit_s`: wall time to wait for its end; a server that is silent for so long is given up, and its companions
        with it. None: no limit.
        """
        self._socket.settimeout(limit_s)
        while pid not in self._codes and self.failure is None:
            self._words()
            if limit_s == 0.0:
                break
        # A companion ends with its server
        return self._codes.get(pid, None if self.failure is None else -signal.SIGKILL)

    def fate(self, pid: int) -> str | None:
        """The end of this companion in words, or None: with its server, or by itself."""
        code = self.code(pid)
        return None if code is None else in_words(code) if pid in self._codes else self.failure

    def reap(self, pid: int) -> None:
        """Its pid may be used again."""
        self._send_request(reap=pid)

    def _words(self) -> list[dict[str, Any]]:
        """Messages of the server, as the socket's timeout allows; ends of companions are noted."""
        try:
            data = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return []
        except TimeoutError:
            self._give_up(f"did not answer for {self._socket.gettimeout():g} s")
            return []
        except ConnectionError:
            data = b""
        if not data:
            self._give_up()
        *lines, self._unread = (self._unread + data).split(b"\n")
        words = [json.loads(line) for line in lines]
        for word in words:
            if "started" in word:
                self._living.add(word["started"])
                self._codes.pop(word["started"], None)  # of one that was reaped
            else:
                self._living.discard(word["ended"])
                self._codes[word["ended"]] = word["code"]
        return words

    def _send_request(self, **word: object) -> None:
        if self.failure is not None:
            return
        self._socket.settimeout(LOADED_LIMIT_S)
        try:
            self._socket.sendall(json.dumps(word).encode() + b"\n")
        except TimeoutError:
            self._give_up(f"read nothing for {LOADED_LIMIT_S:g} s")
        except OSError:
            self._give_up()

    def _give_up(self, how: str = "") -> None:
        """End the server, and all that it has started. `how` it failed; none: its end of the socket is closed."""
        for pid in self._living:  # first: while the server lives, it keeps their pids from others
            _signal_group(pid, signal.SIGKILL)
        if not how:  # an end of its own, which is about to be there
            with contextlib.suppress(subprocess.TimeoutExpired):
                how = in_words(self._server.wait(END_LIMIT_S))
        if self._server.returncode is None:
            signal_group(self._server, signal.SIGKILL)  # ends one that is stopped, too
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._server.wait(END_LIMIT_S)
        said = self._last_error()
        self.failure = f"{SERVER_NAME} {how or 'fell silent'}" + (f": {said}" if said else "")

    def _last_error(self) -> str:
        """The last line that the server has written to its standard error, if any."""
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="backslashreplace").splitlines()
        return lines[-1] if lines else ""


class Forked:
    """A companion of a `ForkClient`, to be handled as a `subprocess.Popen`."""

    def __init__(self, pid: int, client: ForkClient) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._client = client
        self._fate: str | None = None

    def fate(self) -> str | None:
        """Its end in words, or None; it is not reaped."""
        if self._fate is None:
            self._fate = self._client.fate(self.pid)
        return self._fate

    def poll(self) -> int | None:
        """`returncode`, looked up now; one that has ended is reaped."""
        return self._reaped(self._client.code(self.pid))

    def wait(self, timeout: float | None = None) -> int:
        """Until it has ended; then it is reaped. A server that says nothing for `timeout` seconds is ended with it."""
        if self.returncode is None:
            self._reaped(self._client.code(self.pid, limit_s=timeout))
        assert self.returncode is not None
        return self.returncode

    def _reaped(self, code: int | None) -> int | None:
        if self.returncode is None and code is not None:
            self.fate()  # looked up as long as the pid is its own
            self.returncode = code
            self._client.reap(self.pid)
        return self.returncode


def _end_with(parent: int, orphaned: signal.Signals) -> Callable[[], None]:
    """To run in the child: a launcher that is killed leaves nobody behind."""

    def ask_kernel() -> None:
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, orphaned)
        if os.getppid() != parent:
            os._exit(1)

    return ask_kernel
