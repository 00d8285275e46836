"""Fusion in flight beside the loop: a child process at the lowest priority, asked by a thread that only waits for it.

The loop never waits for either, and neither sends anything: without them the flight is the same.
"""

from __future__ import annotations

import math
import os
import queue
import select
import subprocess
import sys
import threading
from pathlib import Path
from typing import Final, Protocol

from companion.mavlink.harvest import StandUpdate
from companion.records.summary import StandSummary, decode_summary
from companion.stand.update import PERIOD_S, update_of
from mission.common.files import os_words

BUSY_SHARE: Final = 0.05  # of one core at most, on the average: one that took 2 s is followed by 40 s without
ANSWER_S: Final = 120.0  # longer, and the child is ended; so long, too, until it is tried again
JOIN_S: Final = 2.0
LINE_MAX: Final = 4096
CHILD: Final = (sys.executable, "-m", "companion.stand.in_flight")
ONE_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # of numpy's: the other cores are not its


class FusionError(Exception):
    """There is no summary; the message says why."""


class Child(Protocol):
    """Whoever fuses."""

    def request_summary(self) -> tuple[float, StandSummary]:
        """A processor's time that it took, s, and the summary. FusionError, OSError."""

    def end(self) -> None:
        """Let go of it, until it is asked again."""

    def kill(self) -> None:
        """From another thread: end what `request_summary` waits for."""


class FusionChild:
    """The child process of one vehicle's records: started when it is asked first."""

    def __init__(self, mission_file: Path, records_file: Path, program: tuple[str, ...] = CHILD) -> None:
        """`program`: what to start, before its two arguments."""
        self._command: Final = (*program, str(mission_file), str(records_file))
        self._process: subprocess.Popen[bytes] | None = None

    def request_summary(self) -> tuple[float, StandSummary]:
        """As `Child` has it."""
        if self._process is None:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                env={**os.environ, **ONE_THREAD},
                start_new_session=True,  # Ctrl-C is for the companion
            )
        asked, told = self._process.stdin, self._process.stdout
        assert asked is not None
        assert told is not None
        asked.write(b"\n")
        if not select.select((told,), (), (), ANSWER_S)[0]:
            raise FusionError(f"no answer within {ANSWER_S:.0f} s")
        return read_answer(told.readline(LINE_MAX).decode("ascii", "replace").strip())

    def end(self) -> None:
        """As `Child` has it."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()

    def kill(self) -> None:
        """As `Child` has it."""
        process = self._process
        if process is not None:
            process.kill()


def read_answer(line: str) -> tuple[float, StandSummary]:
    """A line of the child's, as `companion.stand.in_flight` tells it. FusionError."""
    if not line:
        raise FusionError("the child process ended")
    if line.startswith("!"):
        raise FusionError(line[1:].strip())
    took, _, body = line.partition(" ")
    try:
        took_s, summary = float(took), decode_summary(bytes.fromhex(body))
    except ValueError:
        raise FusionError("an answer that is none") from None
    if summary is None or not 0.0 <= took_s < math.inf:
        raise FusionError("an answer that is none")
    return took_s, summary


class FusionProcess:
    """A `StandFusion`. The child is there while this vehicle leads, and no longer."""

    def __init__(self, child: Child) -> None:
        self._child: Final = child  # the thread's
        self._asked: Final[queue.Queue[bool | None]] = queue.Queue(maxsize=2)  # True: fuse; False: rest; None: end
        self._told: Final[queue.Queue[tuple[float, StandSummary] | FusionError]] = queue.Queue(maxsize=1)
        self._is_asked = self._has_child = False
        self._due_s = -math.inf
        self._fused = 0  # records, in the last summary
        self._error = ""
        self._lines: list[str] = []
        self._thread: threading.Thread | None = None  # from the first time that this vehicle leads

    def take_update(self, *, leads: bool, now_s: float) -> StandUpdate | None:
        """As `StandFusion` has it."""
        found = self._take_told(now_s)
        if self._is_asked:
            return None
        if leads and now_s >= self._due_s:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="stand", daemon=True)
                self._thread.start()
            self._is_asked = self._has_child = True
            self._asked.put_nowait(True)
        elif not leads and self._has_child:
            self._has_child = False
            self._asked.put_nowait(False)
        if found is None or not leads or found.fused <= self._fused:
            return None
        self._fused = found.fused
        return update_of(found)

    def lines(self) -> list[str]:
        """As `StandFusion` has it."""
        said, self._lines = self._lines, []
        return said

    def close(self) -> None:
        """End thread and child."""
        if self._thread is None:
            return
        self._child.kill()
        try:
            self._asked.put(None, timeout=JOIN_S)
        except queue.Full:
            return
        self._thread.join(JOIN_S)

    def _take_told(self, now_s: float) -> StandSummary | None:
        if not self._is_asked:
            return None
        try:
            told = self._told.get_nowait()
        except queue.Empty:
            return None
        self._is_asked = False
        if isinstance(told, FusionError):
            self._due_s = now_s + ANSWER_S
            if str(told) != self._error:
                self._error = str(told)
                self._lines.append(f"stand: not fused: {told}")
            return None
        took_s, summary = told
        self._error = ""
        self._due_s = now_s + max(PERIOD_S, took_s / BUSY_SHARE)
        return summary

    def _run(self) -> None:
        """The thread."""
        while (does := self._asked.get()) is not None:
            if not does:
                self._child.end()
                continue
            try:
                self._told.put(self._child.request_summary())
            except (FusionError, OSError) as error:
                self._child.end()
                self._told.put(FusionError(os_words(error) if isinstance(error, OSError) else str(error)))
        self._child.end()
