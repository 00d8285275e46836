"""Compiles what flies, and the bridge's vehicles, with mypyc: the same sources, the same flight, in less time.

Everything else about the distribution is in pyproject.toml. Where mypyc, a C compiler or Python's headers are missing,
or UNDERSTORY_PURE is set, nothing is compiled and everything runs as pure Python: docs/decisions/compiled-hot-path.md.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import shlex
import shutil
import sys
import sysconfig
from collections.abc import Iterable
from importlib.machinery import EXTENSION_SUFFIXES
from itertools import chain
from pathlib import Path
from textwrap import shorten

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CCompilerError, ExecError, PlatformError

ROOT = Path(__file__).parent
sys.path.insert(0, str(ROOT))

from mission.common.compiled import SWITCH, manifest_name  # noqa: E402

# What runs in every tick of a flight. Each group becomes one library (two cores: two at a time), named by its key.
COMPILED = {
    "sim_bridge.world.native": (
        "sim_bridge/world/*.py",
        "sim_bridge/world/airframe/*.py",
        "sim_bridge/world/autopilot/*.py",
        "sim_bridge/world/autopilot/*/*.py",
        "sim_bridge/world/sensors/*.py",
        "sim_bridge/world/sensors/payload/*.py",  # its drivers inherit from what is compiled
        "sim_bridge/drive/links/hub.py",
        "sim_bridge/drive/links/inbox.py",
        "sim_bridge/drive/links/transmitter.py",
        "sim_bridge/drive/lockstep/lockstep.py",
        "sim_bridge/drive/lockstep/processes.py",
        "sim_bridge/drive/ticks.py",
        "sim_bridge/judge/observer.py",
        "sim_bridge/judge/recording.py",
        "sim_bridge/judge/tick.py",
        "sim_bridge/judge/tlog.py",
        "sim_bridge/lab/study/ours.py",
        "sim_bridge/trunk_attenuation.py",
        "mission/stand/stand.py",
    ),
    "companion.core.native": (
        "mission/common/frames.py",
        "companion/core/*.py",
        "companion/core/*/*.py",
        "companion/core/*/*/*.py",
    ),
    "companion.mavlink.native": (
        "companion/mavlink/*.py",
        "companion/mavlink/autopilot_link/*.py",
        "companion/mavlink/framing/*.py",
        "companion/mavlink/orders/*.py",
        "companion/mavlink/peers/*.py",
        "companion/journal/channels.py",
        "companion/journal/journal.py",
        "companion/journal/mcap.py",
        "companion/journal/recorder.py",
        "companion/journal/tape/*.py",
        "companion/sensors/scans.py",
        "companion/sensors/lidar_pieces.py",
        "companion/survey/ground.py",
        "companion/survey/rays.py",
        "companion/survey/stem_rays.py",
    ),
}
PURE = {
    "companion/mavlink/dialect.py",  # generated, and untyped
    "companion/mavlink/sensor_source.py",  # a base class: sensors are not compiled, and do little in a tick
    "sim_bridge/world/airframe/base.py",  # an exception of a kind that mypyc does not compile
    "sim_bridge/world/airframe/bench.py",  # a program
    "sim_bridge/world/sensors/bench.py",  # the same
    "sim_bridge/world/sensors/installed.py",  # reads a protocol's signatures, which compiled functions have not
    "sim_bridge/world/autopilot/commands.py",  # a generic dataclass: mypyc's does not load
    "sim_bridge/world/autopilot/ardupilot/commands.py",
    "sim_bridge/world/autopilot/px4/commands.py",
}
BUILD = "build/mypyc"
PURE_THEN = "everything runs as pure Python"
FLAGS = (
    "-ffp-contract=off",  # else arm64 rounds a * b + c once, and not twice as Python does
    "-Wno-error",  # mypyc asks for errors: a newer compiler's new warning is no reason not to compile
    "-fcommon",  # every file of a group defines the other groups' tables: they are one
)
MYPY = ["--cache-dir", os.devnull]  # with what an earlier run has left, mypyc 2.4 breaks down


def modules(patterns: Iterable[str]) -> list[str]:
    """The sources to compile."""
    found = chain.from_iterable(ROOT.glob(pattern) for pattern in patterns)
    names = {path.relative_to(ROOT).as_posix() for path in found if path.name != "__init__.py"}
    return sorted(names - PURE)


def missing() -> str | None:
    """What it takes to compile, and is not here."""
    if os.environ.get(SWITCH):
        return f"{SWITCH} is set"
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    if shutil.which(compiler) is None:
        return f"no C compiler ({compiler})"
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        return "no Python.h (Debian and Ubuntu: apt install python3-dev)"
    try:
        import mypyc.build  # noqa: F401
    except ImportError:
        return "no mypyc"
    return None


def extensions() -> list[Extension]:
    """One for each group, and one for each module that leads there; none: pure Python, and a line says why."""
    why = missing()
    if why is None:
        from mypyc.build import mypycify

        groups = {name: modules(patterns) for name, patterns in COMPILED.items()}
        said = io.StringIO()  # of use to whoever tunes the sources, and alarming to everybody else
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
                found = mypycify(
                    [*MYPY, *chain.from_iterable(groups.values())],
                    opt_level="1",  # 3 compiles for minutes more; most of what is left is calls into Python
                    debug_level="0",
                    multi_file=True,
                    separate=[(sources, name) for name, sources in groups.items()],
                    target_dir=BUILD,
                )
        except SystemExit:
            print(said.getvalue(), end="")
            why = "mypyc refuses the sources, see above"
        else:
            for extension in found:
                extension.extra_compile_args = [*extension.extra_compile_args, *FLAGS]
                # mypyc looks for a group's headers beside its sources, and writes them into the group's folder.
                extension.include_dirs = [
                    *extension.include_dirs,
                    f"{BUILD}/{'/'.join(extension.name.split('.')[:-1])}",
                ]
            return found
    print(f"{why}: {PURE_THEN}", flush=True)
    return []


def manifest() -> str:
    """What mission/common/compiled.py compares with the sources that it finds."""
    return "".join(
        f"{hashlib.sha256((ROOT / name).read_bytes()).hexdigest()}  {name}\n"
        for name in modules(chain.from_iterable(COMPILED.values()))
    )


class Compile(build_ext):
    """On all cores; all or none; the manifest last."""

    def finalize_options(self) -> None:
        super().finalize_options()
        self.parallel = self.parallel or os.cpu_count()

    def run(self) -> None:
        here = ROOT if self.inplace else Path(self.build_lib)
        # First: an interrupted build leaves modules of which nobody knows what they were compiled from.
        if self.extensions:
            self._manifest(here).unlink(missing_ok=True)
            self._remove_left_over(here)
        try:
            super().run()
        except (CCompilerError, ExecError, PlatformError) as error:
            print(f"{shorten(str(error), 200)}: {PURE_THEN}", flush=True)
            self.extensions = []
            return
        if self.extensions:
            self._manifest(here).write_text(SUMS, encoding="utf-8")

    def _remove_left_over(self, here: Path) -> None:
        """Modules that an earlier checkout compiled and this one does not: Python would load them all the same."""
        wanted = {Path(self.get_ext_filename(extension.name)) for extension in self.extensions}
        for package in ("mission", "companion", "sim_bridge"):
            for path in (here / package).rglob(f"*{EXTENSION_SUFFIXES[0]}"):
                if path.relative_to(here) not in wanted:
                    path.unlink()

    def get_outputs(self) -> list[str]:
        outputs = super().get_outputs()
        return [*outputs, str(self._manifest(Path(self.build_lib)))] if outputs else []

    @staticmethod
    def _manifest(folder: Path) -> Path:
        return (
            folder
            / "mission"
            / "common"
            / manifest_name(os.environ.get("SETUPTOOLS_EXT_SUFFIX") or EXTENSION_SUFFIXES[0])
        )


SUMS = manifest()  # before the sources are read to be compiled: a change meanwhile makes them stale
setup(ext_modules=extensions(), cmdclass={"build_ext": Compile})
