"""What a person sees while a swarm flies: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from rich.console import Console
from rich.live import Live
from rich.text import Text

LINE_EVERY_S = 10.0  # of simulated time, where the output is no terminal
REFRESH_S = 0.25  # of wall time


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

    def __str__(self) -> str:
        leader = "-" if self.leader is None else str(self.leader)
        to_go = "-" if self.to_go_m is None else f"{self.to_go_m:.1f} m"
        apart = "-" if self.separation_m is None else f"{self.separation_m:.1f} m"
        return (
            f"{self.time_s:7.1f} s  {self.phase:<9} leader {leader:<3} to go {to_go:<8} "
            f"closest {apart:<7} links {self.links:<4} {self.real_time_factor:.0f}x"
        )


class _Console(Console):
    def on_broken_pipe(self) -> None:
        """An error as any other: rich would end the program."""
        raise


class Progress:
    """Use as a context manager. Events scroll; the status stays on the last line of a terminal.

    A stream that cannot be written (disk full, terminal gone) is given up: what is shown is not the flight.
    """

    def __init__(self, stream: TextIO) -> None:
        self._console = _Console(file=stream, highlight=False, soft_wrap=True)
        self._live = Live(console=self._console, auto_refresh=False) if self._console.is_terminal else None
        self._given_up = False
        self._shown_s = -1e9
        self._line_s = -1e9

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
        if self._live is None:
            self._print(Text(str(status)))
        else:
            live = self._live
            self._try(lambda: live.update(Text(str(status)), refresh=True))

    def _print(self, text: Text) -> None:
        self._try(lambda: self._console.print(text))

    def _try(self, write: Callable[[], None]) -> None:
        if self._given_up:
            return
        try:
            write()
        except OSError:
            self._given_up = True
