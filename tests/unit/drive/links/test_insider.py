"""Beacons of an insider: what goes on the air is a valid beacon of its own id, and lies."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import TrunkReport
from companion.mavlink.beacon import COMPONENT, beacons
from companion.mavlink.framing import wire
from companion.mavlink.own_messages import decode_beacon, encode_trunk_report
from companion.mavlink.relative import TRUNKS_ID, read_trunk_report
from mission.common.frames import Vec3
from mission.document.model import Mission
from mission.schema.kinds import Lie
from sim_bridge.drive.links.insider import Insiders
from sim_bridge.drive.links.transmitter import Transmitter
from sim_bridge.world.radio import Radio
from sim_bridge.world.world import DEFAULT_ORIGIN
from tests.unit.core.core_kit import lease, mission
from tests.unit.drive.links.test_transmitter import CLOSE, frame

SENT = {"lease": lease(2, 77, established=True), "hop": 1, "route_cost": 1.0, "dest_ned_m": (50.0, 0.0, 0.0)}


def flies(seed: int = 1) -> Mission:
    return mission(swarm={"size": 3}, sim={"seed": seed}).with_origin(DEFAULT_ORIGIN)


def told(lie: Lie, seed: int = 1, *, places: dict[int, Vec3] = CLOSE) -> bytes:
    """What 2 receives of a beacon of 1."""
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1)
    air.place(places)
    insiders = Insiders(flies(seed))
    insiders.set_lies({1: lie})
    companions = Transmitter(air, insiders)
    assert companions.send(1, frame(1, **SENT), 1.0) == (frame(1, **SENT),)  # kept, and judged, as it said it
    return air.deliver(2, 1.0)


@pytest.mark.parametrize("lie", [lie for lie in Lie if lie not in (Lie.RANGES, Lie.TRUNKS)])
@pytest.mark.parametrize("seed", range(8))
def test_what_goes_on_the_air_is_a_believable_beacon_of_its_own_id(lie: Lie, seed: int) -> None:
    ((sender, data, fields),) = beacons(told(lie, seed))
    assert sender == 1
    assert data != frame(1, **SENT) or lie is Lie.CLOCK  # one that jumps later begins true
    assert decode_beacon(1, fields) is not None
    assert wire.frame(52100, data[10:-2], seq=0, system=1, component=COMPONENT)[:10] == data[:10]


def test_the_same_seed_tells_the_same_lies_and_the_others_tell_the_truth() -> None:
    assert told(Lie.PUSH, 3) == told(Lie.PUSH, 3)
    assert told(Lie.PUSH, 3) != told(Lie.PUSH, 4)
    insiders = Insiders(flies())
    insiders.set_lies({1: Lie.PUSH})
    assert insiders.find_insider(2) is None
    first = insiders.find_insider(1)
    insiders.set_lies({1: Lie.PUSH})
    assert insiders.find_insider(1) is first
    insiders.set_lies({})
    assert insiders.find_insider(1) is None


@pytest.mark.parametrize("seed", range(12))
def test_false_trunks_are_those_that_it_sees_elsewhere_about_it(seed: int) -> None:
    """As many, as thick, under its own id and of the same time; their places lie, by ever more or at once."""
    told = TrunkReport(1, 500, (3.0, -2.0), ((4.0, 1.0, 0.3), (-2.5, 6.0, 0.25), (0.5, -7.0, 0.5), (8.0, 3.0, 0.4)))
    payload = encode_trunk_report(told)
    true = wire.frame(TRUNKS_ID, payload, seq=7, system=1, component=COMPONENT)
    insiders = Insiders(flies(seed))
    assert insiders.rewrite_trunks(1, true, 1.0) == true
    insiders.set_lies({1: Lie.TRUNKS})
    insiders.rewrite_trunks(1, true, 1.0)
    found = read_trunk_report(insiders.rewrite_trunks(1, true, 21.0))
    assert found is not None
    assert (found.sender, found.odo_ne_m) == (1, told.odo_ne_m)
    assert [wide for *_, wide in found.trunks] == pytest.approx([wide for *_, wide in told.trunks], abs=0.02)
    off_m = [math.dist(a[:2], b[:2]) for a, b in zip(found.trunks, told.trunks, strict=True)]
    assert max(off_m) > 0.3
    assert max(off_m) <= 14.1
    insiders.set_lies({1: Lie.PUSH})
    assert insiders.rewrite_trunks(1, true, 22.0) == true
    air = Radio(range_m=30.0, loss=0.0, delay_s=0.0, seed=1)
    air.place(CLOSE)
    insiders.set_lies({1: Lie.TRUNKS})
    insiders.rewrite_trunks(1, true, 20.0)
    Transmitter(air, insiders).send(1, frame(1, **SENT) + true, 40.0)
    data = air.deliver(2, 41.0)
    assert frame(1, **SENT) in data  # its beacons tell the truth
    assert read_trunk_report(data[-len(true) :]) is not None
    assert true not in data
