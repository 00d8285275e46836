"""The age of beacons, whatever clocks show and radios do."""

from __future__ import annotations

import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from companion.core.localisation.beacon_age import AGE_MAX_S
from companion.core.model.beacon import Beacon, BeaconEcho
from tests.unit.core.beacon_age_kit import Airwaves, Clock

clocks = st.builds(
    Clock, shows_s=st.floats(0.0, 1e6), fast=st.floats(-200e-6, 200e-6), phase_s=st.sampled_from([0.0, 0.013, 0.031])
)


@given(
    here=clocks,
    there=clocks,
    delay_s=st.floats(0.001, 0.4),
    jitter_s=st.floats(0.0, 0.3),
    loss=st.floats(0.0, 0.4),
    stamps=st.booleans(),
    seed=st.integers(0, 99),
)
def test_ages_are_known_as_well_as_both_ways_are_alike(
    here: Clock, there: Clock, delay_s: float, jitter_s: float, loss: float, stamps: bool, seed: int
) -> None:
    """To 13 ms by the drift of clocks; by a twentieth of the jitter; by half a tick, where ticks stamp arrivals."""
    air = Airwaves(
        {1: here, 2: there},
        lambda rng, _sender, _receiver: delay_s + rng.uniform(0.0, jitter_s),
        loss=loss,
        seed=seed,
        stamps=stamps,
    )
    air.run(25.0)
    bound_s = 0.013 + 0.05 * jitter_s + (0.0 if stamps else 0.026)
    for pair in ((1, 2), (2, 1)):
        assert max(map(abs, air.errors_s(*pair, from_s=15.0))) <= bound_s


@given(seed=st.integers(0, 2**32 - 1))
def test_no_liar_makes_a_beacon_younger_than_its_arrival_or_changes_anothers_age(seed: int) -> None:
    rng = random.Random(seed)

    def tamper(said: Beacon) -> Beacon:
        echo = BeaconEcho(rng.randint(0, 255), rng.randint(0, 0xFFFF), rng.choice([0.0, 0.05, 65.535, rng.random()]))
        return replace(said, echo=echo, time_ms=said.time_ms + rng.choice([0, 0, rng.randint(0, 2**32)]))

    three = {1: Clock(5.0), 2: Clock(30.0), 3: Clock(7.0)}
    lied = Airwaves(three, lambda *_: 0.15, tamper={3: tamper})
    lied.run(4.0)
    honest = Airwaves(three, lambda *_: 0.15)
    honest.run(4.0)
    for (_, found_s, _), (_, honest_s, _) in zip(lied.measured[(1, 2)], honest.measured[(1, 2)], strict=True):
        assert abs(found_s - honest_s) <= 0.002  # it changes who is echoed when, and stamps are milliseconds
    assert all(0.0 <= found <= AGE_MAX_S for _, found, _ in lied.measured[(1, 3)])
