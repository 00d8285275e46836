"""Compiled or pure: which of the two this process runs.

`make install` compiles the modules that setup.py lists with mypyc, beside their sources. Compiled modules call each
other directly, so it is all or none: when one source is not what was compiled, or UNDERSTORY_PURE is set, every module
comes from its source. A stale extension module is thus never imported. Both fly the same, to the bit; pure Python is
the reference.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Sequence
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, FileFinder, ModuleSpec, SourceFileLoader
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
PACKAGES = ("mission", "companion", "sim_bridge")
SWITCH = "UNDERSTORY_PURE"


def manifest_name(suffix: str) -> str:
    """The file, beside this one, that lists each compiled source's SHA-256 and path; `suffix`: of its modules."""
    return suffix.removeprefix(".").removesuffix(".so") + ".sums"


MANIFEST = Path(__file__).with_name(manifest_name(EXTENSION_SUFFIXES[0]))


def why_pure(manifest: Path = MANIFEST, root: Path = ROOT) -> str | None:
    """The reason why the compiled modules may not be imported; None: they may."""
    if os.environ.get(SWITCH):
        return f"{SWITCH} is set"
    try:
        lines = manifest.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return "not compiled"
    for line in lines:
        digest, _, name = line.partition("  ")
        try:
            same = hashlib.sha256((root / name).read_bytes()).hexdigest() == digest
        except FileNotFoundError:
            same = False
        if not same:
            return f"{name} is not what was compiled: `make install` compiles it"
    return None


class SourcesOnly:
    """A meta path finder that overlooks the extension modules of PACKAGES."""

    def __init__(self) -> None:
        self._finders: dict[str, FileFinder] = {}

    def find_spec(
        self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """As importlib asks for it."""
        if path is None or fullname.partition(".")[0] not in PACKAGES:
            return None
        for folder in path:
            finder = self._finders.get(folder)
            if finder is None:
                finder = self._finders[folder] = FileFinder(folder, (SourceFileLoader, SOURCE_SUFFIXES))
            spec = finder.find_spec(fullname, target)
            if spec is not None:
                return spec
        return None


def choose() -> str | None:
    """Sees to it that this process imports what it may; `why_pure`."""
    why = why_pure()
    if why is not None:
        sys.meta_path.insert(0, SourcesOnly())
    return why


WHY_PURE = choose()  # once, before any module that may be compiled: every package imports this one first
STATE = "compiled" if WHY_PURE is None else f"pure Python ({WHY_PURE})"
