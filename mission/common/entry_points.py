"""Entry points of installed packages: found by group and name, loaded, and named with their package in what is said."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

SENSORS: Final = "understory.sensors"  # the group of those that missions name
TITLE_MAX_CHARS: Final = 300  # of an entry point, its package and what is wrong: a line, not a page


class EntryPointError(Exception):
    """An entry point that names nothing that can be used; the message names it, its package and what is wrong."""


@dataclass(frozen=True, slots=True)
class Installed:
    """One entry point: can be sent to other processes of the same environment."""

    group: str
    name: str
    value: str  # module, or module:object
    package: str  # with its version

    @property
    def title(self) -> str:
        """Words for messages."""
        return f"{self.name} (entry point {self.group}: {self.value}, of {self.package})"

    def find_file(self) -> Path:
        """The source of its module, which is not imported. EntryPointError."""
        module = self._module()
        try:
            spec = importlib.util.find_spec(module)
        except Exception as error:
            raise EntryPointError(f"{self.title}: {type(error).__name__}: {error}") from error
        if spec is None or spec.origin is None or not Path(spec.origin).is_file():
            raise EntryPointError(f"{self.title}: there is no module {module} with a file")
        return Path(spec.origin)

    def load_raw(self) -> Any:
        """The module or object. Whatever an import raises."""
        return self._point().load()

    def load(self) -> Any:
        """The module or object. EntryPointError."""
        self._module()
        try:
            return self.load_raw()
        except Exception as error:
            raise EntryPointError(f"{self.title}: cannot be imported: {type(error).__name__}: {error}") from error

    def _module(self) -> str:
        try:
            return self._point().module
        except AttributeError:  # importlib.metadata's, where the value does not parse
            raise EntryPointError(f"{self.title}: must be MODULE or MODULE:OBJECT") from None

    def _point(self) -> EntryPoint:
        return EntryPoint(self.name, self.value, self.group)


def installed_names(group: str) -> list[str]:
    """Names that installed packages have in a group."""
    return sorted({point.name for point in entry_points(group=group)})


def find_installed(group: str, name: str) -> Installed | None:
    """The entry point of that name; None: no package has one. EntryPointError: more than one has."""
    found = {(point.value, _package(point)) for point in entry_points(group=group, name=name)}
    if not found:
        return None
    if len(found) > 1:
        packages = ", ".join(sorted(package for _, package in found))
        raise EntryPointError(f"{name}: entry point {group} of more than one package: {packages}")
    ((value, package),) = found
    return Installed(group, name, value, package)


def _package(point: EntryPoint) -> str:
    return "a package without a name" if point.dist is None else f"{point.dist.name} {point.dist.version}"
