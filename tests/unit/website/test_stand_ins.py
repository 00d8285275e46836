"""The page's stand-ins give what the libraries give."""

from __future__ import annotations

import importlib.util
import math
import random
import sys
from pathlib import Path
from types import ModuleType

import fastcrc
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from docs.website.native.musl import COMPENSATED, compensated

STAND_INS = Path(__file__).parents[3] / "docs" / "website" / "stand_ins"
SEEDS = [[1, 0x5AD10], [0, 5], [2**40 + 3, 7, 9], [1, 2, 3, 4, 5, 6], 12]


def loaded(name: str) -> ModuleType:
    """A stand-in, beside the library."""
    spec = importlib.util.spec_from_file_location("stand_in", STAND_INS / name)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def drawing() -> ModuleType:
    return loaded("numpy/random.py")


@pytest.mark.parametrize("seed", SEEDS, ids=str)
def test_even_draws_are_numpys(drawing: ModuleType, seed: object) -> None:
    ours, theirs = drawing.default_rng(seed), np.random.default_rng(seed)  # type: ignore[arg-type]
    assert ours.random(2000).tolist() == theirs.random(2000).tolist()
    assert [ours.random(), ours.uniform(-3.0, 5.0)] == [theirs.random(), theirs.uniform(-3.0, 5.0)]


@pytest.mark.parametrize("seed", SEEDS, ids=str)
def test_normal_draws_are_numpys_in_every_layer_and_the_tail(drawing: ModuleType, seed: object) -> None:
    ours, theirs = drawing.default_rng(seed), np.random.default_rng(seed)  # type: ignore[arg-type]
    drawn = ours.standard_normal(100_000).tolist()
    assert max(map(abs, drawn)) > 3.66  # the tail is where the ziggurat has no layer
    assert drawn == theirs.standard_normal(100_000).tolist()
    assert ours.standard_normal() == theirs.standard_normal()


def test_what_is_called_of_numpy_besides_says_that_it_is_not_there() -> None:
    stand_in = loaded("numpy/__init__.py")
    assert stand_in.float64 | stand_in.intp
    with pytest.raises(NotImplementedError, match=r"numpy\.linalg\.eigh: the page has no arrays"):
        stand_in.linalg.eigh([[1.0]])


@given(data=st.binary(max_size=300), initial=st.integers(0, 0xFFFF))
def test_checksums_are_those_of_fastcrc(data: bytes, initial: int) -> None:
    assert loaded("fastcrc/crc16.py").mcrf4xx(data, initial) == fastcrc.crc16.mcrf4xx(data, initial)


def test_a_sum_makes_up_for_what_it_rounds_as_later_pythons_do() -> None:
    draw = random.Random(4)
    for _ in range(2000):
        values = [draw.uniform(-1.0, 1.0) * 10.0 ** draw.randrange(-8, 8) for _ in range(draw.randrange(1, 9))]
        exact = math.fsum(values)
        assert abs(compensated(values) - exact) <= math.ulp(exact)
        if sys.version_info >= COMPENSATED:
            assert compensated(values) == sum(values)
    assert compensated([1e16, 1.0, -1e16]) == 1.0
    assert compensated([3, 4]) == 7
    assert compensated([3, 0.5]) == 3.5
    assert compensated([[1], [2]], []) == [1, 2]
    assert compensated([]) == 0
    assert math.isinf(compensated([math.inf, 1.0]))
