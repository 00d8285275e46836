"""Signed radio while keys are rotated: neighbouring steps hear each other, and one that is revoked does not count."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from companion.keys.keyring import Keyring
from companion.keys.rotation import advance, revoke
from tests.unit.keys.keys_kit import operator_of, random_bytes, vehicle_of
from tests.unit.mavlink.signing_kit import Node, exchange

SIZE = 4


def steps(first_epoch: int) -> list[Keyring]:
    """The operator's keyrings, from rest to rest."""
    keyrings = [operator_of(SIZE, (first_epoch,))]
    for number in range(3):
        keyrings.append(advance(keyrings[-1], random_bytes("fresh", number)))
    return keyrings


def heard(keyrings: dict[int, Keyring], periods: int = 40) -> dict[int, set[int]]:
    """By receiver: whose beacons counted whole in the last second."""
    nodes = [Node(vehicle, ring=keyring) for vehicle, keyring in keyrings.items()]
    now_s = exchange(nodes, 100.0, periods - 10)
    for node in nodes:
        node.heard.clear()
    exchange(nodes, now_s, 10)
    return {node.id: {sender for sender, counts in node.heard if counts} for node in nodes}


@pytest.mark.parametrize("first_epoch", [0, 255])
@pytest.mark.parametrize("step", [0, 1, 2])
def test_vehicles_of_neighbouring_steps_hear_each_other(first_epoch: int, step: int) -> None:
    earlier, later = list(pairwise(steps(first_epoch)))[step]
    rings = {k: vehicle_of(earlier if k % 2 else later, k) for k in range(1, SIZE + 1)}
    assert heard(rings) == {k: set(rings) - {k} for k in rings}


def test_vehicles_two_steps_apart_do_not() -> None:
    rest, _, active, _ = steps(0)
    assert heard({1: vehicle_of(rest, 1), 2: vehicle_of(active, 2)})[1] == set()


@pytest.mark.parametrize("step", [1, 2, 3])
def test_revoked_vehicle_counts_nowhere_that_the_new_files_are(step: int) -> None:
    before = operator_of(SIZE)
    operator = revoke(before, 3, random_bytes("fresh"))
    for number in range(step - 1):
        operator = advance(operator, random_bytes("more", number))
    rings = {k: vehicle_of(operator, k) for k in (1, 2, 4)} | {3: vehicle_of(before, 3)}
    found = heard(rings)
    assert {k: found[k] for k in (1, 2, 4)} == {1: {2, 4}, 2: {1, 4}, 4: {1, 2}}


def test_what_a_revoked_vehicle_signs_as_another_is_not_even_admitted_after_the_third_step() -> None:
    before = operator_of(SIZE)
    operator = revoke(before, 3, random_bytes("fresh"))
    for number in range(2):
        operator = advance(operator, random_bytes("more", number))
    usurper = replace(vehicle_of(before, 3), owner=2)  # the swarm's old secret, another's id
    nodes = [Node(1, ring=vehicle_of(operator, 1)), Node(2, ring=usurper)]
    exchange(nodes, 100.0, 40)
    assert nodes[0].heard == []
