"""Laws of installed packages: entry points of the group `understory.laws`, each the name of a law and its module."""

from __future__ import annotations

from typing import Final

from mission.common import entry_points
from mission.common.entry_points import EntryPointError, Installed

GROUP: Final = "understory.laws"
RESERVED: Final = "ours"


def installed_names() -> list[str]:
    """Names of the laws that installed packages have."""
    return entry_points.installed_names(GROUP)


def find_installed(name: str) -> Installed | None:
    """The law of that name; None: no package has one. EntryPointError: two have, or the name is not to be had."""
    found = entry_points.find_installed(GROUP, name)
    if found is not None and (name == RESERVED or name.endswith(".py")):
        raise EntryPointError(f"{name}: entry point {GROUP} of {found.package}: must have another name")
    return found
