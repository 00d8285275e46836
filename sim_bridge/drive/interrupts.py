"""Ctrl-C, SIGTERM and SIGHUP in a flight: the first ends it, none ends its report."""

from __future__ import annotations

import signal
from types import FrameType

_ours: set[int] = set()  # signals that we have taken, and may ignore meanwhile
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # how a person, a service manager or a terminal ends a program


def interrupt_once() -> None:
    """The next Ctrl-C, SIGTERM or SIGHUP is a KeyboardInterrupt; more of them must not end the report of the flight."""
    # Even where a shell has set them to be ignored, as for a command in the background; not so with nohup
    for number in ENDING:
        if number is not signal.SIGHUP or number in _ours or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)
            _ours.add(number)


def no_more_interrupts() -> None:
    """Ignores Ctrl-C, SIGTERM and SIGHUP from now on, where `interrupt_once` has been called."""
    for number in ENDING:
        if signal.getsignal(number) is _interrupt:
            signal.signal(number, signal.SIG_IGN)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    no_more_interrupts()
    raise KeyboardInterrupt
