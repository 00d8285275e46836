"""Runs this program with the mathematics that WebAssembly has: musl's, and sums as from Python 3.12 on.

A flight's trace is the same to the bit wherever sin, atan2, exp and so on round alike. glibc's round otherwise in some
per cent of calls; the page's are musl's, which Debian packages (`apt-get install musl`).
"""

from __future__ import annotations

import builtins
import math
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

MUSL: Final = Path(f"/lib/ld-musl-{platform.machine()}.so.1")
COMPENSATED: Final = (3, 12)  # from here on `sum` of floats makes up for what it rounds
SOURCE: Final = Path(__file__).with_name("libm.c")


def why_not() -> str | None:
    """Reason why it cannot be had here, or None."""
    if platform.machine() != "x86_64":  # elsewhere compilers contract a * b + c, and round once
        return "musl rounds as WebAssembly on x86_64 only"
    if not MUSL.exists():
        return f"no {MUSL}: apt-get install musl"
    if shutil.which("cc") is None:
        return "no C compiler"
    return None


def environment(folder: Path) -> dict[str, str]:
    """Of a process with musl's mathematics; the library is built in `folder`. CalledProcessError."""
    library = folder / "libm-of-musl.so"
    build = ["cc", "-O1", "-fno-builtin", "-shared", "-fPIC", f'-DMUSL="{MUSL}"', str(SOURCE), "-o", str(library)]
    subprocess.run([*build, "-ldl"], check=True, capture_output=True, text=True)
    return {**os.environ, "LD_PRELOAD": str(library), "UNDERSTORY_PURE": "1"}


def sum_as_later_pythons() -> None:
    """Let `sum` of this process be that of Python 3.12 and later."""
    if sys.version_info < COMPENSATED:
        builtins.sum = compensated


def compensated(values: Iterable[Any], /, start: Any = 0, *, plain: Any = sum) -> Any:
    """`sum`, of floats by Neumaier's algorithm (1974, ZAMM 54, 39-51) as CPython has it."""
    every: Sequence[Any] = list(values)
    first = next((k for k, value in enumerate(every) if type(value) is float), None)
    if type(start) is not int or first is None or not {type(value) for value in every} <= {float, int}:
        return plain(every, start)
    total, error = float(plain(every[:first], start)), 0.0
    for value in map(float, every[first:]):
        both = total + value
        error += (total - both) + value if abs(total) >= abs(value) else (value - both) + total
        total = both
    return total + error if error and math.isfinite(error) else total
