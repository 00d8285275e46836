"""Make dist/understory-VERSION-linux.tar.gz: all that a board needs, for every Python and processor it may have.

Our own wheel is in it as pure Python, for all of them, and compiled: for the Python that runs this, on each processor
that a C compiler is there for. The same sources, lock and compilers give the same archive to the bit. Needs the package
index once; the wheels are kept under build/.
"""

from __future__ import annotations

import gzip
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Iterator, Mapping
from itertools import product
from pathlib import Path
from types import MappingProxyType

from packaging.markers import InvalidMarker, Marker

ROOT = Path(__file__).parents[2]
BOARD = Path(__file__).parent
LOCK = ROOT / "requirements-board.lock"
FILES = ("install.sh", "understory-companion.service", "companion.env", "journald.conf", "README.md")
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "mission", "companion", "sim_bridge")
# Raspberry Pi OS and Debian 12, Ubuntu 24.04, Debian 13; install.sh says the same.
PYTHONS = ("3.11", "3.12", "3.13")
MACHINES = ("aarch64", "x86_64")
LIBC = ("manylinux_2_28", "manylinux_2_17", "manylinux2014")
# mypyc writes the same C for both, and Python's headers are the same on both: 64 bits, the least byte first.
COMPILERS = {"aarch64": "aarch64-linux-gnu-gcc", "x86_64": "x86_64-linux-gnu-gcc"}
SILENT_MAX_S = 4.0  # between two signs of life
EPOCH = 315_532_800  # 1980-01-01, the first day that a wheel's archive can name
EXIT_DONE, EXIT_FAILED, EXIT_BAD_FILE, EXIT_ENVIRONMENT = 0, 1, 2, 3


class BundleError(Exception):
    """No bundle; the message says why."""

    def __init__(self, exit_code: int, message: str) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def main() -> int:
    """Make it; the exit code."""
    try:
        path = make(ROOT / "dist", ROOT / "build" / "board")
    except BundleError as error:
        print(f"bundle: {error}", file=sys.stderr)
        return error.exit_code
    print(f"{path.relative_to(ROOT)}  {path.stat().st_size / 1e6:.0f} MB  sha256 {_sha256(path.read_bytes())}")
    return EXIT_DONE


def make(out: Path, cache: Path, version: str | None = None) -> Path:
    """The archive, in `out`. `version`: of mission/__init__.py unless given. BundleError."""
    lock = LOCK.read_text(encoding="utf-8")
    wheels = downloaded(lock, cache)
    with tempfile.TemporaryDirectory() as folder:
        own = own_wheel(Path(folder), version)
        name = own.name.split("-")
        owns = [own, *compiled_wheels(Path(folder))]
        files = {f"wheels/{wheel.name}": wheel.read_bytes() for wheel in [*wheels.glob("*.whl"), *owns]}
    files |= {name: (BOARD / name).read_bytes() for name in FILES}
    files |= {LOCK.name: lock.encode(), "VERSION": f"{name[1]}\n".encode()}
    stem = f"understory-{name[1]}-linux"
    out.mkdir(exist_ok=True)
    path = out / f"{stem}.tar.gz"
    path.write_bytes(archive(stem, files))
    return path


def downloaded(lock: str, cache: Path) -> Path:
    """The folder with the locked wheels of every target."""
    locks = {target: lock_of(lock, *target) for target in product(PYTHONS, MACHINES)}
    targets = f"{PYTHONS}{MACHINES}{LIBC}"
    folder = cache / f"wheels-{_sha256((lock + targets).encode())[:16]}"
    if folder.is_dir():
        return folder
    partial = folder.with_suffix(".partial")
    partial.mkdir(parents=True, exist_ok=True)
    for (python, machine), part in locks.items():
        print(f"wheels for Python {python}, {machine}", flush=True)
        with tempfile.NamedTemporaryFile("w", suffix=".lock") as one:
            one.write(part)
            one.flush()
            _pip(
                *("download", "--quiet", "--only-binary=:all:", "--require-hashes", "--requirement", one.name),
                *("--python-version", python, "--implementation", "cp", "--dest", str(partial)),
                *(f"--platform={libc}_{machine}" for libc in LIBC),
            )
    partial.rename(folder)
    return folder


def lock_of(lock: str, python: str, machine: str) -> str:
    """The part of the lock for one target: pip reads conditions for the Python that runs here. BundleError."""
    names = {
        "implementation_name": "cpython",
        "os_name": "posix",
        "platform_machine": machine,
        "platform_python_implementation": "CPython",
        "platform_system": "Linux",
        "python_full_version": f"{python}.0",
        "python_version": python,
        "sys_platform": "linux",
    }
    kept, holds = [], True
    for line in lock.splitlines(keepends=True):
        if line[:1] not in (" ", "#", "\n"):
            what, _, condition = line.rstrip(" \\\n").partition(";")
            try:
                holds = not condition or Marker(condition).evaluate(names)
            except InvalidMarker as error:
                raise BundleError(EXIT_BAD_FILE, f"{LOCK.name}: {what.strip()}: {error}") from None
            line = line.replace(f";{condition}", "") if condition else line
        if holds:
            kept.append(line)
    return "".join(kept)


def own_wheel(folder: Path, version: str | None) -> Path:
    """Our own, pure, built in `folder` from a copy: what an earlier build has left behind stays out of it."""
    source = folder / "source"
    source.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.so", "*.sums"))
        else:
            shutil.copy(ROOT / name, source)
    if version is not None:
        module = source / "mission" / "__init__.py"
        text = module.read_text(encoding="utf-8")
        module.write_text(re.sub('__version__ = ".*"', f'__version__ = "{version}"', text), encoding="utf-8")
    for path in source.rglob("*"):  # whatever this user's umask is
        path.chmod(0o755 if path.is_dir() else 0o644)
    _build(source, folder, {"UNDERSTORY_PURE": "1"})
    (wheel,) = folder.glob("understory_uav-*-none-any.whl")
    return wheel


def compiled_wheels(folder: Path) -> Iterator[Path]:
    """Our own, compiled from the copy that `own_wheel` has left in `folder`; where a compiler is missing, none."""
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    for machine, compiler in COMPILERS.items():
        if shutil.which(compiler) is None:
            print(f"no {compiler}: the wheel for {machine} is pure Python", flush=True)
            continue
        print(f"compiling for {python}, {machine}", flush=True)
        into = folder / machine
        into.mkdir()
        suffix = f".cpython-{python.removeprefix('cp')}-{machine}-linux-gnu.so"
        target = {
            "CC": compiler,
            "LDSHARED": f"{compiler} -shared",
            "SETUPTOOLS_EXT_SUFFIX": suffix,
            "_PYTHON_HOST_PLATFORM": f"linux-{machine}",
        }
        _build(folder / "source", into, target)
        yield from into.glob(f"understory_uav-*-{python}-*.whl")


def archive(stem: str, files: Mapping[str, bytes]) -> bytes:
    """A tar.gz of `files` under `stem`/, with SHA256SUMS; a function of its arguments alone."""
    sums = "".join(f"{_sha256(data)}  {name}\n" for name, data in sorted(files.items()))
    packed = io.BytesIO()
    # Wheels are compressed already.
    with (
        gzip.GzipFile("", "wb", compresslevel=1, fileobj=packed, mtime=EPOCH) as stream,
        tarfile.open(fileobj=stream, mode="w", format=tarfile.USTAR_FORMAT) as tar,
    ):
        for name, data in _sorted(files, sums):
            entry = tarfile.TarInfo(f"{stem}/{name}")
            entry.size, entry.mtime = len(data), EPOCH
            entry.mode = 0o755 if name.endswith(".sh") else 0o644
            entry.uname = entry.gname = "root"
            tar.addfile(entry, io.BytesIO(data))
    return packed.getvalue()


def _sorted(files: Mapping[str, bytes], sums: str) -> Iterator[tuple[str, bytes]]:
    yield "SHA256SUMS", sums.encode()
    yield from sorted(files.items())


def _build(source: Path, into: Path, environment: Mapping[str, str]) -> None:
    _pip(
        *("wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(into), str(source)),
        environment=environment,
    )


def _pip(*arguments: str, environment: Mapping[str, str] = MappingProxyType({})) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(EPOCH), **environment}
    began_s = time.monotonic()
    with subprocess.Popen(command, umask=0o022, env=environment) as pip:
        while True:
            try:
                code = pip.wait(SILENT_MAX_S)
                break
            except subprocess.TimeoutExpired:
                print(f"pip {arguments[0]}: {time.monotonic() - began_s:.0f} s", flush=True)
    if code:
        what = " ".join(re.sub(r".*/", "", word) for word in arguments)
        raise BundleError(EXIT_ENVIRONMENT, f"pip {what}: exit code {code}, see above")


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
