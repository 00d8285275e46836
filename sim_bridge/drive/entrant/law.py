"""A foreign law: a module with three functions, loaded once, called for each vehicle, its answers checked.

It is a file, a module, or one that an installed package has given a name (`installed`).
`start(mission, vehicle_id)` -> memory, anything, kept as long as the vehicle is steered without a break;
`transit(memory, view)` and `cover(memory, view)` -> the desired velocity, three numbers, NED m/s. Without `cover` ours
covers.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import math
import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Final, Protocol

from mission.cli.main import EXIT_BAD_FILE
from mission.common.entry_points import TITLE_MAX_CHARS, EntryPointError, Installed
from mission.common.frames import Vec3
from mission.common.problems import printable
from mission.document.model import Mission
from sim_bridge.drive.entrant.installed import find_installed, installed_names
from sim_bridge.drive.entrant.view import View
from sim_bridge.errors import StartError

OPTIONAL: Final = "cover"
FASTEST_MPS: Final = 1000.0  # beyond, it is a mistake: no vehicle's speed limit is near it


class GuidanceLaw(Protocol):
    """Functions that a law's module or object must have. It may have `cover`, of the same form as `transit`, too."""

    def start(self, mission: Mission, vehicle_id: int) -> Any:
        """Memory of one vehicle, which the others get back."""

    def transit(self, memory: Any, view: View) -> Sequence[float]:
        """North, east, down, m/s."""


FORMS: Final[dict[str, Callable[..., Any]]] = {
    "start": GuidanceLaw.start,
    "transit": GuidanceLaw.transit,
    OPTIONAL: GuidanceLaw.transit,
}


class LawError(StartError):
    """A law that cannot be loaded, breaks down, or answers what is no velocity; the message names module, function,
    value.
    """

    def __init__(self, message: str) -> None:
        super().__init__(message, EXIT_BAD_FILE)


@dataclass(frozen=True, slots=True)
class LawFile:
    """A law's module, by its file: can be sent to other processes, and be looked for again."""

    name: str  # for people: the module's, without folders
    module: str  # as it was asked for; of an installed one with its entry point
    path: Path
    sha256: str  # of that file
    installed: Installed | None = None


def find_law(module: str, folder: Path = Path()) -> LawFile:
    """A file (`*.py`, from `folder`), the name of an installed law, or a module that can be imported. LawError."""
    if module.endswith(".py"):
        path = (folder / module).resolve()
        return LawFile(path.stem, module, path, _digest(path, module))
    try:
        installed = find_installed(module)
        path = _module_file(module, folder) if installed is None else installed.find_file()
    except EntryPointError as error:
        raise LawError(f"law {printable(str(error), TITLE_MAX_CHARS)}") from None
    if installed is not None:
        return LawFile(module, installed.title, path, _digest(path, module), installed)
    return LawFile(module.rpartition(".")[2], module, path, _digest(path, module))


def _module_file(module: str, folder: Path) -> Path:
    spec = None
    if not module.startswith("."):  # nothing here to be relative to
        try:
            spec = importlib.util.find_spec(module)
        except ModuleNotFoundError as error:
            if error.name is None or not module.startswith(error.name):  # a package around it lacks something
                raise LawError(f"law {printable(module)}: {error}") from None
        except (ImportError, ValueError) as error:
            raise LawError(f"law {printable(module)}: {error}") from None
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        named = ", ".join(installed_names())
        known = f"the name of an installed law ({named})" if named else "the name of an installed law (there is none)"
        what = "is no Python module" if (folder / module).exists() else "no such module"
        must = f"must be a .py file, {known}, or a module that can be imported"
        raise LawError(f"law {printable(module)}: {what}: {must}")
    return Path(spec.origin)


def _digest(path: Path, module: str) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise LawError(f"law {printable(module)}: cannot be read: {error.strerror}") from None


def load_law(file: LawFile) -> Law:
    """The law in a file. LawError: it is another by now, cannot be imported, or lacks a function."""
    if _digest(file.path, file.module) != file.sha256:
        raise LawError(f"law {file.module}: {file.path} has changed since the start")
    if file.installed is not None:
        try:
            return Law(file, file.installed.load_raw())
        except LawError:
            raise
        except Exception as error:
            raise LawError(f"law {file.module}: cannot be imported: {_words(error, file.path)}") from error
    place = f"understory_law_{file.sha256[:16]}"
    module = sys.modules.get(place)
    if module is None:
        module = _import(file, place)
    return Law(file, module)


def _import(file: LawFile, place: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(place, file.path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[place] = module  # dataclasses of the law look there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[place]
        raise LawError(f"law {file.module}: cannot be imported: {_words(error, file.path)}") from error
    return module


class Law:
    """One law, for all vehicles: `start` makes what one remembers."""

    def __init__(self, file: LawFile, module: object) -> None:
        """LawError: a function is missing, or takes other arguments."""
        self.file = file
        self.covers = callable(getattr(module, OPTIONAL, None))
        self._functions: dict[str, Callable[..., Any]] = {}
        for name, form in FORMS.items():
            arguments = list(inspect.signature(form).parameters)[1:]
            wanted = f"{name}({', '.join(arguments)})"
            found = getattr(module, name, None)
            if callable(found):
                if not _accepts(found, len(arguments)):
                    raise LawError(f"law {file.module}: {name}{inspect.signature(found)}: must take {wanted}")
                self._functions[name] = found
            elif name != OPTIONAL:
                raise LawError(f"law {file.module}: has no function {wanted}: see docs/how-to/fly-your-own-law.md")

    def start(self, mission: Mission, vehicle_id: int) -> Any:
        """The law's initial memory of a vehicle."""
        return self._call("start", mission, vehicle_id)

    def velocity(self, function: str, memory: Any, view: View) -> Vec3:
        """NED m/s, of `transit` or `cover`. LawError for anything else."""
        answer = self._call(function, memory, view)
        try:
            north, east, down = (float(part) for part in answer)
        except (TypeError, ValueError):
            raise self._refused(function, answer, "must be three numbers: north, east, down, m/s") from None
        if not all(map(math.isfinite, (north, east, down))):
            raise self._refused(function, answer, "must be finite")
        if max(abs(north), abs(east), abs(down)) > FASTEST_MPS:
            raise self._refused(function, answer, f"must be within {FASTEST_MPS:g} m/s")
        return (north, east, down)

    def _call(self, function: str, *arguments: Any) -> Any:
        try:
            return self._functions[function](*arguments)
        except Exception as error:
            raise LawError(f"law {self.file.module}: {function}: {_words(error, self.file.path)}") from error

    def _refused(self, function: str, answer: Any, message: str) -> LawError:
        return LawError(f"law {self.file.module}: {function} returned {printable(repr(answer))}: {message}")


def _words(error: Exception, path: Path) -> str:
    """The error in words, and its line in the law."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    line = f", line {lines[-1]}" if lines else ""
    return f"{type(error).__name__}: {printable(str(error))}{line}"


def _accepts(function: Callable[..., Any], count: int) -> bool:
    """True if it can be called with so many values, or Python does not know."""
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError:
        return False
    except ValueError:  # built in, without a signature
        return True
    return True
