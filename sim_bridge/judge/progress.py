"""Progress of a flight, for a person: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import IO

from rich.console import Console
from rich.live import Live
from rich.text import Text

LINE_EVERY_S = 10.0  # of simulated time, where the output is no terminal
REFRESH_S = 0.25  # of wall time
SILENT_MAX_S = 3.0  # of wall time, between two signs of life


@dataclass(frozen=True, slots=True)
class Status:
    """A glance at the swarm; None where there is nothing to say yet."""

    time_s: float
    phase: str
    leader: int | None
    to_go_m: float | None
    separation_m: float | None
    links: int
    real_time_factor: float
    records: str = ""  # of a mission that surveys: how far they are

    def __str__(self) -> str:
        leader = "-" if self.leader is None else str(self.leader)
        to_go = "-" if self.to_go_m is None else f"{self.to_go_m:.1f} m"
        apart = "-" if self.separation_m is None else f"{self.separation_m:.1f} m"
        records = f"  {self.records}" if self.records else ""
        return (
            f"{self.time_s:7.1f} s  {self.phase:<9} leader {leader:<3} to go {to_go:<8} "
            f"closest {apart:<7} links {self.links:<4} {self.real_time_factor:.0f}x{records}"
        )


def describe_pace(done: int, share: float, elapsed_s: float) -> str:
    """Rate and time left of long work, in words. `done`: pieces; `share`: of the whole, by what they cost, 0 to 1."""
    if not done or elapsed_s <= 0.0:
        return ""
    left = ""
    if share > 0.0:
        left_s = elapsed_s * (1.0 - share) / share
        left = f", {left_s:.0f} s left" if left_s < 90.0 else f", {left_s / 60.0:.0f} min left"
    return f", {60.0 * done / elapsed_s:.4g} a minute{left}"


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """An error as any other: rich would end the program."""
        raise


class Progress:
    """Use as a context manager. Events scroll; the status stays on the last line of a terminal.

    A stream that cannot be written (disk full, terminal gone) is given up: what is shown is not the flight.
    """

    def __init__(self, stream: IO[str]) -> None:
        self._console = _Console(file=stream, highlight=False, soft_wrap=True)
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._given_up = False
        self._shown_s = -1e9
        self._line_s = -1e9
        self._said_s = time.monotonic()

    def __enter__(self) -> Progress:
        if self._live is not None:
            self._try(self._live.start)
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._try(self._live.stop)

    def event(self, time_s: float, text: str) -> None:
        """Something happened at simulated `time_s`."""
        self._print(Text(f"{time_s:7.1f} s  {text}"))

    def due(self, time_s: float) -> bool:
        """Worth working out a Status now."""
        if self._live is not None:
            return time.monotonic() - self._shown_s >= REFRESH_S
        return time_s - self._line_s >= LINE_EVERY_S

    def show(self, status: Status) -> None:
        """Replace the live line, or print a plain one."""
        self._shown_s, self._line_s = time.monotonic(), status.time_s
        if not self._update(str(status)):
            self._print(Text(str(status)))

    def stage(self, text: str, done: int, total: int) -> None:
        """Shows progress before the flight: on a terminal at once, elsewhere from time to time."""
        line = f"{text} {done}/{total}"
        if not self._update(line) and time.monotonic() - self._said_s >= SILENT_MAX_S:
            self._print(Text(line))

    @contextmanager
    def working(self, text: str | Callable[[], str]) -> Iterator[None]:
        """Signs of life while something is done that says nothing itself: no other output, and no fork, meanwhile.

        `text`: what is done; a function, where that changes, is called from another thread.
        """
        what = text if callable(text) else lambda: text
        over = threading.Event()
        began_s = time.monotonic()

        def show_sign() -> None:
            while not over.wait(SILENT_MAX_S):
                line = f"{what()}: {time.monotonic() - began_s:.0f} s"
                if not self._update(line):
                    self._print(Text(line))

        self._update(what())
        thread = threading.Thread(target=show_sign, daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            self._update("")

    def _update(self, text: str) -> bool:
        """Replace the live line; False where there is none."""
        live = self._live
        if live is None:
            return False
        self._try(lambda: live.update(Text(text), refresh=True))
        return True

    def _print(self, text: Text) -> None:
        self._said_s = time.monotonic()
        self._try(lambda: self._console.print(text))

    def _try(self, write: Callable[[], None]) -> None:
        if self._given_up:
            return
        try:
            write()
        except OSError:
            self._given_up = True
