"""The news of a swarm for its operator: each once, and no more often than somebody can read it."""

from __future__ import annotations

from companion.core.swarm.reports import WAIT_SAID_S, SwarmReports
from tests.unit.core.core_kit import mission


def said(*waits: tuple[float, list[int]]) -> list[str]:
    """What a leader says that waits for these, each for so many seconds."""
    reports, now_s = SwarmReports(mission(swarm={"size": 6}), 1), 50.0
    for seconds, waits_for in waits:
        for _ in range(round(10.0 * seconds)):
            now_s += 0.1
            reports.report_waits(waits_for, now_s)
    return [say.text for say in reports.take_all()]


def test_a_leader_says_once_for_whom_it_waits_and_again_when_another_is_lost() -> None:
    assert said((30.0, [2, 3]), (5.0, [3]), (5.0, [3, 5])) == ["no link to 2, 3: waiting", "no link to 3, 5: waiting"]


def test_one_whose_link_comes_and_goes_is_named_once() -> None:
    assert said(*[(2.0, [4]), (5.0, [])] * 10) == ["no link to 4: waiting"]
    assert said((2.0, [4]), (WAIT_SAID_S + 1.0, []), (2.0, [4])) == ["no link to 4: waiting"] * 2
