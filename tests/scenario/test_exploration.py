"""All that an adversary can do within a bound, on the shipped election, quorum and phases: see tests/exploration."""

from __future__ import annotations

import pytest

from companion.core.swarm.roster import Roster
from companion.core.swarm.swarm import Swarm
from companion.core.vehicle.operator_orders import FloodedOrders
from tests.bench.planted_defects import Defect
from tests.exploration.air import Act, Air, Trouble
from tests.exploration.defects import DEFECTS, find
from tests.exploration.kept import Shelf
from tests.exploration.model import LINGERS, STALE, Model, find_overlap
from tests.exploration.slices import QUICK, Slice, small_mission
from tests.exploration.vehicle import Fleet

pytestmark = pytest.mark.sources


@pytest.mark.parametrize("part", QUICK, ids=lambda part: part.name)
def test_every_rule_holds_in_every_state_within_the_bound(part: Slice) -> None:
    found = part.explore()
    assert not found.violations
    assert found.complete
    assert found.states > 3000


@pytest.mark.parametrize(("defect", "part"), DEFECTS, ids=[defect.name for defect, _ in DEFECTS])
def test_a_planted_defect_is_found(defect: Defect, part: str) -> None:
    assert f"{part}: {defect.cause}" in find(defect, part)


def test_the_same_state_later_is_the_same_value() -> None:
    air = Air(Fleet(small_mission(3), arrives=False))
    world = air.begin()
    for _ in range(90):
        world = air.step(world)
    assert air.step(world) == world
    cut = air.begin_trouble(world, Trouble(Act.CUT, 0b001))
    assert air.step(cut) != cut


def test_a_field_that_no_table_knows_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Roster, "__slots__", (*Roster.__slots__, "news"))
    with pytest.raises(ValueError, match="Roster: news: say how it is kept"):
        Shelf(Swarm(small_mission(3), 1, FloodedOrders()))


@pytest.mark.parametrize("stale", STALE)
def test_in_the_small_model_a_vote_that_is_promised_keeps_one_alone_and_no_wait_does(stale: int) -> None:
    promised = stale + LINGERS
    assert not find_overlap(Model(3, stale=stale, wait=0, promise=promised))[0]
    assert find_overlap(Model(3, stale=stale, wait=0, promise=promised - 1))[0]
    assert find_overlap(Model(3, stale=stale, wait=10))[0]
