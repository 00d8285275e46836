"""The age of beacons, measured both ways between clocks that nobody has set."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from companion.core.localisation.beacon_age import (
    AGE_MAX_S,
    HOLD_MAX_S,
    UNMEASURED_S,
    WINDOW_S,
    BeaconAges,
)
from companion.core.model.beacon import Beacon, BeaconEcho
from tests.unit.core.beacon_age_kit import Airwaves, Clock
from tests.unit.core.core_kit import beacon

PPM = 1e-6


def constant(delay_s: float):  # type: ignore[no-untyped-def]
    return lambda _rng, _sender, _receiver: delay_s


@pytest.mark.parametrize("delay_s", [0.001, 0.05, 0.1, 0.23, 0.4])
def test_a_constant_delay_is_known_to_milliseconds_whatever_the_clocks_show(delay_s: float) -> None:
    """Where ticks are alike, as in lockstep, or what arrives is stamped when it does."""
    air = Airwaves({1: Clock(5000.0), 2: Clock(3.3)}, constant(delay_s))
    stamped = Airwaves({1: Clock(5000.0, 200 * PPM), 2: Clock(3.3, -200 * PPM)}, constant(delay_s), stamps=True)
    air.run(20.0)
    stamped.run(90.0)
    for pair in ((1, 2), (2, 1)):
        assert max(map(abs, air.errors_s(*pair, from_s=2.0))) <= 0.002
        assert max(map(abs, stamped.errors_s(*pair, from_s=2.0))) <= 0.013


@pytest.mark.parametrize("delay_s", [0.001, 0.05, 0.1, 0.23, 0.4])
def test_ticks_of_free_clocks_cost_half_a_tick_at_most(delay_s: float) -> None:
    air = Airwaves({1: Clock(5000.0, 200 * PPM), 2: Clock(3.3, -200 * PPM)}, constant(delay_s))
    air.run(150.0)
    for pair in ((1, 2), (2, 1)):
        assert max(map(abs, air.errors_s(*pair, from_s=2.0))) <= 0.035


def test_late_beacons_are_as_old_as_they_are() -> None:
    air = Airwaves({1: Clock(7.0), 2: Clock(90_000.0)}, lambda rng, _s, _r: 0.1 + rng.uniform(0.0, 0.3), loss=0.4)
    air.run(60.0)
    assert max(true for _, _, true in air.measured[(1, 2)]) > 0.4
    assert max(map(abs, air.errors_s(1, 2, from_s=15.0))) <= 0.03


def test_vehicles_that_tick_at_different_moments_are_off_by_half_a_tick_at_most() -> None:
    for phase_s in (0.01, 0.02, 0.03, 0.04):
        air = Airwaves({1: Clock(), 2: Clock(phase_s=phase_s)}, constant(0.12))
        air.run(20.0)
        assert max(map(abs, air.errors_s(1, 2, from_s=2.0))) <= 0.026


def test_each_of_many_is_echoed_in_turn() -> None:
    air = Airwaves({k: Clock(100.0 * k) for k in range(1, 13)}, constant(0.2))
    air.run(4.0)
    for sender in range(2, 13):
        assert max(map(abs, air.errors_s(1, sender, from_s=2.5))) <= 0.002


def test_until_a_neighbour_echoes_its_quickest_beacon_counts_as_a_tick_old() -> None:
    ages = BeaconAges(1)
    assert ages.receive(beacon(2, time_ms=70_000), 5.0) == UNMEASURED_S
    assert ages.receive(beacon(2, time_ms=70_100), 5.3) == pytest.approx(0.2 + UNMEASURED_S)
    assert ages.receive(beacon(2, time_ms=70_200), 5.2) == pytest.approx(UNMEASURED_S)


def test_a_delay_that_grows_or_shrinks_is_followed() -> None:
    delay_s = [0.05]
    air = Airwaves({1: Clock(1.0), 2: Clock(2.0)}, lambda *_: delay_s[0])
    for now_s in (0.05, 0.3, 0.1):
        delay_s[0] = now_s
        air.run(50.0)
        assert max(map(abs, air.errors_s(1, 2)[-450:])) <= 0.003
        air.measured.clear()


def test_a_neighbour_whose_companion_began_anew_is_measured_anew() -> None:
    ages = BeaconAges(1)
    for k in range(20):
        ages.receive(beacon(2, time_ms=900_000 + 100 * k), 10.0 + 0.1 * k)
    assert ages.receive(beacon(2, time_ms=100), 15.0) == UNMEASURED_S
    assert ages.receive(beacon(2, time_ms=200), 15.2) == pytest.approx(0.1 + UNMEASURED_S)


def test_a_beacon_that_is_played_again_does_not_begin_anew() -> None:
    ages = BeaconAges(1)
    for k in range(100):
        ages.receive(beacon(2, time_ms=900_000 + 100 * k), 10.0 + 0.1 * k)
        assert k < 40 or ages.receive(beacon(2, time_ms=900_000), 10.0 + 0.1 * k) == AGE_MAX_S
    assert ages.receive(beacon(2, time_ms=910_000), 20.0) == pytest.approx(UNMEASURED_S)


@pytest.mark.parametrize(
    "lie",
    [
        lambda said, echo: replace(said, echo=replace(echo, hold_s=echo.hold_s + 0.5)),
        lambda said, echo: replace(said, echo=replace(echo, hold_s=0.0)),
        lambda said, echo: replace(said, echo=replace(echo, hold_s=65.0)),
        lambda said, echo: replace(said, echo=replace(echo, time_ms=echo.time_ms ^ 0xFFFF)),
        lambda said, echo: replace(said, echo=replace(echo, time_ms=(echo.time_ms - 1000) & 0xFFFF)),
        lambda said, _echo: replace(said, time_ms=said.time_ms * 3 % 7919),
    ],
)
def test_one_that_lies_about_times_is_no_younger_than_its_arrival_nor_changes_the_age_of_others(lie) -> None:  # type: ignore[no-untyped-def]
    def tamper(said: Beacon) -> Beacon:
        return said if said.echo is None else lie(said, said.echo)

    clocks = {1: Clock(4.0), 2: Clock(700.0), 3: Clock(90.0)}
    honest, lied = Airwaves(clocks, constant(0.15)), Airwaves(clocks, constant(0.15), tamper={3: tamper})
    honest.run(20.0)
    lied.run(20.0)
    assert lied.measured[(1, 2)] == honest.measured[(1, 2)]
    assert all(0.0 <= found <= AGE_MAX_S for _, found, _ in lied.measured[(1, 3)])


def test_what_arrived_long_ago_is_not_echoed() -> None:
    ages = BeaconAges(1)
    ages.receive(beacon(2, time_ms=65_536 + 300), 5.0)
    assert ages.make_echo(5.0 + HOLD_MAX_S + 0.1) is None
    ages.receive(beacon(2, time_ms=65_536 + 20_300), 25.0)
    assert ages.make_echo(25.4) == BeaconEcho(2, 20_300, pytest.approx(0.4))
    assert ages.make_echo(25.5) is None


def test_what_is_kept_is_bounded() -> None:
    rng, ages = random.Random(5), BeaconAges(1)
    for k in range(3000):
        said = beacon(2, time_ms=int(100 * (k - rng.random())), echo=BeaconEcho(1, 100 * k & 0xFFFF, 0.0))
        ages.receive(said, 0.1 * k)
    slots = WINDOW_S / 5.0 + 1
    assert len(ages._links[2].from_peer._slots) <= slots
    assert len(ages._links[2].to_peer._slots) <= slots
