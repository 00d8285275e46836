"""A flight of what is under edit: `sim-bridge fly`, as a program beside this one, into a folder of its own."""

from __future__ import annotations

import contextlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

PROGRAM: Final = "sim-bridge"
REPORT: Final = "report.html"
LINES_MAX: Final = 400
LINE_MAX_CHARS: Final = 300
END_S: Final = 10.0  # that a flight gets to write what it has, once it is asked to end
_MAP: Final = re.compile(r"live map: (http://127\.0\.0\.1:\d+/)")
NOT_INSTALLED: Final = (
    "The simulator is not installed here: there is no program sim-bridge. In a checkout `make install` installs it."
)

Finder = Callable[[], Sequence[str] | None]


def find_program() -> Sequence[str] | None:
    """Command that starts the simulator, of the installation that this program is of if it has one."""
    beside = Path(sys.executable).with_name(PROGRAM)
    found = str(beside) if beside.exists() else shutil.which(PROGRAM)
    return None if found is None else [found]


class Flight:
    """The last flight: at most one at a time. Its folder is removed with the next one, or by `close`."""

    def __init__(self, find: Finder = find_program) -> None:
        self._find = find
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._reader: threading.Thread | None = None
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._lines: deque[str] = deque(maxlen=LINES_MAX)
        self._revision: int | None = None
        self.number = 0  # of this flight, from 1

    def start(self, name: str, text: str, stems: Path | None, revision: int) -> None:
        """Flies `text`, the mission file `name`, with its stem map. The one before is ended. OSError."""
        self.stop()
        command = self._find()
        with self._lock:
            self._lines.clear()
            self._revision = revision
            self.number += 1
            if command is None:
                self._lines.append(NOT_INSTALLED)
                return
            self._drop_folder()
            self._folder = tempfile.TemporaryDirectory(prefix="mission-edit-")
            folder = Path(self._folder.name)
            mission = folder / name
            mission.write_text(text, encoding="utf-8")
            if stems is not None:
                shutil.copyfile(stems, folder / stems.name)
            how = ["--airframe", "point-mass", "--agents", "in-process", "--map", "--out", str(folder / "run")]
            process = subprocess.Popen(
                [*command, "fly", str(mission), *how],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,  # Ctrl-C is for this program, which ends it
            )
            self._process = process
            self._reader = threading.Thread(target=self._take_lines, args=(process,), daemon=True)
            self._reader.start()

    def stop(self) -> None:
        """Ends the flight; what it has flown is reported as usual."""
        process, reader = self._process, self._reader
        if process is None:
            return
        if process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if reader is not None:
            reader.join()

    def close(self) -> None:
        """Ends it, and removes its folder."""
        self.stop()
        with self._lock:
            self._drop_folder()

    def describe(self) -> dict[str, Any]:
        """For the page: what it says, and whether there is a report."""
        with self._lock:
            process, lines = self._process, list(self._lines)
            code = None if process is None else process.poll()
            found = (match[1] for line in lines if (match := _MAP.search(line)))
            is_under_way = process is not None and code is None
            return {
                "number": self.number,
                "revision": self._revision,
                "is_under_way": is_under_way,
                "code": code,
                "lines": lines,
                "map": next(found, None) if is_under_way else None,
                "has_report": not is_under_way and self._report() is not None,
            }

    def report(self) -> bytes | None:
        """Page of the last flight, once it is over."""
        with self._lock:
            path = self._report()
            return None if path is None else path.read_bytes()

    def _report(self) -> Path | None:
        if self._folder is None:
            return None
        path = Path(self._folder.name) / "run" / REPORT
        return path if path.exists() else None

    def _take_lines(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                with self._lock:
                    self._lines.append(line.rstrip("\n")[:LINE_MAX_CHARS])

    def _drop_folder(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
