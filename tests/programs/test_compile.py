"""setup.py compiles: what it leaves behind when it cannot."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from mission.common.compiled import SWITCH, manifest_name

ROOT = Path(__file__).parents[2]
MYPYC = """
from pathlib import Path
from setuptools import Extension

def mypycify(sources, **options):
    print("warning: nothing that a user can mend")
    Path("module.c").write_text("")
    return [Extension("mission.module", ["module.c"])]
"""


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """The project with a manifest of an earlier build, and a mypyc that takes no time."""
    for name in ("mission", "companion", "sim_bridge"):
        left_out = shutil.ignore_patterns("*.so", "*.sums", "__pycache__", "node_modules")
        shutil.copytree(ROOT / name, tmp_path / name, ignore=left_out)
    for name in ("setup.py", "pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    (tmp_path / "mypyc").mkdir()
    (tmp_path / "mypyc" / "__init__.py").touch()
    (tmp_path / "mypyc" / "build.py").write_text(MYPYC)
    manifest(tmp_path).write_text("")
    return tmp_path


def manifest(tree: Path) -> Path:
    return tree / "mission" / "common" / manifest_name(EXTENSION_SUFFIXES[0])


def build(tree: Path, **environment: str) -> str:
    """What a user sees."""
    done = subprocess.run(
        [sys.executable, "setup.py", "--quiet", "build_ext", "--inplace"],
        cwd=tree,
        env={k: v for k, v in os.environ.items() if k != SWITCH} | {"PYTHONPATH": str(tree)} | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=True,
    )
    return done.stdout


def test_after_a_build_that_failed_nothing_counts_as_compiled(tree: Path) -> None:
    shown = build(tree, CC="false")
    assert not manifest(tree).exists()
    assert len(shown) < 400
    assert shown.rstrip().endswith("everything runs as pure Python")


def test_what_is_of_no_use_to_a_user_is_not_shown(tree: Path) -> None:
    assert "warning" not in build(tree, CC="false")


def test_without_a_compiler_it_says_so(tree: Path) -> None:
    assert build(tree, CC="no-such-compiler") == "no C compiler (no-such-compiler): everything runs as pure Python\n"
