"""Laws of installed packages: entry points of the group `understory.laws`, each the name of a law and its module."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, Final

GROUP: Final = "understory.laws"
RESERVED: Final = "ours"


class EntryPointError(Exception):
    """An entry point that names no law; the message names it, its package and what is wrong."""


@dataclass(frozen=True, slots=True)
class InstalledLaw:
    """A law's entry point: can be sent to other processes of the same environment."""

    name: str
    value: str  # module, or module:object
    package: str  # with its version

    @property
    def title(self) -> str:
        """Words for messages."""
        return f"{self.name} (entry point {GROUP}: {self.value}, of {self.package})"

    def find_file(self) -> Path:
        """The source of its module, which is not imported. EntryPointError."""
        try:
            module = self._point().module
            spec = importlib.util.find_spec(module)
        except AttributeError:  # importlib.metadata's, where the value does not parse
            raise EntryPointError(f"{self.title}: must be MODULE or MODULE:OBJECT") from None
        except Exception as error:
            raise EntryPointError(f"{self.title}: {type(error).__name__}: {error}") from error
        if spec is None or spec.origin is None or not Path(spec.origin).is_file():
            raise EntryPointError(f"{self.title}: there is no module {module} with a file")
        return Path(spec.origin)

    def load_object(self) -> Any:
        """The module or object. Whatever an import raises."""
        return self._point().load()

    def _point(self) -> EntryPoint:
        return EntryPoint(self.name, self.value, GROUP)


def installed_names() -> list[str]:
    """Names of the laws that installed packages have."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def find_installed(name: str) -> InstalledLaw | None:
    """The law of that name; None: no package has one. EntryPointError: two have, or the name is not to be had."""
    found = {(point.value, _package(point)) for point in entry_points(group=GROUP, name=name)}
    if not found:
        return None
    if len(found) > 1:
        packages = ", ".join(sorted(package for _, package in found))
        raise EntryPointError(f"{name}: entry point {GROUP} of more than one package: {packages}")
    ((value, package),) = found
    if name == RESERVED or name.endswith(".py"):
        raise EntryPointError(f"{name}: entry point {GROUP} of {package}: must have another name")
    return InstalledLaw(name, value, package)


def _package(point: EntryPoint) -> str:
    return "a package without a name" if point.dist is None else f"{point.dist.name} {point.dist.version}"
