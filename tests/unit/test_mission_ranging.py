"""Missions in which not all vehicles have satellites: which have, and what else the file must then say."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError
from ranging_kit import STARTS, ranging_mission

from mission import simulator
from mission.load import dump_mission, parse_mission
from mission.model import Mission
from mission.problems import MissionError

ROUTE = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3}


def flown(gnss: Any, *, priority: tuple[int, ...] = (), size: int = 4, **tables: Any) -> Mission:
    swarm = {"size": size, "leader_priority": priority, "gnss": gnss}
    return Mission.model_validate({"schema": 1, "route": ROUTE, "swarm": swarm, **tables})


def refusal(gnss: Any, **others: Any) -> str:
    with pytest.raises(ValidationError) as refused:
        flown(gnss, **others)
    return str(refused.value)


RANGING = {"ranging": {"start_enu_m": STARTS}}


def test_by_default_all_have_satellites() -> None:
    mission = Mission.model_validate({"schema": 1, "route": ROUTE})
    assert not mission.flies_by_ranges
    assert all(mission.has_satellites(k) for k in range(1, 9))


def test_the_leader_is_the_first_of_those_that_may_lead() -> None:
    mission = flown("leader", priority=(3, 1), **RANGING)
    assert mission.flies_by_ranges
    assert [k for k in range(1, 5) if mission.has_satellites(k)] == [3]


def test_ids_name_those_that_have_satellites() -> None:
    mission = flown((1, 4), **RANGING)
    assert [k for k in range(1, 5) if mission.has_satellites(k)] == [1, 4]
    assert not flown((1, 2, 3, 4)).flies_by_ranges


@pytest.mark.parametrize(
    ("gnss", "others", "said"),
    [
        ("leader", RANGING, 'swarm.gnss = "leader": needs the leader that has satellites'),
        ("leader", {"priority": (1,)}, "needs [ranging]"),
        ((), RANGING, "needs one vehicle at least"),
        ((1, 7), RANGING, "must name vehicles of the swarm (swarm.size = 4)"),
        ((1,), {"size": 5, **RANGING}, "swarm.size = 5: ranging.start_enu_m has 4 places"),
        ((1,), {"ranging": {"start_enu_m": STARTS, "reach_m": 8.0}}, "ranging.reach_m = 8.0: must be at least"),
        (
            (1,),
            {"ranging": {"start_enu_m": [(0, 0, 0), (6, 0, 0), (20, 0, 0), (40, 0, 0)]}},
            "has vehicles 1 and 2 6.0 m",
        ),
        (
            "all",
            {"sim": {"satellites": {"crowns": "shade"}}},
            'sim.satellites.crowns = "shade": must be clear: a swarm of which all',
        ),
        (
            (1,),
            {"priority": tuple(range(1, 129)), "size": 128, **RANGING},
            "must be at most 127 ids where not all have satellites",
        ),
        ("some", RANGING, 'must be "all", "leader", or an array of ids, 1 to 250'),
        ((1, 1), RANGING, "each at most once"),
        ((1, 0), RANGING, "1 to 250"),
        (True, RANGING, "or an array of ids"),
    ],
)
def test_what_does_not_go_together_is_refused(gnss: Any, others: Any, said: str) -> None:
    assert said in refusal(gnss, **others)


def test_a_smaller_swarm_takes_the_first_places() -> None:
    assert ranging_mission().with_size(3).flies_by_ranges


def test_the_file_is_written_and_read_back() -> None:
    mission = ranging_mission()
    assert parse_mission(dump_mission(mission), "again") == mission


def test_who_cannot_measure_ranges_refuses_such_a_mission() -> None:
    with pytest.raises(MissionError, match=r"swarm.gnss = .leader.: must be all: no radios here"):
        simulator.needs_satellites(ranging_mission(), "file", "no radios here")
    simulator.needs_satellites(Mission.model_validate({"schema": 1, "route": ROUTE}), "file", "no radios here")
