"""Refusals as they come out of another process, where studies and benches fly."""

from __future__ import annotations

import pickle

import pytest
from pydantic import ValidationError

from mission.common.problems import MissionError, Problem
from mission.document.model import Mission
from mission.schema.conflict import Conflict, ConflictError

PROBLEMS = (Problem("m.toml", 3, "swarm.size", "20", "is too many"), Problem("--n", None, "", "", "and more"))
CONFLICTS = (Conflict((("swarm", "size"),), "20", "is too many"), Conflict((("name",),), "", "is missing"))


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MissionError(PROBLEMS), "m.toml:3: swarm.size = 20: is too many\n--n: and more"),
        (ConflictError(CONFLICTS), "swarm.size = 20: is too many; name: is missing"),
    ],
)
def test_a_refusal_says_the_same_on_the_other_side(error: Exception, said: str) -> None:
    assert str(error) == said
    there = pickle.loads(pickle.dumps(error))  # as a pool of processes sends it
    assert type(there) is type(error)
    assert str(there) == said
    assert vars(there) == vars(error)


def test_laws_that_a_mission_breaks_are_told_on_the_other_side() -> None:
    route = {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 30}
    with pytest.raises(ValidationError) as refused:
        Mission.model_validate({"schema": 1, "route": route})
    there = pickle.loads(pickle.dumps(refused.value))
    assert "route.vel_leader_mps = 30.0: must be" in str(there)
    assert str(there) == str(refused.value)
