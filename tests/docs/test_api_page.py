"""The reference page of the Python API: all that is stable by name is on it, and can be imported as it says."""

from __future__ import annotations

import ast
import importlib
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
IMPORTS = re.findall(r"^from ([\w.]+) import (\w+)$", PAGE, re.MULTILINE)
PACKAGES = ("mission", "companion", "sim_bridge")


@pytest.mark.parametrize(("module", "name"), IMPORTS, ids=[name for _, name in IMPORTS])
def test_a_name_can_be_imported_as_the_page_says(module: str, name: str) -> None:
    assert hasattr(importlib.import_module(module), name)


def test_what_is_stable_is_on_the_page() -> None:
    stability = (ROOT / "docs" / "reference" / "stability.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| Python: (.+?) \|", stability, re.MULTILINE)
    modules = {module for module, _ in IMPORTS}
    names = {f"{module}.{name}" for module, name in IMPORTS}
    for promised in re.findall(r"`([\w.]+)`", row):
        assert promised in modules | names, promised
    for group in re.findall(r"`(understory\.\w+)`", stability):
        assert f"`{group}`" in PAGE


def test_examples_of_packages_import_what_is_on_the_page_alone() -> None:
    """But for the helpers that the how-tos name."""
    helpers = {
        "companion.mavlink.dialect",
        "companion.mavlink.framing.wire",
        "companion.mavlink.framing.frames",
        "companion.sensors.obstacle_sensor",
        "companion.core.model.states",
        "companion.mavlink.makes.px4",
        "mission.common.frames",
    }
    stable = {module for module, _ in IMPORTS}
    for file in (ROOT / "docs" / "examples").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
                modules = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
                assert modules & (stable | helpers), f"{file.name}: {node.module}"


def test_every_extra_is_told_and_no_message_names_a_distribution_that_is_not_published() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert set(re.findall(r"^\| `(\w+)` \|", PAGE.partition("## Fly")[0], re.MULTILINE)) == set(extras)
    for folder in PACKAGES:
        for file in (ROOT / folder).rglob("*.py"):
            text = file.read_text(encoding="utf-8")
            assert "pip install 'understory" not in text
            for named in re.findall(r"pip install -e '\.\[([\w,]+)\]'", text):
                assert set(named.split(",")) <= set(extras), file


def test_the_packages_are_typed() -> None:
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").is_file()
    data = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["package-data"]
    assert all("py.typed" in data[package] for package in PACKAGES)
