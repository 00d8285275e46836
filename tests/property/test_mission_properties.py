"""Missions under arbitrary input: what loads survives a round trip, the rest is refused in one way only."""

from __future__ import annotations

import contextlib
import functools
import math
import random
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mission.model
from mission.check import validated
from mission.load import MissionError, dump_mission, load_mission, parse_mission
from mission.locate import MAX_DEPTH, locate
from mission.model import AtEnd, Mission, Origin, Placement
from mission.plane import clearance_m, polygon_fault
from mission.problems import Path as KeyPath
from mission.problems import printable, shown

EXAMPLES = [path.read_text() for path in sorted((Path(mission.model.__file__).parent / "examples").glob("*.toml"))]
seeds = st.integers(0, 2**64)  # of what would be hundreds of draws

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


@settings(deadline=None)
@given(seeds)
def test_every_key_and_item_is_found_on_the_line_that_it_was_written_on(seed: int) -> None:
    doc = document(seed)
    found = locate(doc.text)

    assert found == doc.lines
    try:
        values = tomllib.loads(doc.text)
    except tomllib.TOMLDecodeError:
        pytest.fail(f"the test wrote what is not TOML: {doc.text!r}")
    assert set(paths(values)) == set(found)


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


@settings(deadline=None, max_examples=300)
@given(seeds)
def test_a_damaged_example_loads_or_is_refused(seed: int) -> None:
    loads_or_is_refused(lambda: parse_mission(damaged_example(seed)))


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


TOML_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.integers(min_value=10**5000, max_value=10**5001)
    | st.floats()
    | st.text()
    | st.dates(),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=9), inner, max_size=4),
    max_leaves=8,
)


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


@given(st.text(), st.integers(4, 99))
def test_shown_text_is_short_and_printable(text: str, most: int) -> None:
    assert len(printable(text, most)) <= most
    assert printable(text, most).isprintable()


@given(TOML_VALUES)
def test_any_shown_value_is_short_and_printable(value: object) -> None:
    assert len(shown(value)) <= 60
    assert shown(value).isprintable()


# Round trip -------------------------------------------------------------------

names = st.text(st.characters(exclude_categories=["C", "Z"]) | st.just(" "), max_size=80)
small = st.floats(-30.0, 30.0)


@st.composite
def missions(draw: Callable[[st.SearchStrategy[object]], object]) -> Mission:
    """Valid missions: a route of hundreds of metres, everything else free within what that allows."""
    size = draw(st.integers(1, 12))
    assert isinstance(size, int)
    leaders = draw(st.lists(st.integers(1, size), unique=True))
    d2_enu_m = (draw(st.floats(100.0, 5_000.0)), draw(st.floats(-900.0, 900.0)), draw(st.floats(8.0, 30.0)))
    values = {
        "schema": 1,
        "name": draw(names),
        "origin": draw(
            st.none()
            | st.builds(
                Origin, lat_deg=st.floats(-85, 85), lon_deg=st.floats(-180, 180), alt_m=st.floats(-500, 9_000)
            ).map(Origin.model_dump)
        ),
        "route": {
            "d1_enu_m": (draw(small), draw(small), draw(st.floats(8.0, 30.0))),
            "d2_enu_m": d2_enu_m,
            "vel_leader_mps": draw(st.floats(0.05, 4.0)),
            "at_end": draw(st.sampled_from(AtEnd)),
        },
        "swarm": {"size": size, "leader_priority": leaders},
        "fence": {
            "altitude_max_m": draw(st.floats(31.0, 9_000.0)),
            "polygon_enu_m": draw(
                st.none() | st.just(((-2e3, -2e3), (9e3, -2e3), (9e3, 2e3), (-2e3, 2e3)))
            ),
        },
        "forest": {
            "trees": draw(
                st.lists(
                    st.fixed_dictionaries(
                        {
                            "base_enu_m": st.tuples(st.floats(-9e3, -99.0), small),
                            "trunk_radius_m": st.floats(0.01, 9.0),
                            "height_m": st.floats(0.1, 99.0),
                        }
                    ),
                    max_size=3,
                )
            )
        },
        "sim": {
            "seed": draw(st.integers(0, 2**32 - 1)),
            "wind_mps": (draw(small), draw(small), draw(small)),
            "radio_loss": draw(st.floats(0.0, 1.0, exclude_max=True)),
            "placement": draw(st.sampled_from(Placement)),
            "time_limit_s": draw(st.none() | st.floats(3e5, 6e5)),  # the longest way takes 1e5 s, and as long back
        },
    }  # fmt: skip
    return Mission.model_validate(values)


@settings(deadline=None)
@given(missions())
def test_a_dumped_mission_loads_back_equal(flown: Mission) -> None:
    assert parse_mission(dump_mission(flown)) == flown


@settings(deadline=None)
@given(missions(), st.integers(1, 12))
def test_a_copy_changes_its_size_and_nothing_else(flown: Mission, size: int) -> None:
    if all(leader <= size for leader in flown.swarm.leader_priority):
        assert flown.with_size(size).with_size(flown.swarm.size) == flown


# Geometry ---------------------------------------------------------------------


@st.composite
def stars(draw: Callable[[st.SearchStrategy[object]], object]) -> list[tuple[float, float]]:
    """Polygons around (0, 0) that are simple by construction."""
    radii = draw(st.lists(st.floats(5.0, 100.0), min_size=3, max_size=64))
    assert isinstance(radii, list)
    step = math.tau / len(radii)
    return [(r * math.cos(i * step), r * math.sin(i * step)) for i, r in enumerate(radii)]


@settings(deadline=None)
@given(stars(), st.booleans())
def test_a_star_is_simple_and_holds_its_centre(star: list[tuple[float, float]], turned: bool) -> None:
    polygon = star[::-1] if turned else star

    assert polygon_fault(polygon) == ""
    assert clearance_m((0.0, 0.0), polygon) > 0.0
    assert clearance_m((150.0, 0.0), polygon) < 0.0


@given(st.integers(4, 30), st.data())
def test_swapped_vertices_make_edges_cross(n: int, data: st.DataObject) -> None:
    ring = [(math.cos(i * math.tau / n), math.sin(i * math.tau / n)) for i in range(n)]
    i = data.draw(st.integers(0, n - 2))
    ring[i], ring[i + 1] = ring[i + 1], ring[i]

    assert "cross or touch" in polygon_fault(ring)
