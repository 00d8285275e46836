"""Pages of the site: each has its place in the navigation, and lists are nested as the generator wants them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from docs.website import pages
from docs.website.browser import NPM, modules

ROOT = Path(__file__).parents[3]


def listed(nav: Any) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    elif isinstance(nav, dict):
        for one in nav.values():
            yield from listed(one)
    else:
        for one in nav:
            yield from listed(one)


def test_every_page_is_in_the_navigation_once() -> None:
    nav = tomllib.loads(pages.config())["project"]["nav"]
    found = list(listed(nav))
    wanted = {
        str(page.relative_to(ROOT)).replace("README.md", "index.md")
        for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    }
    assert sorted([*found, "docs/paper/table1.md"]) == sorted(wanted)  # which the page of the paper links


def test_packages_of_npm_are_no_pages() -> None:
    assert not NPM.is_relative_to(ROOT / "docs")
    assert not list((ROOT / "docs").rglob("node_modules"))


def test_linked_files_are_beside_the_pages(tmp_path: Path) -> None:
    pages.stage_pages(tmp_path)
    assert (tmp_path / "index.md").is_file()
    assert (tmp_path / "docs" / "images" / "replay.webp").is_file()
    assert "](docs/index.md)" in (tmp_path / "index.md").read_text(encoding="utf-8")


def test_a_link_to_nothing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("[a](docs/none.md) and [b](https://example.org) and [c](#here)\n", "utf-8")
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    with pytest.raises(ValueError, match=r"README\.md: docs/none\.md: must be a file"):
        pages.stage_pages(tmp_path / "out")


def test_what_belongs_to_an_item_is_set_in_by_four_spaces() -> None:
    text = "1. one:\n\n   ```js\n   - x\n   ```\n\n2. two\n   - in\n\nafter\n\n"
    nested = "1. one:\n\n    ```js\n    - x\n    ```\n\n2. two\n    - in\n\nafter\n\n"
    kept = "```text\n- no item\n  of a list\n```\n"
    assert pages.indented(f"{text}{kept}- b\n  c\n") == f"{nested}{kept}- b\n    c\n"


def test_the_page_imports_nothing_that_is_not_there() -> None:
    found = {str(file.relative_to(ROOT)) for file in modules()}
    assert {"companion/core/agent.py", "mission/document/load.py", "sim_bridge/world/world.py"} <= found
    assert not [name for name in found if name.startswith(("sim_bridge/lab", "companion/shell", "tests"))]
