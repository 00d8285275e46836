"""Flies a study's cases on any executor, and keeps a row of each as it ends: nothing is flown twice."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import TracebackType
from typing import Any

from sim_bridge.lab.study.backends import BACKENDS
from sim_bridge.lab.study.case import Backend, Case
from sim_bridge.lab.study.jobs import Done, fly_batch, start_worker

BATCH = 50  # seeds: arrays long enough to be fast, few enough to share among workers
AHEAD = 2  # batches under way for each worker of a cluster, which is some way off
ALWAYS = frozenset({"key", "run", "law", "backend", "n", "seed", "settings", "status"})

Row = dict[str, Any]
Batch = tuple[Case, ...]
Result = Done | BaseException | None
Fly = Callable[[Sequence[Batch]], Iterator[tuple[Batch, Result]]]


class RowsError(Exception):
    """rows.jsonl is not that of a study."""


class Rows:
    """rows.jsonl: a line for each flight, written as it ends. Use as a context manager."""

    def __init__(self, path: Path, *, retry: bool = False) -> None:
        """Read what is there; remove a last line that an interruption has left unfinished: `note` says so, else "".

        `retry`: forget the flights that failed. RowsError for a line that is no row; nothing is removed then.
        """
        self.rows = read_rows(path.read_bytes() if path.exists() else b"", path)
        self.note = ""
        if cut_unfinished(path):
            self.note = f"{path}: the last row was cut off, and is removed: its flight is flown anew if it is asked for"
        if retry:
            self.rows = {key: row for key, row in self.rows.items() if row["status"] == "flown"}
            path.write_bytes(b"".join(_line(row) for row in self.rows.values()))
        self._file = path.open("ab")

    def __enter__(self) -> Rows:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._file.close()

    def add(self, row: Row) -> None:
        """Write it down at once."""
        self.rows[row["key"]] = row
        self._file.write(_line(row))
        self._file.flush()


def cut_unfinished(path: Path) -> bool:
    """Removes a last line without an end, to which the next would be joined. False: there was none."""
    text = path.read_bytes() if path.exists() else b""
    whole_bytes = text.rfind(b"\n") + 1
    if whole_bytes == len(text):
        return False
    os.truncate(path, whole_bytes)
    return True


def read_rows(text: bytes, path: Path) -> dict[str, Row]:
    """By key, the whole lines of rows.jsonl. RowsError names `path` and the line that is no row."""
    rows: dict[str, Row] = {}
    for number, line in enumerate(text[: text.rfind(b"\n") + 1].splitlines(), start=1):
        row = _row(line)
        if row is None:
            raise RowsError(f"{path}:{number}: not a row of a study: remove the line or the file")
        rows[row["key"]] = row
    return rows


def _row(line: bytes) -> Row | None:
    """None for what no study has written."""
    try:
        row = json.loads(line)
    except ValueError:
        return None
    if not isinstance(row, dict) or not row.keys() >= ALWAYS or not isinstance(row["key"], str):
        return None
    if row["status"] == "failed":
        return row if "error" in row else None
    backend = BACKENDS[Backend(row["backend"])] if row["backend"] in list(Backend) else None
    return row if row["status"] == "flown" and backend is not None and backend.always in row else None


def _line(row: Row) -> bytes:
    return json.dumps(row).encode() + b"\n"


def flown_row(case: Case, figures: Row) -> Row:
    """The row of a flight that came to its end, however it ended."""
    return {**case.identity(), "status": "flown", "error": "", **figures}


def failed_row(case: Case, error: str) -> Row:
    """The row of a flight that never came to an end."""
    return {**case.identity(), "status": "failed", "error": error}


def cost(case: Case) -> float:
    """Duration of computing a flight, relative to others: for the time left."""
    return BACKENDS[case.backend].estimate_cost(case)


def batches(cases: Iterable[Case], size: int) -> Iterator[Batch]:
    """Cases that one worker flies at once: up to `size` of those that their backend flies together."""
    alike: dict[tuple[Backend, str], list[Case]] = {}
    for case in cases:
        alike.setdefault((case.backend, BACKENDS[case.backend].batch_key(case)), []).append(case)
    for group in alike.values():
        for start in range(0, len(group), size):
            yield tuple(group[start : start + size])


class Pool:
    """A local process pool that survives the death of its workers. Use as a context manager."""

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._before = set(multiprocessing.active_children())
        self._executor = self._start(workers)

    def _start(self, workers: int) -> ProcessPoolExecutor:
        # There is a worker for each processor: numpy's own threads would only take time from them, waiting.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # Spawned: a fork would copy threads and the file that rows are written to.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(workers, mp_context=context, initializer=start_worker)

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self, error: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        if error is not None:  # flights under way are not waited for
            for child in set(multiprocessing.active_children()) - self._before:
                child.terminate()
        self._executor.shutdown(wait=True, cancel_futures=True)

    def fly(self, todo: Sequence[Batch], *, job: Callable[[Any], Done] = fly_batch) -> Iterator[tuple[Batch, Result]]:
        """Each batch with its Done or its exception, as they end."""
        waiting = list(todo)
        while waiting:
            suspects: list[Batch] = []
            not_begun: list[Batch] = []
            for batch, result in _drive(self._executor, waiting, self.workers, job):
                match result:
                    case None:
                        not_begun.append(batch)
                    case BrokenProcessPool():
                        suspects.append(batch)
                    case _:
                        yield batch, result
            # A dead worker takes all that was under way with it: one at a time shows whose flight it was.
            for case in [case for batch in suspects for case in batch]:
                self._mend()
                yield from _drive(self._executor, [(case,)], 1, job)
            if suspects:
                self._mend()
            waiting = not_begun

    def _mend(self) -> None:
        """A new pool where the old one is broken."""
        try:
            self._executor.submit(int).result()
        except BrokenProcessPool:
            self._executor.shutdown()
            self._executor = self._start(self.workers)


def _drive(
    executor: Executor, todo: Sequence[Batch], ahead: int, job: Callable[[Batch], Done]
) -> Iterator[tuple[Batch, Result]]:
    """Keep `ahead` batches under way. None: not begun, as the pool is broken."""
    waiting = list(reversed(todo))
    under_way: dict[Future[Done], Batch] = {}
    while waiting or under_way:
        while waiting and len(under_way) < ahead:
            batch = waiting.pop()
            try:
                under_way[executor.submit(job, batch)] = batch
            except BrokenProcessPool:
                yield batch, None
        done = wait(under_way, return_when=FIRST_COMPLETED).done if under_way else ()
        for future in done:
            batch = under_way.pop(future)
            try:
                error = future.exception()
            except CancelledError:
                raise ConnectionError("the scheduler has gone: start again to go on") from None
            yield batch, error if error is not None else future.result()


def run(
    cases: Sequence[Case],
    rows: Rows,
    fly: Fly,
    noted: Callable[[Case, Row, float], None] = lambda *_: None,
) -> None:
    """Fly what has no row yet. `noted`: each case, its row, and the processor time that it took."""
    todo = list(batches((case for case in cases if case.key not in rows.rows), BATCH))
    # The longest first: otherwise one of them ends alone.
    todo.sort(key=lambda batch: -sum(map(cost, batch)))
    for batch, result in fly(todo):
        if isinstance(result, Done):
            for case, figures in zip(batch, result.figures, strict=True):
                row = flown_row(case, figures)
                rows.add(row)
                noted(case, row, result.cpu_s / len(batch))
        elif result is not None:
            for case in batch:
                row = failed_row(case, _words(result))
                rows.add(row)
                noted(case, row, 0.0)


def _words(error: BaseException) -> str:
    if isinstance(error, BrokenProcessPool):
        return "the worker process died"
    return f"{type(error).__name__}: {error}"


def fly_on_cluster(executor: Executor, workers: int, job: Callable[[Any], Done] = fly_batch) -> Fly:
    """For `run`: batches on a cluster's executor."""
    return lambda todo: _drive(executor, todo, AHEAD * max(1, workers), job)
