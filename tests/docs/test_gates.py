"""The gates of `make check`: exceptions that are none are found, and so is what they are to keep out."""

from __future__ import annotations

import ast
import tomllib
from pathlib import Path

import pytest

from tests.gates import file_length, package_size, words

ROOT = Path(__file__).parents[2]
EXCEPTIONS = ROOT / "tests" / "gates" / "unused_exceptions.py"
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]


def test_file_that_is_too_long_is_named(tmp_path: Path) -> None:
    (tmp_path / "mission").mkdir()
    (tmp_path / "mission" / "long.py").write_text("x = 1\n" * 401, encoding="utf-8")
    (tmp_path / "mission" / "short.py").write_text("x = 1\n" * 400, encoding="utf-8")
    assert list(file_length.problems(tmp_path, {})) == ["mission/long.py: 401 lines; at most 400"]
    assert list(file_length.problems(tmp_path, {"mission/long.py": "a table"})) == []


def test_exception_of_a_file_that_is_short_or_gone_is_named(tmp_path: Path) -> None:
    (tmp_path / "mission").mkdir()
    (tmp_path / "mission" / "short.py").write_text("x = 1\n", encoding="utf-8")
    exceptions = {"mission/short.py": "was long", "mission/gone.py": "was there"}
    assert len(list(file_length.problems(tmp_path, exceptions))) == 2


def test_package_with_too_many_files_is_named(tmp_path: Path) -> None:
    for package, files in (("full", 12), ("over", 13)):
        (tmp_path / "mission" / package).mkdir(parents=True)
        for name in ("__init__", *(f"part_{i}" for i in range(files))):
            (tmp_path / "mission" / package / f"{name}.py").touch()
    assert [line.split(":")[0] for line in package_size.problems(tmp_path, {})] == ["mission/over"]
    assert list(package_size.problems(tmp_path, {"mission/over": "a table"})) == []
    assert len(list(package_size.problems(tmp_path, {"mission/over": "a table", "mission/full": "was larger"}))) == 1


def test_every_exception_of_unused_code_is_needed() -> None:
    core = pytest.importorskip("vulture.core")
    settings = SETTINGS["vulture"]
    scan = core.Vulture(ignore_names=settings["ignore_names"], ignore_decorators=settings["ignore_decorators"])
    paths = [ROOT / path for path in settings["paths"] if ROOT / path != EXCEPTIONS]
    scan.scavenge(paths, exclude=[str(ROOT / name) for name in settings["exclude"]])
    unused = {item.name for item in scan.get_unused_code()}
    listed = {
        node.attr if isinstance(node, ast.Attribute) else node.id
        for node in ast.walk(ast.parse(EXCEPTIONS.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) or (isinstance(node, ast.Name) and node.id != "_")
    }
    assert listed == unused


def test_words_that_the_field_does_not_use_are_named(tmp_path: Path) -> None:
    source = tmp_path / "companion" / "peers.py"
    source.parent.mkdir()
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "page.md").write_text("## What sounds\n\nplace lost, in a sentence\n", encoding="utf-8")
    source.write_text(
        '"""Which peers there are."""\n\n\ndef hear(place_lost: int) -> str:\n    return "hold: place lost"\n',
        encoding="utf-8",
    )
    (source.parent / "gnss.py").write_text('text = "the leader hears no satellites"\n', encoding="utf-8")
    found = "\n".join(words.problems(tmp_path))
    for problem in (
        "companion/peers.py:4: hear(): a bare verb",
        "companion/peers.py:4: name place_lost; say position_uncertain",
        "companion/peers.py:5: text 'place lost'; say 'position uncertain'",
        "companion/peers.py:1: docstring 'Which peers there are.' is a riddle; say what it is",
        "companion/gnss.py:1: text 'hears no satellite'; say 'no GNSS fix'",
        "docs/page.md:1: heading 'What sounds'; say 'Alarms'",
    ):
        assert problem in found
    assert found.count("\n") == 5  # each once


def test_good_words_pass(tmp_path: Path) -> None:
    (tmp_path / "companion").mkdir()
    source = (
        '"""Peers by id."""\n\n\ndef update_peers(position_sd_m: float) -> str:\n    return "hold: position lost"\n'
    )
    (tmp_path / "companion" / "peers.py").write_text(source, encoding="utf-8")
    assert list(words.problems(tmp_path)) == []


def test_sources_are_in_the_words_of_the_field() -> None:
    assert list(words.problems()) == []
