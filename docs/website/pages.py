"""The pages of the documentation for the site's generator: as they lie in the repository, and files that they link."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from mission import __version__

ROOT: Final = Path(__file__).parents[2]
LINK: Final = re.compile(r"(!?\[[^\]\n]*(?:\][^\[\]\n()]*)?\]\()([^)\s#]*)((?:#[^)\s]*)?\))")
NAV_LINK: Final = re.compile(r"\[([^\]]+)\]\(([^)#\s]+\.md)\)")
ITEM: Final = re.compile(r"(?:[-*]|[0-9]+\.) +")
INDENT: Final = 4
FENCE: Final = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
SHOWN_AS: Final = {"README.md": "index.md"}


def stage_pages(folder: Path) -> None:
    """Copy the pages, and the files that they link, into `folder`. ValueError names a link to nothing."""
    pages = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for target in _linked(page, text):
            if target.suffix != ".md":
                _copy(target, folder)
        to = folder / page.relative_to(ROOT)
        to.parent.mkdir(parents=True, exist_ok=True)
        to.with_name(SHOWN_AS.get(to.name, to.name)).write_text(indented(_with_indices(text)), encoding="utf-8")


def indented(text: str) -> str:
    """What belongs to an item of a list by four spaces, as the generator wants; forges go by where its text begins."""
    lines: list[str] = []
    more = width = 0
    fenced = False
    for line in text.split("\n"):
        item = None if fenced else ITEM.match(line)
        if item:
            width, more = len(item[0]), max(0, INDENT - len(item[0]))
        elif line and not line.startswith(" " * width if width else "\0"):
            width = more = 0
        if width == 0 and line.startswith("```"):
            fenced = not fenced
        lines.append(" " * more + line if width and line and not item else line)
    return "\n".join(lines)


def config() -> str:
    """The generator's configuration, TOML, for a folder with `pages` in it; the site becomes `site` beside them."""
    project: dict[str, Any] = {
        "site_name": "Understory",
        "site_description": "Flight software for swarms of small UAVs that map forests from under the canopy",
        "docs_dir": "pages",
        "site_dir": "site",
        "copyright": f"Understory {__version__}, Apache-2.0",
    }
    lines = ["[project]", *(f"{name} = {json.dumps(value)}" for name, value in project.items())]
    return "\n".join([*lines, f"nav = {_toml(navigation())}", THEME])


THEME: Final = """
extra_css = ["website/site.css"]

[project.theme]
custom_dir = "overrides"
font = false
language = "en"
features = ["navigation.indexes", "navigation.top", "search.highlight", "content.code.copy", "toc.follow"]
icon.logo = "lucide/trees"

[[project.theme.palette]]
media = "(prefers-color-scheme: light)"
scheme = "default"
toggle.icon = "lucide/sun"
toggle.name = "dark"

[[project.theme.palette]]
media = "(prefers-color-scheme: dark)"
scheme = "slate"
toggle.icon = "lucide/moon"
toggle.name = "light"

[project.markdown_extensions.toc]
permalink = true
slugify.object = "pymdownx.slugs.slugify"
slugify.kwds.case = "lower"

[project.markdown_extensions.tables]

[project.markdown_extensions.pymdownx.highlight]
[project.markdown_extensions.pymdownx.superfences]
custom_fences = [{ name = "mermaid", class = "mermaid", format = "pymdownx.superfences.fence_code_format" }]
"""


def navigation() -> list[Any]:
    """Sections and pages as docs/README.md lists them, and the decisions as theirs does."""
    nav: list[Any] = [{"Understory": "index.md"}]
    docs = ROOT / "docs" / "README.md"
    nav.append({"All pages": "docs/index.md"})
    begun, *sections = docs.read_text(encoding="utf-8").split("\n## ")
    listed = set[str]()
    for section in (f"Begin\n{begun}", *sections):
        title, _, body = section.partition("\n")
        entries: list[Any] = []
        for text, path in NAV_LINK.findall(body):
            name = f"docs/{path}"
            if name in listed:
                continue
            listed.add(name)
            entries.append({"Decisions": _decisions()} if path == "decisions/README.md" else {_capital(text): name})
        nav.append({title: entries})
    root = {"Changes": "CHANGELOG.md", "Contributing": "CONTRIBUTING.md", "Security": "SECURITY.md"}
    return [*nav, {"Project": [{title: path} for title, path in root.items()]}]


def _decisions() -> list[Any]:
    text = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    return ["docs/decisions/index.md", *({_capital(t): f"docs/decisions/{p}"} for t, p in NAV_LINK.findall(text))]


def _linked(page: Path, text: str) -> Iterator[Path]:
    """Files of this repository that a page links to."""
    for _, path, _ in LINK.findall(FENCE.sub("", text)):
        if path and not re.match(r"[a-z]+:", path):
            target = (page.parent / path).resolve()
            if not target.is_file():
                raise ValueError(f"{page.relative_to(ROOT)}: {path}: must be a file")
            yield target


def _with_indices(text: str) -> str:
    """Links to README.md lead to the page that the generator makes of it."""
    return LINK.sub(lambda m: m[1] + re.sub(r"(^|/)README\.md$", r"\1index.md", m[2]) + m[3], text)


def _copy(file: Path, folder: Path) -> None:
    to = folder / file.relative_to(ROOT)
    to.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, to)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:].replace("`", "")


def _toml(value: Any) -> str:
    """Lists, tables and texts, on one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(name)} = {_toml(one)}" for name, one in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)
