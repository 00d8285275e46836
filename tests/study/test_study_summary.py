"""What the rows of a study say together."""

from __future__ import annotations

import io
import math
import re

import pytest
from rich.console import Console

from sim_bridge.lab.study.results import must, page, summary
from sim_bridge.lab.study.results.figures import FLIGHT


def test_interval_is_students() -> None:
    found = summary.spread([1.0, 2.0, 3.0, 4.0])
    assert found is not None
    assert (found.mean, found.worst) == (2.5, 4.0)
    assert found.sd == pytest.approx(1.2909944)
    # t(0.975, 3) = 3.182446 of any table
    assert found.high == pytest.approx(2.5 + 3.182446 * 1.2909944 / math.sqrt(4), rel=1e-6)
    assert found.low == pytest.approx(5.0 - (found.high or 0.0))
    alone = summary.spread([2.0], min)
    assert alone is not None
    assert (alone.sd, alone.low, alone.worst) == (None, None, 2.0)
    assert summary.spread([]) is None


def test_worst_is_the_least_where_less_is_worse() -> None:
    row = {"run": "a", "law": "ours", "backend": "point-mass", "n": 2, "settings": {}, "status": "flown"}
    rows = [{**row, "arrived": True, "min_separation_m": m, "overhead_last": m / 100} for m in (5.0, 7.0)]
    figures = summary.summarise(rows)[0].figures
    assert (figures["min_separation_m"].worst, figures["overhead_last"].worst) == (5.0, 0.07)


@pytest.mark.parametrize(
    ("terminal", "width", "most"), [(True, 80, 80), (True, 120, 120), (False, 80, 100), (False, 160, 160)]
)
def test_the_table_fits_the_terminal_and_in_a_file_100_columns(terminal: bool, width: int, most: int) -> None:
    row = {"run": "the whole stack", "law": "ours", "backend": "point-mass", "status": "flown", "arrived": True}
    shown = [figure for figure in FLIGHT if figure.in_table]
    figures = {figure.name: 123.456 for figure in shown}
    rows = [row | figures | {"n": n, "settings": {"swarm.size": n}, "contacts": k} for n in (4, 8) for k in (0, 7)]
    told = io.StringIO()
    console = Console(file=told, width=width, force_terminal=terminal, no_color=True)
    summary.print_table(summary.summarise(rows), console)
    text = re.sub(r"\x1b\[[0-9;]*m", "", told.getvalue())
    lines = [line.rstrip() for line in text.splitlines() if line.strip().startswith("the whole stack")]
    assert max(map(len, text.splitlines())) <= most
    assert len(lines) >= 2 * 2  # rows of two cases in each table
    assert sum(line.count(" ± ") for line in lines) == 2 * len(shown)
    assert all(re.search(r"  size=[48]  +2/2  ", line) for line in lines)
    words = text.replace("─", " ").split()
    for figure in shown:
        assert all(word in words for word in figure.heading.split())


def test_long_names_of_runs_and_cases_leave_room_for_figures() -> None:
    settings = {"swarm.size": 4, "route.vel_leader_mps": 2.0, "radio.transit_range_m": 30.0}
    row = {"run": "olfati-saber, tuned for time alone", "law": "ours", "backend": "point-mass", "status": "flown"}
    figures = {figure.name: 1.5 for figure in FLIGHT if figure.in_table}
    rows = [row | figures | {"arrived": True, "n": 4, "settings": {**settings, "sim.seed": k}} for k in (1, 2)]
    rows += [{**one, "settings": {key: 9 for key in one["settings"]}} for one in rows]
    told = io.StringIO()
    summary.print_table(summary.summarise(rows), Console(file=told, width=80))
    lines = told.getvalue().splitlines()
    assert max(map(len, lines)) <= 100
    assert "overhead of the" in next(line for line in lines if "departure to arrival" in line)  # two beside each other


def test_overhead_over_one_alone_is_by_the_same_run_and_settings_but_size() -> None:
    def row(n: int, speed: float, overhead: float, run: str = "a") -> summary.Row:
        settings = {"swarm.size": n, "route.vel_leader_mps": speed}
        row = {"run": run, "law": "ours", "backend": "point-mass", "n": n, "settings": settings, "status": "flown"}
        return {**row, "arrived": True, "overhead_leader": overhead, "overhead_last": 2.0 * overhead}

    rows = [row(1, 3.0, 0.02), row(1, 3.0, 0.04), row(8, 3.0, 0.05), row(8, 0.7, 0.05), row(8, 3.0, 0.05, run="b")]
    found = [group.figures.get("over_alone_last") for group in summary.summarise(rows)]
    assert found[1] is not None
    assert found[1].mean == pytest.approx(1.1 / 1.03 - 1.0)
    assert found[2:] == [None, None]


def flights(arrived: int, of: int, **figures: float) -> list[summary.Row]:
    """Of one case; those that do not arrive have no overhead."""
    row = {"run": "a", "law": "ours", "backend": "point-mass", "n": 2, "settings": {}, "status": "flown", **figures}
    return [
        {**row, "arrived": k < arrived, "overhead_last": 0.1 + k / 1000 if k < arrived else None, "contacts": 0}
        for k in range(of)
    ]


@pytest.mark.parametrize(
    ("arrived", "of", "limits", "reached"),
    [
        (20, 20, {"overhead_last": {"mean": 0.2, "worst": 0.2, "p95": 0.2}}, [True, True, True]),
        (2, 20, {"overhead_last": {"mean": 0.2, "worst": 0.2, "p95": 0.2}}, [False, False, False]),
        (19, 20, {"overhead_last": {"mean": 0.2, "worst": 0.2, "p95": 0.2}}, [False, False, True]),
        (2, 20, {"contacts": {"worst": 0.0}}, [True]),
        # How many may not arrive is said
        (19, 20, {"arrived": {"mean": 0.95}, "overhead_last": {"mean": 0.2}}, [True, True]),
        (18, 20, {"arrived": {"mean": 0.95}, "overhead_last": {"mean": 0.2}}, [False, True]),
        (19, 20, {"trunk_clearance_min_m": {"worst": 0.3}}, [False]),  # nobody met one
    ],
)
def test_a_limit_is_judged_over_those_that_failed_too(
    arrived: int, of: int, limits: dict[str, dict[str, float]], reached: list[bool]
) -> None:
    [group] = summary.summarise(flights(arrived, of))
    verdicts = must.judge(group, "", limits)
    assert [verdict.reached for verdict in verdicts] == reached
    shown = page.answer(flights(arrived, of), [group], [verdict.as_dict() for verdict in verdicts])
    assert shown.startswith("PASSED" if all(reached) else "FAILED")


def test_a_flight_that_met_no_trunk_has_none_to_keep_from() -> None:
    rows = [*flights(2, 2, trunk_clearance_min_m=0.5), *flights(2, 2)]
    [group] = summary.summarise(rows)
    limits = {"trunk_clearance_min_m": {"worst": 0.3, "p95": 0.3}}
    assert all(verdict.reached for verdict in must.judge(group, "", limits))


def test_what_95_percent_of_the_seeds_keep_counts_those_without() -> None:
    values = [float(k) for k in range(1, 96)]
    few, many = summary.spread(values, lacking=5), summary.spread(values, lacking=6)
    assert few is not None
    assert many is not None
    assert (few.p95, many.p95) == (95.0, None)
