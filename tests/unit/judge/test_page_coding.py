"""The series of a replay: short, and what they were made from to half a step."""

from __future__ import annotations

import numpy as np
import pytest

from sim_bridge.judge.page.coding import column, pack, read_column, read_steps, steps, toggles, unpack

NONE = np.nan


@pytest.mark.parametrize("order", [0, 1, 2])
def test_a_column_comes_back_to_half_a_step(order: int) -> None:
    values = np.cumsum(np.random.default_rng(1).normal(0.0, 0.3, 500)) - 40.0
    back = read_column(column(values, 0.01, order))
    assert np.abs(back - values).max() <= 0.005 + 1e-9


@pytest.mark.parametrize(
    "values",
    [
        [np.nan, np.nan, 1.0, 2.0],
        [1.0, np.nan, 3.0, np.nan, np.nan],
        [np.nan, np.nan],
        [],
        [7.0],
        [1.0, 2.0, np.nan, 4.0],
    ],
    ids=str,
)
def test_where_there_is_no_value_there_is_none_afterwards(values: list[float]) -> None:
    coded = column(np.array(values), 0.5)
    np.testing.assert_array_equal(read_column(coded), values)
    assert ("gaps" in coded) == bool(np.isnan(values).any())


def test_a_vehicle_that_hovers_costs_zeros() -> None:
    assert column(np.full(100, 12.34), 0.01, 2)["is"][2:] == [0] * 98


def test_steps_come_back_and_name_changes_alone() -> None:
    values = np.array([-1, -1, 2, 2, 2, 3, 2], dtype=np.int8)
    coded = steps(values)
    assert coded == {"step": 1.0, "rows": [0, 2, 3, 1], "is": [-1, 2, 3, 2]}
    np.testing.assert_array_equal(read_steps(coded, 7), values)
    assert steps(np.zeros(3, np.bool_))["is"] == [0]
    assert read_steps(steps(np.zeros(0)), 0).size == 0


@pytest.mark.parametrize(
    ("flags", "changes"), [([], []), ([0, 0], []), ([1, 1, 0], [0, 2]), ([0, 1, 0, 1], [1, 1, 1])], ids=str
)
def test_toggles_are_the_rows_of_change(flags: list[int], changes: list[int]) -> None:
    assert toggles(np.array(flags, dtype=np.bool_)) == changes


def test_what_is_packed_comes_back_and_holds_nothing_that_html_reads() -> None:
    document = {"title": "</script><b>&'\"é", "is": [1, -2]}
    packed = pack(document)
    assert not set("<>&\"'") & set(packed)
    assert unpack(packed) == document
    with pytest.raises(ValueError, match="JSON compliant"):
        pack({"is": [float("nan")]})
