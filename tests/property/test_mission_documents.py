"""Mission files under arbitrary input: each key is found on its line, the rest is refused in one way only."""

from __future__ import annotations

import contextlib
import functools
import random
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mission
from mission.common.problems import Path as KeyPath
from mission.document.load import MissionError, dump_mission, load_mission, parse_mission
from mission.document.locate import MAX_DEPTH, locate
from mission.document.model import Mission
from mission.schema.check import validated
from tests.unit.mission.mission_kit import TOML_VALUES

EXAMPLES = [path.read_text() for path in sorted((Path(mission.__file__).parent / "examples").glob("*.toml"))]

# TOML with known lines --------------------------------------------------------

# No two of these write the same key; what looks like structure inside quotes is none
KEYS = [
    ("plain", "plain"),
    ("1234", "1234"),
    ("-_-", "-_-"),
    ('"a.b"', "a.b"),
    ('"[x]"', "[x]"),
    ('"#= \\""', '#= "'),
    (r'"\u00e9\t\U0001F332"', "é\t\U0001f332"),
    ("'c\\d'", "c\\d"),
    ('""', ""),
]
ATOMS = [
    "1",
    "-0.5e3",
    "true",
    "inf",
    "1979-05-27 07:32:00Z",
    "07:32:00",
    '"plain"',
    '"] } # \\" = ["',
    "'\\'",
    '""',
    "''",
    '""""""',
    '"""one " two "" three \\""" ] """',
    '"""ends in its own""""',
    '"""ends in two of its own"""""',
    '"""\nfirst ]\n# no comment\n[not.a.table]\nx = 1 \\\n  """',
    "'''\n'' [ \\\n'''",
    "'''its own''''",
]


class Document:
    """TOML as it is written, with the line of everything in it."""

    def __init__(self, rng: random.Random) -> None:
        self.text = ""
        self.lines: dict[KeyPath, int] = {}
        self._rng = rng
        self._newline = rng.choice(["\n", "\r\n"])

    def pick(self, options: list[str]) -> str:
        return options[self.count(len(options) - 1)]

    def count(self, most: int) -> int:
        return self._rng.randint(0, most)

    def write(self, text: str) -> None:
        self.text += text.replace("\n", self._newline)

    def here(self, path: KeyPath) -> None:
        self.lines.setdefault(path, self.text.count("\n") + 1)

    def end_line(self) -> None:
        self.write(self.pick(["\n", "  \n", ' # [c] = "\n', "\n\n", "\n# '''\n\n"]))

    def blank(self, *, newlines: bool) -> None:
        self.write(self.pick(["", " ", "\t"] + (["\n", " # ]},\n  "] if newlines else [])))

    def key(self, path: KeyPath, most_parts: int) -> KeyPath:
        """A dotted key, unique in its table by its first part."""
        siblings = {p[len(path)] for p in self.lines if p[: len(path)] == path and len(p) > len(path)}
        choices = [key for key in KEYS if key[1] not in siblings]
        for number in range(1 + self.count(most_parts - 1)):
            self.write("." if number else "")
            written, name = choices[self.count(len(choices) - 1)]
            path = (*path, name)
            self.here(path)
            self.write(written)
            self.blank(newlines=False)
            choices = KEYS
        return path

    def pair(self, path: KeyPath, depth: int) -> None:
        path = self.key(path, 2)
        self.write("=")
        self.blank(newlines=False)
        self.value(path, depth)

    def value(self, path: KeyPath, depth: int) -> None:
        kind = self.pick(["atom", "array", "table"]) if depth else "atom"
        if kind == "atom":
            self.write(self.pick(ATOMS))
        elif kind == "array":
            self.array(path, depth - 1)
        else:
            self.inline_table(path, depth - 1)

    def array(self, path: KeyPath, depth: int) -> None:
        self.write("[")
        self.blank(newlines=True)
        size = self.count(3)
        for index in range(size):
            self.here((*path, index))
            self.value((*path, index), depth)
            self.blank(newlines=True)
            self.write("," if index < size - 1 else self.pick(["", ","]))
            self.blank(newlines=True)
        self.write("]")

    def inline_table(self, path: KeyPath, depth: int) -> None:
        self.write("{")
        self.blank(newlines=False)
        size = self.count(2)
        for index in range(size):
            self.pair(path, depth)
            self.blank(newlines=False)
            self.write("," if index < size - 1 else "")
            self.blank(newlines=False)
        self.write("}")

    def pairs(self, path: KeyPath) -> None:
        for _ in range(self.count(3)):
            self.blank(newlines=False)
            self.pair(path, (MAX_DEPTH - 2 - len(path)) // 2)  # a level is up to two keys deep, as is the first
            self.end_line()

    def header(self, path: KeyPath, name: str, brackets: tuple[str, str]) -> None:
        self.lines[path] = self.text.count("\n") + 1
        self.write(brackets[0])
        self.blank(newlines=False)
        self.write(name)
        self.blank(newlines=False)
        self.write(brackets[1])
        self.end_line()


def document(seed: int) -> Document:
    doc = Document(random.Random(seed))
    doc.pairs(())
    for number in range(doc.count(2)):
        name = f"table{number}"
        doc.header((name,), f" {name} ", ("[", "]"))
        doc.pairs((name,))
    if doc.count(1):  # a table after one of its own: its header counts, not the mention
        doc.header(("late", "sub"), "late.sub", ("[", "]"))
        doc.pairs(("late", "sub"))
        doc.header(("late",), "late", ("[", "]"))
        doc.pairs(("late",))
    for index in range(doc.count(2)):
        doc.here(("trees",))
        doc.header(("trees", index), "'trees'", ("[[", "]]"))
        doc.pairs(("trees", index))
        if doc.count(1):
            doc.header(("trees", index, "sub"), "trees. sub", ("[", "]"))
            doc.pairs(("trees", index, "sub"))
        for item in range(doc.count(2)):
            doc.here(("trees", index, "leaves"))
            doc.header(("trees", index, "leaves", item), "trees.leaves", ("[[", "]]"))
            doc.pairs(("trees", index, "leaves", item))
    return doc


def paths(value: object, path: KeyPath = ()) -> Iterator[KeyPath]:
    children: list[tuple[str | int, object]] = []
    if isinstance(value, dict):
        children = list(value.items())
    elif isinstance(value, list):
        children = list(enumerate(value))
    for part, child in children:
        yield (*path, part)
        yield from paths(child, (*path, part))


def test_every_key_and_item_is_found_on_the_line_that_it_was_written_on() -> None:
    for seed in range(200):
        doc = document(seed)
        found = locate(doc.text)
        assert found == doc.lines, seed
        try:
            values = tomllib.loads(doc.text)
        except tomllib.TOMLDecodeError:
            pytest.fail(f"the test wrote what is not TOML: {doc.text!r}")
        assert set(paths(values)) == set(found), seed


@pytest.mark.parametrize("text", EXAMPLES)
def test_every_key_of_the_examples_is_found(text: str) -> None:
    assert set(paths(tomllib.loads(text))) == set(locate(text))


# Fuzz -------------------------------------------------------------------------

FRAGMENTS = [
    *(
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        ",",
        "=",
        ".",
        "#",
        '"',
        "'",
        '"""',
        "'''",
        "\\",
        "\n",
        "\r",
        "\0",
        "\ufeff",
    ),
    *(
        "nan",
        "inf",
        "-",
        "-1",
        "1000000",
        "1e999",
        "9" * 5000,
        "0x" + "f" * 5000,
        "true",
        "\U0001f332",
        "\x7f",
    ),
    *("1979-05-27", "00:60:61", "1979-05-27T07:32:00+99:99", '"\\ud800"', "a.b.c.", "x = "),
    *("[" * 2000, "{a=" * 2000, "a." * 2000, " " * 3000),
    *("schema = 1\n", "size = 0\n", "[route]\n", "[origin]\n", "[[forest.trees]]\n", "[sim]\nseed = 3\n"),
]


def damaged_example(seed: int) -> str:
    number = functools.partial(random.Random(seed).randint, 0)
    text = EXAMPLES[number(len(EXAMPLES) - 1)]
    for _ in range(1 + number(4)):
        start = number(len(text))
        end = min(len(text), start + number(12))
        text = text[:start] + ("" if number(2) == 0 else FRAGMENTS[number(len(FRAGMENTS) - 1)]) + text[end:]
    return text


def loads_or_is_refused(load: Callable[[], Mission]) -> None:
    try:
        loaded = load()
    except MissionError as error:
        refused = error
    else:
        assert parse_mission(dump_mission(loaded)) == loaded
        return
    lines = str(refused).splitlines()
    assert lines
    assert len(lines) == len(refused.problems)
    assert all(line.isprintable() and len(line) < 1_000 for line in lines)


def test_a_damaged_example_loads_or_is_refused() -> None:
    for seed in range(300):
        loads_or_is_refused(functools.partial(parse_mission, damaged_example(seed)))


@settings(deadline=None)
@given(
    st.one_of(st.binary(max_size=300), st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass")))
)
def test_arbitrary_bytes_load_or_are_refused(data: bytes) -> None:
    with tempfile.NamedTemporaryFile(suffix=".toml") as file:
        file.write(data)
        file.flush()
        loads_or_is_refused(lambda: load_mission(file.name))


@settings(deadline=None)
@given(st.text(max_size=60))
def test_arbitrary_paths_load_or_are_refused(path: str) -> None:
    with contextlib.suppress(MissionError):
        load_mission("/dev/null/" + path)


@settings(deadline=None)
@given(
    st.sampled_from(sorted(Mission.model_fields)),
    st.sampled_from(["", "size", "d1_enu_m", "trees"]),
    TOML_VALUES,
)
def test_any_value_in_any_place_is_accepted_or_refused(table: str, key: str, value: object) -> None:
    values: dict[str, object] = tomllib.loads(EXAMPLES[0])
    values["schema" if table == "schema_version" else table] = {key: value} if key else value
    with contextlib.suppress(MissionError):
        validated(Mission, values, "fuzz")
