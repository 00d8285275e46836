"""The news of a swarm for its operator: each once, and no more often than somebody can read it."""

from __future__ import annotations

from companion.core.model.states import SwarmPhase
from companion.core.swarm.reports import LASTS_S, LAYER_SAID_S, WAIT_SAID_S, SwarmReports
from tests.unit.core.core_kit import mission


def said(*waits: tuple[float, list[int]], present: int = 0b111111, goes_on: bool = True) -> list[str]:
    """What a leader says that waits for these, each for so many seconds, 30 s at most; `present` are in its part."""
    reports, now_s = SwarmReports(mission(swarm={"size": 6}), 1), 50.0
    for seconds, waits_for in waits:
        for _ in range(round(10.0 * seconds)):
            now_s += 0.1
            reports.report_waits(waits_for, now_s, now_s + 29.2, present, goes_on=goes_on)
    return [say.text for say in reports.take_all()]


def test_a_leader_says_for_whom_it_waits_how_long_at_most_and_that_it_goes_on() -> None:
    lost = "no link to 2, 3: waiting up to 30 s"
    assert said((10.0, [2, 3]), (5.0, [])) == [lost, "links regained: swarm goes on"]
    assert said((30.0, [2, 3]), (5.0, []), present=0b111001) == [lost, "swarm goes on without 2, 3"]
    found = said((30.0, [2, 3]), (8.0, [3]), (5.0, []), present=0b111011)
    assert found == [lost, "no link to 3: waiting up to 30 s", "swarm goes on without 3"]


def test_a_leader_says_when_another_is_lost_and_names_those_that_one_cut_takes_together() -> None:
    found = said((0.1, [4]), (9.0, [2, 4]), (5.0, [2, 4, 5]))
    assert found == ["no link to 2, 4: waiting up to 30 s", "no link to 2, 4, 5: waiting up to 30 s"]


def test_one_that_hands_the_lead_over_says_nothing_of_its_wait() -> None:
    assert said((30.0, [2, 3]), goes_on=False) == []
    reports = SwarmReports(mission(swarm={"size": 6}), 1)
    for tenth in range(400):
        leads = tenth < 200
        reports.report_waits([2] if leads else [], 0.1 * tenth, 10.0, 0, goes_on=leads)
    assert [say.text for say in reports.take_all()] == ["no link to 2: waiting up to 9 s"]


def test_one_whose_link_comes_and_goes_is_named_once() -> None:
    once = ["no link to 4: waiting up to 30 s", "links regained: swarm goes on"]
    assert said(*[(2.0, [4]), (5.0, [])] * 10) == once
    assert said((2.0, [4]), (WAIT_SAID_S + 1.0, []), (2.0, [4]), (2.0, [])) == once * 2
    assert said((2.0, [4]), (5.0, []), (LASTS_S + 1.0, [4])) == [*once, once[0]]  # it does not come again


def test_a_leader_never_says_that_the_swarm_goes_on_without_itself() -> None:
    """It may not be where all gather yet when a majority is, and the time is up."""
    reports = SwarmReports(mission(swarm={"size": 3}), 1)
    reports.report_phase(SwarmPhase.TRANSIT, SwarmPhase.GATHER, 0, done=0b010)
    assert [say.text for say in reports.take_all()][1:] == ["swarm goes on without 3"]
    reports.report_phase(SwarmPhase.TRANSIT, SwarmPhase.GATHER, 0, done=0b110)
    assert len(reports.take_all()) == 1


def said_of_layers(*layers: tuple[float, float | None], is_steered: bool = True) -> list[str]:
    """What a vehicle says that flies in these, each for so many seconds; None: at the mission's height, 8 m."""
    reports, now_s = SwarmReports(mission(swarm={"size": 6}), 1), 50.0
    for seconds, layer_m in layers:
        for _ in range(round(10.0 * seconds)):
            now_s += 0.1
            reports.report_layer(layer_m, now_s, is_steered=is_steered)
    return [say.text for say in reports.take_all()]


def test_a_vehicle_says_that_it_leaves_its_height_and_that_it_is_back() -> None:
    there_and_back = ["to layer 6.0 m: no quorum", "back to 8.0 m: quorum"]
    assert said_of_layers((30.0, 8.0), (30.0, 6.0), (30.0, 8.0)) == there_and_back
    assert said_of_layers((30.0, None), (30.0, 6.0), (30.0, None)) == there_and_back  # of a formation in space
    assert said_of_layers((30.0, 8.0), (30.0, 6.0), is_steered=False) == []


def test_of_a_radio_that_comes_and_goes_layers_are_not_said_each_time() -> None:
    said = said_of_layers(*[(2.0, 6.0), (2.0, 8.0)] * 10, (LAYER_SAID_S + 1.0, 8.0))
    assert len(said) <= 50.0 / LAYER_SAID_S
    assert said[-1] == "back to 8.0 m: quorum"  # what is said last is so
    assert said_of_layers((2.0, 6.0), (2.0, 8.0), (2.0, 6.0), (30.0, 6.0)) == ["to layer 6.0 m: no quorum"]
