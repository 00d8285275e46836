"""A folder of installed packages, as pip leaves one: metadata, entry points, modules."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from mission.document.model import Mission
from tests.unit.core.core_kit import mission


class Site:
    """A folder to be put on Python's path."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def install(self, package: str, group: str, entry: str, **modules: str) -> None:
        """Version 1.2 of a package with one entry point, `name = value`, and its modules' texts."""
        info = self.folder / f"{package}-1.2.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.2\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n", encoding="utf-8")
        for name, text in modules.items():
            (self.folder / f"{name}.py").write_text(text, encoding="utf-8")


def mission_with(*sensors: str, name: str = "", **tables: dict[str, Any]) -> Mission:
    """The kit's mission, which names sensors."""
    values = mission(**tables).model_dump(by_alias=True, exclude_unset=True)
    return Mission.model_validate(values | {"sensors": sensors, "name": name})


def pip_install(package: Path, folder: Path) -> Path:
    """Builds and installs the package in `package` as it stands, without a network; the folder for Python's path."""
    source = folder / "source" / package.name
    shutil.copytree(package, source)  # a build leaves files beside its sources
    target = folder / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--no-build-isolation", "--target", str(target), str(source)], check=True)
    return target
