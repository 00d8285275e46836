"""Silent vehicles, as an operator is told of them: every loss that lasts, and not each time that a link is lost."""

from __future__ import annotations

from companion.core.localisation.silence_reports import CALM_S, QUIET_MAX_S, REGAINED_S, SAY_AFTER_S, SilenceReports
from companion.core.model.beacon import PeerReport
from companion.core.model.vectors import ZERO

TICK_S = 0.05
LOST, REGAINED = "vehicle 2 link lost in the air: keeping clear", "vehicle 2 link regained"


class Operator:
    """Hears what is said of vehicle 2."""

    def __init__(self) -> None:
        self.reports, self.now_s, self.heard_s = SilenceReports(), 100.0, 100.0
        self.said: list[tuple[str, float]] = []

    def run(self, seconds: float, *, heard: bool, may_begin: bool = True, elsewhere: bool = False) -> list[str]:
        began = len(self.said)
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            self.heard_s = self.now_s if heard else self.heard_s
            age_s = self.now_s - self.heard_s
            silent = {2: PeerReport(2, ZERO, age_s, silent=True)} if age_s > 0.5 else {}
            heard_elsewhere = [2] if elsewhere else []
            news = self.reports.update(silent, self.now_s, may_begin=may_begin, heard_elsewhere=heard_elsewhere)
            self.said += [(say.text, age_s) for say in news]
        return [text for text, _ in self.said[began:]]


def test_a_loss_is_told_once_and_so_is_its_end() -> None:
    operator = Operator()
    assert operator.run(SAY_AFTER_S - 0.1, heard=False) == []
    assert operator.run(60.0, heard=False) == [LOST]
    assert operator.run(REGAINED_S - 0.1, heard=True) == []
    assert operator.run(60.0, heard=True) == [REGAINED]


def test_a_link_that_is_back_for_moments_is_not_back() -> None:
    operator = Operator()
    operator.run(3.0, heard=False)
    for _ in range(10):
        operator.run(REGAINED_S - 0.5, heard=True)
        operator.run(3.0, heard=False)
    assert [text for text, _ in operator.said] == [LOST]


def test_a_link_that_comes_and_goes_is_told_of_ever_less() -> None:
    operator = Operator()
    for _ in range(20):  # four minutes
        operator.run(8.0, heard=False)
        operator.run(4.0, heard=True)
    assert [text for text, _ in operator.said] == [LOST, REGAINED] * 2


def test_a_dead_vehicle_is_named_whatever_its_link_did_before() -> None:
    operator = Operator()
    for _ in range(20):
        operator.run(30.0, heard=False)
        operator.run(4.0, heard=True)
    assert operator.run(QUIET_MAX_S + 1.0, heard=False) == [LOST]


def test_after_a_calm_time_a_loss_is_told_of_as_at_first() -> None:
    operator = Operator()
    for _ in range(5):
        operator.run(30.0, heard=False)
        operator.run(4.0, heard=True)
    operator.run(CALM_S, heard=True)
    assert operator.run(SAY_AFTER_S + 0.1, heard=False) == [LOST]


def test_nothing_begins_before_it_has_listened_and_what_was_told_goes_on() -> None:
    operator = Operator()
    assert operator.run(5.0, heard=False, may_begin=False) == []
    assert operator.run(1.0, heard=False) == [LOST]
    assert operator.run(4.0, heard=True, may_begin=False) == [REGAINED]


def test_one_that_another_member_hears_is_hidden_and_not_lost_but_no_member_keeps_a_loss_from_being_told() -> None:
    operator = Operator()
    for _ in range(10):
        assert operator.run(QUIET_MAX_S - 2.0, heard=False, elsewhere=True) == []
        operator.run(1.0, heard=True)
    assert operator.run(QUIET_MAX_S + 0.1, heard=False, elsewhere=True) == [LOST]
