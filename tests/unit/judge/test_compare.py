"""Figures of two flights side by side: noise of sums is no difference."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import pytest

from sim_bridge.judge.metrics import FIGURES
from sim_bridge.lab.compare import compare_figures
from sim_bridge.lab.judged import Judged


@pytest.mark.parametrize(("more_s", "better"), [(7.1e-15, ""), (0.05, "A")])
def test_what_differs_by_rounding_alone_is_equal(more_s: float, better: str) -> None:
    values: dict[str, Any] = dict.fromkeys(figure.name for figure in FIGURES)
    a, b = (SimpleNamespace(figures={**values, "arrival_leader_s": 42.75 + more}) for more in (0.0, more_s))
    (row,) = compare_figures(cast(Judged, a), cast(Judged, b))
    assert row.better == better
    assert row.difference == (pytest.approx(more_s) if better else 0.0)
