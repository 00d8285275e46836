"""Stem maps under arbitrary input: what is read survives a round trip, all else is refused in one way only."""

from __future__ import annotations

import json
import math
import random
import tempfile
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mission.common.frames import Wgs84
from mission.common.problems import MissionError, Problem
from mission.schema.trees import StandTree
from mission.stems import utm
from mission.stems.columns import column_of
from mission.stems.numbers import COMMA, POINT, is_ambiguous, number, signs_of
from mission.stems.stem_map import read_stems
from mission.stems.write import to_csv, to_geojson

ORIGIN = Wgs84(47.0, 8.0, 400.0)
SETTINGS = settings(deadline=None, max_examples=150)
MAP = """\
# a comment
x_m;y_m;dbh_cm;height_m;crown_base_m;crown_radius_m;species;tag
1,5;2,25;30,5;20,1;12;3,2;Picea abies;a
-7;11;12;;;;"oak; old";b
"""
FEATURES = json.dumps(
    {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
        "features": [
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": [8.0 + k / 1e4, 47.0]},
                "properties": {"DBH (cm)": 30 + k, "species": "oak", "height_m": "21.5"},
            }
            for k in range(2)
        ],
    },
    indent=1,
)


def read(data: bytes, suffix: str, **options: Any) -> None:
    """MissionError, whose problems are short and printable, is the only exception."""
    found: tuple[StandTree, ...] = ()
    problems: tuple[Problem, ...] = ()
    with tempfile.NamedTemporaryFile(suffix=suffix, buffering=0) as file:
        file.write(data)
        try:
            stems = read_stems(file.name, **options)
            found = (*stems.trees, *stems.bushes)
        except MissionError as error:
            problems = error.problems
    assert found or problems or options.get("lenient")
    assert all(str(problem).isprintable() and len(str(problem)) < 800 for problem in problems)
    for tree in found:
        assert math.isfinite(tree.east_m)
        assert math.isfinite(tree.north_m)
        assert 0.0 < tree.radius_m <= 2.5
        assert 0.0 <= tree.crown_base_m <= tree.height_m <= 130.0
        assert tree.radius_m <= tree.crown_radius_m <= 30.0


def mutated(text: str, rng: random.Random) -> bytes:
    """`text` with a few bytes changed, taken out, doubled, or put in."""
    data = bytearray(text.encode())
    for _ in range(rng.randint(1, 6)):
        at = rng.randrange(len(data))
        match rng.randint(0, 4):
            case 0:
                data[at] = rng.randrange(256)
            case 1:
                del data[at : at + rng.randint(1, 20)]
            case 2:
                data[at:at] = data[at : at + rng.randint(1, 60)]
            case 3:
                data[at:at] = rng.choice(
                    [b"1e99", b"-", b"nan", b"\x00", b'"', b"\n", b";", b"[", b"{", b"9" * 40, b"\xff"]
                )
            case _:
                data[at:at] = rng.choice([b"null", b"true", b"[[1]]", b'"lat"', b",,", b"inf", "é".encode()])
        data = data or bytearray(b"x")
    return bytes(data)


@SETTINGS
@given(st.binary(max_size=400), st.sampled_from([".csv", ".geojson"]), st.booleans())
def test_any_bytes_are_read_or_refused(data: bytes, suffix: str, lenient: bool) -> None:
    read(data, suffix, lenient=lenient)


@pytest.mark.parametrize("lenient", [False, True])
def test_a_damaged_csv_is_read_or_refused(lenient: bool) -> None:
    for seed in range(300):  # all that is drawn comes from the seed: nothing for hypothesis to shrink
        read(mutated(MAP, random.Random(seed)), ".csv", lenient=lenient)


@pytest.mark.parametrize("lenient", [False, True])
def test_a_damaged_geojson_is_read_or_refused(lenient: bool) -> None:
    for seed in range(300):
        read(mutated(FEATURES, random.Random(seed)), ".geojson", lenient=lenient, origin=ORIGIN)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)
GEO = st.fixed_dictionaries(
    {"type": st.just("Feature") | JSON},
    optional={
        "geometry": JSON
        | st.fixed_dictionaries({"type": st.just("Point"), "coordinates": JSON | st.lists(st.floats())}),
        "properties": JSON | st.dictionaries(st.sampled_from(["dbh_cm", "height", "species", "lat", "p"]), JSON),
    },
)


@SETTINGS
@given(st.lists(GEO | JSON, max_size=4), st.dictionaries(st.sampled_from(["crs", "bbox", "name"]), JSON))
def test_any_features_are_read_or_refused(features: list[Any], members: dict[str, Any]) -> None:
    document = {"type": "FeatureCollection", **members, "features": features}
    read(json.dumps(document).encode(), ".geojson", origin=ORIGIN)


cm = st.integers(-200_000, 200_000).map(lambda k: k / 100.0)


@st.composite
def tree(draw: Any) -> StandTree:
    """As a map of ours holds it: places to 1 cm, diameters to 0.1 mm."""
    dbh_m = draw(st.integers(50, 30_000)) / 1e4
    height_m = draw(st.integers(10, 12_000)) / 100.0
    base_m = min(height_m, draw(st.integers(0, 12_000)) / 100.0)
    reach_m = max(dbh_m / 2.0, draw(st.integers(0, 30_000)) / 1000.0)
    species = draw(st.sampled_from(["", "oak", "Picea abies", 'a "b", c', "#1", "é;ü"]))
    return StandTree(draw(cm), draw(cm), dbh_m / 2.0, height_m, base_m, reach_m, species)


@SETTINGS
@given(st.lists(tree(), min_size=1, max_size=5, unique_by=lambda t: (t.east_m, t.north_m)))
def test_what_is_written_is_read_back(trees: list[StandTree]) -> None:
    for suffix, text, exact_m in ((".csv", to_csv(trees), 1e-9), (".geojson", to_geojson(trees, ORIGIN), 0.0051)):
        with tempfile.NamedTemporaryFile(suffix=suffix, buffering=0) as file:
            file.write(text.encode())
            found = read_stems(file.name, origin=ORIGIN)
        for was, now in zip(trees, found.trees, strict=True):
            assert now.species == was.species
            for key in ("east_m", "north_m"):
                assert abs(getattr(now, key) - getattr(was, key)) < exact_m
            for key in ("radius_m", "height_m", "crown_base_m", "crown_radius_m"):
                assert math.isclose(getattr(now, key), getattr(was, key), abs_tol=5.1e-4)


@given(st.floats(0.1, 83.0), st.integers(1, 60), st.floats(-400e3, 400e3))
def test_a_zone_is_mirrored_at_the_equator_and_its_meridian(lat: float, number_: int, off_m: float) -> None:
    """North and south, west and east of the central meridian are alike, and northings grow with latitude."""
    north_m = lat * 110_000.0
    lat_deg, lon_deg = utm.to_wgs84(500_000.0 + off_m, north_m, utm.Zone(number_, south=False))
    south_lat, south_lon = utm.to_wgs84(500_000.0 + off_m, 10e6 - north_m, utm.Zone(number_, south=True))
    west_lat, west_lon = utm.to_wgs84(500_000.0 - off_m, north_m, utm.Zone(number_, south=False))
    middle = 6.0 * number_ - 183.0
    assert math.isclose(lat_deg, -south_lat, abs_tol=1e-9)
    assert math.isclose(lon_deg, south_lon, abs_tol=1e-9)
    assert math.isclose(lat_deg, west_lat, abs_tol=1e-9)
    assert math.isclose(
        math.remainder(lon_deg - middle, 360.0), -math.remainder(west_lon - middle, 360.0), abs_tol=1e-9
    )


@given(st.text(max_size=30))
def test_any_text_is_a_column_or_none_and_a_finite_number_or_none(text: str) -> None:
    column_of(text)
    for signs in (POINT, COMMA, signs_of([text], "")):
        found = number(text, signs)
        assert found is None or math.isfinite(found)
        assert found is None or not is_ambiguous(text, signs)
    zone = utm.zone_of(text)
    assert zone is None or 1 <= zone.number <= 60


SEPARATORS = st.sampled_from(["", " ", "\u00a0", "\u202f", "'", "’"])


def grouped(digits: str, separator: str) -> str:
    """1234567 as 1.234.567."""
    head = len(digits) % 3 or 3
    return separator.join([digits[:head], *(digits[k : k + 3] for k in range(head, len(digits), 3))])


whole = st.integers(0, 10**9).map(str)
part = st.text("0123456789", min_size=1, max_size=8)
sign = st.sampled_from(["", "-", "+"])


@given(sign, whole, part, SEPARATORS, st.sampled_from(".,"))
def test_a_number_is_the_same_by_a_point_a_comma_and_with_thousands_apart(
    minus: str, digits: str, decimals: str, separator: str, decimal: str
) -> None:
    """`signs_of` finds the sign of a number that says it, which is read as Python reads it."""
    expected = float(f"{minus}{digits}.{decimals}")
    text = f"{minus}{grouped(digits, separator)}{decimal}{decimals}"
    for signs in (signs_of([text, f"0{decimal}5"], ""), COMMA if decimal == "," else POINT):
        assert number(text, signs) == expected
    other = "," if decimal == "." else "."
    if len(digits) > 3:
        apart = f"{minus}{grouped(digits, other)}{decimal}{decimals}"
        assert number(apart, signs_of([apart], "")) == expected


@given(sign, st.integers(1, 999), st.integers(0, 999), st.sampled_from(".,"))
def test_one_sign_before_three_digits_is_read_only_as_the_file_shows_it(
    minus: str, head: int, tail: int, separator: str
) -> None:
    text = f"{minus}{head}{separator}{tail:03}"
    other = "," if separator == "." else "."
    small, large = float(f"{minus}{head}.{tail:03}"), float(f"{minus}{head}{tail:03}")
    alone = signs_of([text, "12", "7"], "")
    assert is_ambiguous(text, alone)
    assert number(text, alone) is None
    assert number(text, signs_of([text, f"0{separator}25"], "")) == small
    assert number(text, signs_of([text, f"1{separator}234{separator}567"], "")) == large
    assert number(text, signs_of([text, f"1{separator}234{other}5"], "")) == large
    both = signs_of([text, f"0{separator}25", f"1{separator}234{other}5"], "")
    assert is_ambiguous(text, both)
    mixed = signs_of([text, f"0{other}25"], "")
    assert is_ambiguous(text, mixed), "the other sign is decimal: this one may be of thousands, or another writer's"


@given(sign, whole, part, st.sampled_from(".,"))
def test_what_the_user_says_of_the_decimal_sign_holds(minus: str, digits: str, decimals: str, decimal: str) -> None:
    said, opposite = (COMMA, POINT) if decimal == "," else (POINT, COMMA)
    text = f"{minus}{digits}{decimal}{decimals}"
    assert number(text, said) == float(f"{minus}{digits}.{decimals}")
    found = number(text, opposite)
    assert found in (None, float(f"{minus}{digits}{decimals}"))
    assert found is None or len(decimals) == 3
