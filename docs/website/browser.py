"""The page's software: Pyodide, the Python packages that it needs, and the project's own sources as they are."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
ROOT: Final = HERE.parents[1]
NPM: Final = ROOT / "build" / "site-npm" / "node_modules"
PYODIDE: Final = NPM / "pyodide"
RUNTIME: Final = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "pyodide-lock.json")
PLATFORM: Final = ("--platform", "pyemscripten_2026_0_wasm32", "--python-version", "3.14", "--implementation", "cp")
STARTED: Final = "docs.website.world.here"
EXAMPLES: Final = ("lone_tree.toml", "managed_stand.toml")
OURS: Final = ("mission", "companion", "sim_bridge", "docs.website")
LIST: Final = f"""
import sys
sys.path[:0] = sys.argv[1:3]
import {STARTED}
for name, module in sys.modules.items():
    if name.startswith({OURS}):
        print(module.__file__)
"""


def build_software(out: Path, wheels: Path) -> None:
    """Pyodide, packages (of the folder `wheels`) and sources into `out`. OSError, CalledProcessError."""
    (out / "pyodide").mkdir(parents=True)
    for name in RUNTIME:
        shutil.copyfile(PYODIDE / name, out / "pyodide" / name)
    with tempfile.TemporaryDirectory(prefix="understory-") as folder:
        packages, sources = Path(folder, "packages"), Path(folder, "sources")
        for wheel in sorted(wheels.glob("*.whl")):
            with zipfile.ZipFile(wheel) as archive:
                archive.extractall(packages)
        copy_sources(sources)
        for made in (packages, sources):
            command = ["node", str(HERE / "compile.mjs"), str(PYODIDE), str(made), str(out / f"{made.name}.zip")]
            subprocess.run(command, check=True)


def fetch_packages(folder: Path) -> None:
    """The wheels of browser.lock, by their hashes, and no others, into `folder`. CalledProcessError."""
    shutil.rmtree(folder, ignore_errors=True)
    command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--require-hashes"]
    only = ["--no-deps", "--only-binary=:all:", *PLATFORM, "--dest", str(folder)]
    subprocess.run([*command, *only, "-r", str(HERE / "browser.lock")], check=True)


def copy_sources(folder: Path) -> None:
    """The modules that a flight imports, byte by byte, the stand-ins beside them, and the examples."""
    for file in modules():
        _copy(file, folder / file.relative_to(ROOT))
    for file in sorted((HERE / "stand_ins").rglob("*.py")):
        _copy(file, folder / file.relative_to(HERE / "stand_ins"))
    for name in EXAMPLES:
        _copy(ROOT / "mission" / "examples" / name, folder / "mission" / "examples" / name)


def modules() -> list[Path]:
    """Files of the modules of ours that the page imports, where only its stand-ins are."""
    command = [sys.executable, "-P", "-c", LIST, str(HERE / "stand_ins"), str(ROOT)]
    environment = {**os.environ, "UNDERSTORY_PURE": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    found = subprocess.run(command, check=True, capture_output=True, text=True, env=environment, cwd=ROOT).stdout
    return sorted(map(Path, found.split()))


def lock_packages(names: Iterable[str]) -> str:
    """browser.lock: wheels of these packages and what they need, for the page's interpreter, by hash."""
    from hashlib import sha256

    lines = ["# Wheels for the page's interpreter: python -m docs.website.build --lock"]
    with tempfile.TemporaryDirectory(prefix="understory-") as folder:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*command, "--only-binary=:all:", *PLATFORM, "--dest", folder, *names], check=True)
        for wheel in sorted(Path(folder).glob("*.whl")):
            name, version, *_ = wheel.name.split("-")
            lines.append(f"{name}=={version} --hash=sha256:{sha256(wheel.read_bytes()).hexdigest()}")
    return "\n".join(lines) + "\n"


def _copy(file: Path, to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, to)
