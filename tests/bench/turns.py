"""Programs that fly in stints and take turns: what is compared in one run has had the same machine.

A program is `stint.py` or one of `other_simulators/`: a line in, so many simulated seconds flown, a line of JSON out.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PACKAGES = ("mission", "companion", "sim_bridge")


class StintError(RuntimeError):
    """A program that ended without an answer; its last words."""


@dataclass(frozen=True, slots=True)
class Stint:
    """Part of a flight."""

    vehicle_s: float  # simulated seconds times vehicles
    cpu_s: float  # of the program and all that it started
    wall_s: float
    phase: str  # at its end


class StintProgram:
    """One program. Use as a context manager: it is ended with it."""

    def __init__(self, command: Sequence[str], *, checkout: Path = ROOT, folder: Path | None = None) -> None:
        """`checkout`: what it flies; `folder`: where it works, if not there."""
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            cwd=folder or checkout,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            text=True,
        )
        self.stints: list[Stint] = []
        self.end: dict[str, Any] | None = None  # what it told last

    def __enter__(self) -> StintProgram:
        return self

    def __exit__(self, *_: object) -> None:
        """End it: it ends its flight by itself when nothing more is asked of it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self._process.stdout.read()
        self._process.stdout.close()
        self._process.wait()
        self._errors.close()

    def fly(self, order: float | str) -> Stint:
        """A stint, and what it cost. StintError when there is no answer."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{order}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise StintError(self._last_words()) from None
        answer = self.answer()
        stint = Stint(answer["vehicle_s"], answer["cpu_s"], answer["wall_s"], answer.get("phase", ""))
        self.stints.append(stint)
        if "ended" in answer:
            self.end = answer
        return stint

    def answer(self) -> dict[str, Any]:
        """The next line of JSON; programs may say other things."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("{"):
                answer: dict[str, Any] = json.loads(line)
                return answer
        raise StintError(self._last_words())

    def finish(self) -> dict[str, Any]:
        """Ask nothing more, and take its last answer."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        return self.answer()

    def _last_words(self) -> str:
        self._process.wait()
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"ended with exit code {self._process.returncode}"


def stint_command(mission: str, *options: str) -> list[str]:
    """To fly a mission, or `bare`."""
    return [sys.executable, "-P", str(HERE / "stint.py"), mission, *options]


def cost_s(stints: Sequence[Stint]) -> float:
    """Processor seconds for a vehicle's simulated second."""
    return sum(stint.cpu_s for stint in stints) / sum(stint.vehicle_s for stint in stints)


def take_turns(programs: Collection[StintProgram], pacer: StintProgram, stint_s: float) -> None:
    """A stint of the pacer and one of each, again and again, until all but the pacer have ended."""
    while living := [program for program in programs if program.end is None]:
        for program in (pacer, *living):
            program.fly(stint_s)


@contextmanager
def pure_copy(checkout: Path) -> Iterator[Path]:
    """A copy of a checkout's packages without compiled modules."""
    with tempfile.TemporaryDirectory(prefix="pure-") as folder:
        for package in PACKAGES:
            shutil.copytree(
                checkout / package,
                Path(folder) / package,
                ignore=shutil.ignore_patterns("*.so", "*.pyd", "__pycache__", "node_modules"),
            )
        yield Path(folder)
