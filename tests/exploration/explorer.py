"""Depth first through all that an adversary can do within a bound, each state once."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from tests.exploration.air import Act, Air, Lie, World
from tests.exploration.rules import Monitor, Rules

Path = tuple["Path", int, str] | None  # what was done before; periods of rest before that, and what was done


@dataclass(frozen=True, slots=True)
class Bound:
    """How far is explored: what the adversary may do, how often, and how long it rests in between."""

    acts: frozenset[Act]
    begins: int  # acts, not counting those by which one ends
    rests: frozenset[int]  # periods between two of them, or from the start
    horizon: int = 0  # periods of rest after which a way ends; at least until all must have settled
    lies: tuple[Lie, ...] = ()


class Node(NamedTuple):
    """A state of the search."""

    world: World
    monitor: Monitor
    rested: int
    begins: int  # that are left


@dataclass(slots=True)
class Found:
    """What a search has found."""

    states: int = 0
    steps: int = 0
    ends: int = 0  # ways that came to their end
    violations: dict[str, str] = field(default_factory=dict)  # the first of each kind: how it comes about
    settled_after: int = 0  # the longest until all agreed again
    together: int = 0  # the longest with two acting leaders in one part, once it is settled who hears whom
    exclusive: int = 0  # the longest with two that decide for the swarm
    members: int = 0  # states of one vehicle
    complete: bool = True
    seconds: float = 0.0  # of the processor


def explore(air: Air, start: World, rules: Rules, bound: Bound, *, seconds: float = 1e9, stop_at: int = 1) -> Found:
    """All states within the bound, or until `stop_at` kinds of violations are found or the time is up."""
    found, began_s = Found(), time.process_time()
    seen: set[int] = set()
    stack: list[tuple[Node, Path]] = [(Node(start, rules.begin(start), 0, bound.begins), None)]
    while stack:
        node, path = stack.pop()
        if found.steps % 256 == 0 and time.process_time() - began_s > seconds:
            found.complete = False
            break
        moves = 0
        for before, rested, begins, done in _moves(air, rules, node, bound):
            moves += 1
            found.steps += 1
            way = path if not done else (path, node.rested, done)
            try:
                after = air.step(before)
            except Exception as error:  # noqa: BLE001 - whatever it is, it is what is looked for
                _note(found, f"error: {type(error).__name__}: {error}", way, rested)
                continue
            monitor = rules.count(after, node.monitor)
            if not monitor.lied:
                found.together = max(found.together, monitor.together)
                found.exclusive = max(found.exclusive, monitor.exclusive)
            broken = list(rules.find_violations(before, after, monitor, rested))
            for what in broken:
                _note(found, what, way, rested)
            if broken:
                if len(found.violations) >= stop_at:
                    stack.clear()
                    break
                continue
            if not rules.is_settled(after, monitor):
                found.settled_after = max(found.settled_after, rested)
            following = Node(after, monitor, rested, begins)
            key = hash(following)
            if key not in seen:
                seen.add(key)
                stack.append((following, way))
        found.ends += not moves
    found.states, found.members = len(seen), air.fleet.count
    found.seconds = time.process_time() - began_s
    return found


def _moves(air: Air, rules: Rules, node: Node, bound: Bound) -> Iterator[tuple[World, int, int, str]]:
    """The world before the next period, periods of rest by its end, acts that are left, and what was done."""
    world, monitor, rested, begins = node
    if rested < max(bound.horizon, rules.limit(monitor)):
        yield world, rested + 1, begins, ""
    if rested and rested not in bound.rests:
        return
    for trouble in world.troubles:
        yield air.end_trouble(world, trouble), 1, begins, f"end {trouble}"
        if trouble.act is Act.CRASH and Act.REBOOT in bound.acts:
            yield air.end_trouble(world, trouble, reboot=True), 1, begins, f"reboot {trouble}"
    if begins:
        for trouble in air.troubles(world, bound.acts, bound.lies):
            yield air.begin_trouble(world, trouble), 1, begins - 1, str(trouble)


def _note(found: Found, what: str, path: Path, rested: int) -> None:
    kind = what.split(":")[0]
    if kind not in found.violations:
        acts: list[str] = []
        while path is not None:
            path, after, done = path
            acts.insert(0, f"{after}: {done}")
        found.violations[kind] = f"{what}; {', '.join(acts)}, {rested} periods ago"
