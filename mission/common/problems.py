"""Problems of a mission (what is wrong, where, what would be right): the form of every refusal in this package."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

Path = tuple[str | int, ...]
"""A key's place in the document: ("forest", "trees", 2, "height_m"). An index counts from 0."""

MAX_PROBLEMS = 100  # nobody reads more, and a hostile file holds ten thousand
MAX_SHOWN_CHARS = 60
MAX_KEY_CHARS = 80
MAX_SHOWN_ITEMS = 4


@dataclass(frozen=True, slots=True)
class Problem:
    """One refusal. Text from the file is shortened and printable in every field.

    place: the file, or the option (`--n`) that the value came from.
    line: from 1; None if there is none to name.
    key: dotted, `forest.trees[2].height_m`; empty if the problem is with the file as a whole.
    value: as found; empty if there is none (a missing key).
    message: what is allowed.
    """

    place: str
    line: int | None
    key: str
    value: str
    message: str

    def __str__(self) -> str:
        place = self.place if self.line is None else f"{self.place}:{self.line}"
        subject = f"{self.key} = {self.value}" if self.value else self.key
        return ": ".join(part for part in (place, subject, self.message) if part)


class MissionError(Exception):
    """A mission was refused. `problems` holds every reason, in the order of the file."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__(self.problems)  # what it is made of: so it comes out of another process as it went in

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


def first_of(found: Sequence[Problem], place: str) -> list[Problem]:
    """The first MAX_PROBLEMS, and how many more there are in `place`."""
    more = len(found) - MAX_PROBLEMS
    rest = [Problem(place, None, "", "", f"and {more} more problems")] if more > 0 else []
    return [*found[:MAX_PROBLEMS], *rest]


def printable(text: str, max_chars: int = MAX_SHOWN_CHARS) -> str:
    """`text` on one line, without control or other unprintable characters, at most `max_chars` long."""
    head = text[: max_chars + 1]  # an escaped character only makes it longer
    clean = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in head)
    return clean if len(clean) <= max_chars else clean[: max_chars - 3] + "..."


def dotted(path: Path) -> str:
    """("forest", "trees", 2, "height_m") -> "forest.trees[2].height_m"."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return printable(text, MAX_KEY_CHARS)


def shown(value: object) -> str:
    """A value the way TOML writes it, shortened to MAX_SHOWN_CHARS."""
    return printable(_toml_like(value, depth=3))


def _toml_like(value: object, depth: int) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case int() if value.bit_length() > 128:  # str() refuses more than 4300 digits
            return f"an integer of {value.bit_length()} bits"
        case Enum():
            return _toml_like(value.value, depth)
        case str():
            return f'"{printable(value, MAX_SHOWN_CHARS - 2)}"'
        case list() | tuple():
            if depth == 0:
                return "[...]"
            items = [_toml_like(item, depth - 1) for item in value[:MAX_SHOWN_ITEMS]]
            if len(value) > MAX_SHOWN_ITEMS:
                items.append(f"... {len(value)} in all")
            return f"[{', '.join(items)}]"
        case Mapping():
            return "a table"
        case _:
            return str(value)


def lookup(values: object, path: Path) -> object:
    """The value at `path` in nested tables and arrays; KeyError if there is none."""
    for part in path:
        match values, part:
            case Mapping(), str() if part in values:
                values = values[part]
            case ((list() | tuple()), int()) if 0 <= part < len(values):
                values = values[part]
            case _:
                raise KeyError(path)
    return values
