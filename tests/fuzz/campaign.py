"""Runs one target for as long as is asked, counts, and keeps a finding as a file that a test replays from then on."""

from __future__ import annotations

import hashlib
import itertools
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Final

import psutil

from tests.fuzz.companion import Episode, Insider, draw_tape
from tests.fuzz.flights import heard_in
from tests.fuzz.tape import Kind, Step, write_tape
from tests.fuzz.targets import CORPUS, TARGETS, Companion, Target, corpus_of

REPORT_S: Final = 30.0
KEPT_MAX: Final = 500  # inputs in memory of which something new came
SHRINK_TRIES: Final = 400
FINDINGS_MAX: Final = 20  # then it is known that something is wrong


@dataclass(slots=True)
class Tally:
    """What a campaign has done so far. An execution is a datagram, or a file, that was read."""

    target: str
    executions: int = 0
    ticks: int = 0
    seconds: float = 0.0  # CPU time
    slowest_s: float = 0.0  # of one execution, CPU time
    reached: set[object] = field(default_factory=set)  # what came of inputs, each once
    findings: dict[str, Path] = field(default_factory=dict)  # what was raised, and where -> the file
    rss_mib: list[float] = field(default_factory=list)  # of this process, once in REPORT_S or so

    def __str__(self) -> str:
        rate = self.executions / max(self.seconds, 1e-9)
        memory = f"{self.rss_mib[0]:.0f} MiB at first, {max(self.rss_mib):.0f} at most, {self.rss_mib[-1]:.0f} now"
        ticks = f", {self.ticks} ticks" if self.ticks else ""
        return (
            f"{self.target}: {self.executions} executions{ticks}, {rate:.0f}/s, slowest {1e3 * self.slowest_s:.1f} ms, "
            f"{len(self.reached)} outcomes, {len(self.findings)} findings, memory {memory}"
        )


def run(
    name: str,
    executions: int,
    *,
    seed: int = 1,
    corpus: Path = CORPUS,
    say: Callable[[str], None] = print,
) -> Tally:
    """At least so many executions. What is found is kept in `corpus`, and told."""
    target, tally = TARGETS[name](), Tally(name)
    attempts = _flights(target, seed, tally) if isinstance(target, Companion) else _inputs(target, name, seed, tally)
    said_s = 0.0
    began_s = time.process_time()
    for found in attempts:
        tally.seconds = time.process_time() - began_s
        if not tally.rss_mib or tally.seconds - said_s > REPORT_S:
            said_s = tally.seconds
            tally.rss_mib.append(psutil.Process().memory_info().rss / 2**20)
            say(str(tally))
        if found is not None:
            _keep(target, found, tally, corpus, say)
        if tally.executions >= executions or len(tally.findings) >= FINDINGS_MAX:
            break
    tally.rss_mib.append(psutil.Process().memory_info().rss / 2**20)
    say(str(tally))
    return tally


@dataclass(frozen=True, slots=True)
class _Found:
    data: bytes
    error: Exception


def _inputs(target: Target, name: str, seed: int, tally: Tally) -> Iterator[_Found | None]:
    corpus = list(corpus_of(name).values())
    rng = Random(f"{name} {seed}")
    for _ in itertools.count():
        data = target.draw(rng, corpus)
        began_s = time.thread_time()
        try:
            outcome = target.run(data)
        except Exception as error:  # noqa: BLE001  any is a finding
            yield _Found(data, error)
            continue
        tally.executions += 1
        tally.slowest_s = max(tally.slowest_s, time.thread_time() - began_s)
        if outcome not in tally.reached and len(corpus) < KEPT_MAX and len(data) < 1 << 16:
            tally.reached.add(outcome)
            corpus.append(data)
        yield None


def _flights(target: Companion, seed: int, tally: Tally) -> Iterator[_Found | None]:
    """One flight after the other, each of one companion from its start to its end."""
    heard = heard_in(target.mission_name)
    for number in itertools.count():
        rng = Random(f"{target.mission_name} {seed} {number}")
        episode, done = Episode(target.mission_name), list[Step]()
        for step in draw_tape(rng, heard, Insider() if target.mission_name == "signed" else None):
            done.append(step)
            try:
                episode.do(step)
            except Exception as error:  # noqa: BLE001  any is a finding
                yield _Found(write_tape(done), error)
                break
            if step.kind is Kind.TICK:
                tally.ticks += 1
                tally.reached.add(episode.signature)
                yield None
            else:
                tally.executions += 1
                tally.slowest_s = max(tally.slowest_s, episode.slowest_s)


def _keep(target: Target, found: _Found, tally: Tally, corpus: Path, say: Callable[[str], None]) -> None:
    """One file for each place that raised."""
    key = place_of(found.error)
    if key in tally.findings:
        return
    data = _shrunk(target, found.data, key)
    folder = corpus / tally.target
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"finding-{hashlib.sha256(key.encode()).hexdigest()[:8]}"
    path.write_bytes(data)
    tally.findings[key] = path
    say(f"FINDING {path} ({len(data)} bytes): {key}")
    say("".join(traceback.format_exception(found.error)))


def place_of(error: Exception) -> str:
    """What was raised, and by which line."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}"


def _shrunk(target: Target, data: bytes, key: str) -> bytes:
    """As short as it gets while the same line raises: halves are left out, then quarters, and so on."""
    is_tape = isinstance(target, Companion)
    parts = _tape_parts(data) if is_tape else [data[k : k + 1] for k in range(len(data))]
    size, tries = max(1, len(parts) // 2), 0
    while tries < SHRINK_TRIES:
        at, shorter = 0, False
        while at < len(parts) and tries < SHRINK_TRIES:
            fewer = parts[:at] + parts[at + size :]
            tries += 1
            if _raises(target, b"".join(fewer), key):
                parts, shorter = fewer, True
            else:
                at += size
        if size == 1 and not shorter:
            break
        size = max(1, size // 2)
    return b"".join(parts)


def _tape_parts(data: bytes) -> list[bytes]:
    from tests.fuzz.tape import read_tape

    return [write_tape([step]) for step in read_tape(data)]


def _raises(target: Target, data: bytes, key: str) -> bool:
    try:
        target.run(data)
    except Exception as error:  # noqa: BLE001  any is a finding
        return place_of(error) == key
    return False
