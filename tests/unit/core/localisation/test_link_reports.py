"""The news of a bad radio: once when it begins, once when it is over."""

from __future__ import annotations

from companion.core.localisation.link_reports import LinkReports
from tests.unit.core.core_kit import neighbour

POOR, GOOD = "radio poor: over a third of beacons lost", "radio good again: under a quarter lost"


def said(*spells: tuple[float, tuple[float, ...]]) -> list[tuple[int, str]]:
    """What is said, and in which second, while so many seconds long these shares of the neighbours' beacons arrive."""
    reports, found, tick = LinkReports(), list[tuple[int, str]](), 0
    for seconds, shares in spells:
        heard = [neighbour(k, (10.0 * k, 0.0, 0.0), share=share) for k, share in enumerate(shares, start=2)]
        for _ in range(round(20.0 * seconds)):
            found += [(tick // 20, say.text) for say in reports.update(heard, 0.05 * tick)]
            tick += 1
    return found


def test_40_percent_loss_is_said_after_a_minute_and_its_end_once() -> None:
    found = said((120.0, (0.6, 0.55, 0.65)), (120.0, (1.0, 1.0, 1.0)))
    assert [text for _, text in found] == [POOR, GOOD]
    assert 59 <= found[0][0] <= 61


def test_a_shadow_one_bad_link_of_many_and_a_share_on_the_edge_are_no_news() -> None:
    assert said((60.0, (1.0, 1.0)), (15.0, (0.1, 0.1)), (60.0, (1.0, 1.0))) == []
    assert said((300.0, (0.2, 1.0, 1.0))) == []
    edge = said((90.0, (0.6,)), *[(90.0, (0.7,)), (90.0, (0.6,))] * 3)
    assert [text for _, text in edge] == [POOR]


def test_who_hears_nobody_says_nothing_of_its_radio() -> None:
    assert said((200.0, ())) == []
