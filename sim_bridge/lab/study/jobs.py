"""Job of a worker: the flights of one batch, to figures. It runs in other processes, and on other machines."""

from __future__ import annotations

import gc
import os
import signal
import time
from dataclasses import dataclass
from typing import Any

from sim_bridge.lab.study.backends import BACKENDS
from sim_bridge.lab.study.case import Case

GARBAGE = 50_000  # objects between two searches for circles of them: ticks make many objects and hardly a circle


@dataclass(frozen=True, slots=True)
class Done:
    """A batch that was flown: figures in the order of its cases."""

    figures: tuple[dict[str, Any], ...]
    cpu_s: float  # of the whole batch
    wall_s: float


def start_worker() -> None:
    """In each process of a local pool: Ctrl-C ends it at once, and its flight is flown again next time."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    gc.freeze()  # what is imported stays
    gc.set_threshold(GARBAGE)


def fly_batch(cases: tuple[Case, ...]) -> Done:
    """All cases have the same backend and, to it, the same batch key."""
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    figures = BACKENDS[cases[0].backend].fly(cases)
    return Done(tuple(figures), time.process_time() - cpu_s, time.perf_counter() - wall_s)


def worker_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
