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

from mission.cli import EXIT_ENVIRONMENT
from sim_bridge.errors import StartError

FORK_SERVER = (sys.executable, "-P", "-m", "companion.fork_server")  # -P: as processes.PROGRAM
LOADED_LIMIT_S = 30.0  # wall time from the fork server's start to its first companion, on a busy machine
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

    def wait(self) -> int:
        """Until it has ended; then it is reaped."""


def start(
    command: Sequence[str],
    *,
    stdout: int | IO[bytes],
    stderr: int | IO[bytes],
    folder: Path | None = None,
    orphaned: signal.Signals = signal.SIGTERM,
    stdin: int = subprocess.DEVNULL,
) -> subprocess.Popen[bytes]:
    """A child in a process group of its own, which ends with this process: it is sent `orphaned` (Linux).

    `folder`: where it works, if not here. OSError when there is no such program.
    """
    return subprocess.Popen(
        command,
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        cwd=folder,
        start_new_session=True,  # Ctrl-C is for the launcher, which ends its children itself
        preexec_fn=_end_with(os.getpid(), orphaned) if sys.platform == "linux" else None,
    )


def fate(child: Child) -> str | None:
    """How a child has ended, or None; it is not reaped, so that its process group stays its own."""
    if child.returncode is not None:
        return in_words(child.returncode)
    if isinstance(child, Forked):
        code = child.ended()
        return None if code is None else in_words(code)
    ended = os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    if ended is None:
        return None
    return in_words(ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status)


def in_words(code: int) -> str:
    """How a process has ended whose `returncode` is this."""
    return f"killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


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
        child.wait()


def signal_group(child: Child, number: signal.Signals) -> None:
    """To a child and all that it has started; nothing where none of them lives."""
    with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses for a group of dead ones
        os.killpg(child.pid, number)


class ForkClient:
    """`companion.fork_server`, started now and loading meanwhile: `fork` starts companions in milliseconds.

    Closing it ends them all; so does the end of this process.
    """

    def __init__(self) -> None:
        self._codes: dict[int, int] = {}  # by pid, of those that have ended
        self._unread = b""
        self._gone = False
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
        self._server.wait()
        self._errors.close()

    def fork(self, arguments: Sequence[str], errors: Path) -> Forked:
        """`companion` with these arguments, working here; its standard error to `errors`. StartError."""
        self._say(run=list(arguments), folder=os.getcwd(), errors=str(errors.absolute()))
        self._socket.settimeout(LOADED_LIMIT_S)
        while not self._gone:
            for word in self._words():
                if "started" in word:
                    return Forked(word["started"], self)
        raise StartError(f"companions cannot be started: {self._last_error()}", EXIT_ENVIRONMENT)

    def code(self, pid: int, *, wait: bool = False) -> int | None:
        """How this companion has ended, as subprocess.Popen's returncode; None while it runs."""
        self._socket.settimeout(None if wait else 0.0)
        while pid not in self._codes and not self._gone:
            self._words()
            if not wait:
                break
        # A companion ends with its server
        return self._codes.get(pid, -signal.SIGKILL if self._gone else None)

    def reap(self, pid: int) -> None:
        """Its pid may be used again."""
        self._say(reap=pid)

    def _words(self) -> list[dict[str, Any]]:
        """What the server says, where the socket's timeout allows; ends of companions are noted."""
        try:
            data = self._socket.recv(READ_BYTES)
        except (BlockingIOError, TimeoutError) as silence:
            self._gone |= isinstance(silence, TimeoutError)
            return []
        except ConnectionError:
            data = b""
        self._gone |= not data
        *lines, self._unread = (self._unread + data).split(b"\n")
        words = [json.loads(line) for line in lines]
        self._codes |= {word["ended"]: word["code"] for word in words if "ended" in word}
        return words

    def _say(self, **word: object) -> None:
        self._socket.settimeout(LOADED_LIMIT_S)
        try:
            self._socket.sendall(json.dumps(word).encode() + b"\n")
        except OSError:
            self._gone = True

    def _last_error(self) -> str:
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="backslashreplace").splitlines()
        return lines[-1] if lines else f"no answer of {FORK_SERVER[-1]} within {LOADED_LIMIT_S:g} s"


class Forked:
    """A companion of a `ForkClient`, to be handled as a `subprocess.Popen`."""

    def __init__(self, pid: int, client: ForkClient) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._client = client

    def ended(self) -> int | None:
        """What `returncode` will be, or None; it is not reaped."""
        return self._client.code(self.pid)

    def poll(self) -> int | None:
        """`returncode`, looked up now; one that has ended is reaped."""
        return self._reaped(self._client.code(self.pid))

    def wait(self) -> int:
        """Until it has ended; then it is reaped."""
        code = self._reaped(self._client.code(self.pid, wait=True))
        assert code is not None
        return code

    def _reaped(self, code: int | None) -> int | None:
        if self.returncode is None and code is not None:
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
