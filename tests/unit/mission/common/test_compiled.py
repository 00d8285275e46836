"""Compiled modules are imported when they are of the sources that lie beside them, and never otherwise."""

from __future__ import annotations

import ast
import hashlib
import os
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from mission.common import compiled

PACKAGE = Path(compiled.__file__).parents[1]
SOURCE = "mission/common/frames.py"


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The package `mission` with an extension module that no Python can load, and its manifest."""
    monkeypatch.delenv(compiled.SWITCH, raising=False)
    ignored = shutil.ignore_patterns("__pycache__", "*.so", "*.sums")
    shutil.copytree(PACKAGE, tmp_path / "mission", ignore=ignored)
    (tmp_path / SOURCE).with_suffix(EXTENSION_SUFFIXES[0]).write_bytes(b"compiled")
    digest = hashlib.sha256((tmp_path / SOURCE).read_bytes()).hexdigest()
    (tmp_path / "mission" / "common" / compiled.MANIFEST.name).write_text(f"{digest}  {SOURCE}\n")
    return tmp_path


def imported(tree: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """What a process says that imports from the tree."""
    program = "import mission.common.frames; print(mission.common.compiled.STATE)"
    return subprocess.run(
        [sys.executable, "-B", "-c", program],
        cwd=tree,
        env={**{k: v for k, v in os.environ.items() if k != compiled.SWITCH}, "PYTHONPATH": str(tree), **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_what_was_compiled_from_these_sources_is_imported(tree: Path) -> None:
    done = imported(tree)
    assert "ImportError" in done.stderr  # of the extension module: it is not one
    assert compiled.MANIFEST.name.removesuffix(".sums") in done.stderr


def test_a_changed_source_is_imported_instead_and_named(tree: Path) -> None:
    with (tree / SOURCE).open("a") as source:
        source.write("# changed\n")
    done = imported(tree)
    assert done.stdout == f"pure Python ({SOURCE} is not what was compiled: `make install` compiles it)\n", done.stderr


def test_without_a_manifest_the_source_is_imported(tree: Path) -> None:
    (tree / "mission" / "common" / compiled.MANIFEST.name).unlink()
    assert imported(tree).stdout == "pure Python (not compiled)\n"


def test_the_switch_takes_the_sources(tree: Path) -> None:
    assert imported(tree, **{compiled.SWITCH: "1"}).stdout == f"pure Python ({compiled.SWITCH} is set)\n"


def test_a_source_that_is_gone_makes_the_compiled_stale(tree: Path) -> None:
    manifest = tree / "mission" / "common" / compiled.MANIFEST.name
    manifest.write_text(manifest.read_text() + f"{'0' * 64}  companion/core/gone.py\n")
    why = compiled.why_pure(manifest, tree)
    assert why is not None
    assert why.startswith("companion/core/gone.py is not what was compiled")


@pytest.mark.parametrize("package", ["companion", "sim_bridge"])
def test_every_package_settles_it_before_its_first_module(package: str) -> None:
    program = f"import sys, {package}; print('mission.common.compiled' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"


def setup_tables() -> tuple[list[str], set[str]]:
    """setup.py's patterns of the sources to compile, and the names of those left out."""
    tables = {
        ast.unparse(statement.targets[0]): ast.literal_eval(statement.value)
        for statement in ast.parse((PACKAGE.parent / "setup.py").read_text(encoding="utf-8")).body
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) in {"COMPILED", "PURE"}
    }
    return [name for group in tables["COMPILED"].values() for name in group], tables["PURE"]


def compiled_sources() -> list[Path]:
    patterns, pure = setup_tables()
    found = {file for name in patterns for file in PACKAGE.parent.glob(name)}
    return sorted(found - {PACKAGE.parent / name for name in pure})


def test_no_compiled_source_has_a_final_tuple_of_numbers() -> None:
    """mypyc 2.4 keeps one as a struct, and takes it for unset where the code that reads it is laid out one way."""
    found = []
    for source in compiled_sources():
        for statement in ast.parse(source.read_text(encoding="utf-8")).body:
            match statement:
                case ast.AnnAssign(target=ast.Name(id=name), annotation=annotation, value=ast.Tuple(elts=parts)):
                    texts = any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in parts)
                    if "Final" in ast.unparse(annotation) and not texts:
                        found.append(f"{source.relative_to(PACKAGE.parent)}: {name}")
    assert found == []


def test_every_source_that_setup_names_is_there() -> None:
    """One that has moved would fly uncompiled, and nothing would say so."""
    patterns, pure = setup_tables()
    assert [name for name in (*patterns, *pure) if not any(PACKAGE.parent.glob(name))] == []


def test_make_compiles_anew_when_any_source_that_is_compiled_has_changed() -> None:
    """The Makefile's list is of patterns, too: one that is not in it would fly uncompiled after a pull."""
    makefile = (PACKAGE.parent / "Makefile").read_text(encoding="utf-8").replace("\\\n", " ")
    (line,) = [line for line in makefile.splitlines() if line.startswith("SOURCES :=")]
    patterns = line.partition("wildcard ")[2].removesuffix(")").split()
    watched = {file for pattern in patterns for file in PACKAGE.parent.glob(pattern)}
    assert {str(file.relative_to(PACKAGE.parent)) for file in {*compiled_sources()} - watched} == set()
