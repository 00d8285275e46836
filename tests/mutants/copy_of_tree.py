"""A copy of the tree in which files are changed and tests run: what is in the tree itself never is."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[2]
PARTS = ("mission", "companion", "sim_bridge", "tests", "docs")
FILES = ("pyproject.toml", "setup.py", "CHANGELOG.md", "README.md", "CONTRIBUTING.md", "CITATION.cff", "Makefile")
LEFT_OUT = shutil.ignore_patterns("*.so", "*.sums", "__pycache__", "node_modules")


class Copy:
    """Pure Python, in `folder`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for part in PARTS:
            shutil.copytree(ROOT / part, folder / part, ignore=LEFT_OUT)
        for name in FILES:
            shutil.copy2(ROOT / name, folder / name)
        self.env = os.environ | {
            "PYTHONPATH": str(folder),
            "UNDERSTORY_PURE": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "HYPOTHESIS_STORAGE_DIRECTORY": str(folder / ".hypothesis"),
        }

    @contextmanager
    def changed(self, file: str, old: str, new: str) -> Iterator[None]:
        """In that file `old`, which stands there once, is `new`. ValueError: it does not."""
        path = self.folder / file
        before = path.read_text(encoding="utf-8")
        if before.count(old) != 1:
            raise ValueError(f"{file}: {old!r} stands there {before.count(old)} times")
        path.write_text(before.replace(old, new), encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(before, encoding="utf-8")

    def fails(self, tests: Sequence[str], limit_s: float) -> str:
        """The first that fails, or how it ended else ("too long"); empty: all pass. `tests`: pytest's names."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "-p", "no:cacheprovider", *tests]
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=self.env, capture_output=True, text=True, timeout=limit_s, check=False
            )
        except subprocess.TimeoutExpired:
            return "too long"
        if done.returncode == 0:
            return ""
        said = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return said[0] if said else f"exit code {done.returncode}: {done.stdout[-300:]}{done.stderr[-300:]}"
