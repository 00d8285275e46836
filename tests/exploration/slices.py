"""What is explored: swarms, bounds, and which of them the tests have time for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from mission.document.model import Mission
from tests.exploration.air import Act, Air, Lie, World
from tests.exploration.explorer import Bound, Found, explore
from tests.exploration.rules import Bounds, Rules
from tests.exploration.vehicle import Fleet
from tests.unit.core.core_kit import mission

UNDER_WAY = 90  # periods from the ground until a swarm is in transit, settled, and its heir is known
ON_THE_GROUND = 60  # periods that a whole mission takes here
LOSSES = (Act.CUT, Act.DEAF, Act.CRASH, Act.WEAK)


@dataclass(frozen=True, slots=True)
class Slice:
    """A part of what is explored."""

    name: str
    size: int
    acts: tuple[Act, ...]
    begins: int
    rests: Iterable[int]
    chain: bool = False
    from_ground: bool = False  # a whole mission, from the order to fly on; else in transit, which does not end
    lies: tuple[Lie, ...] = ()
    exclusive: int = 0  # periods in which two may decide at once: above 0 is a gap that is known

    def build(self) -> tuple[Air, World, Rules, Bound]:
        """The swarm where it begins, and what holds for it."""
        air = Air(Fleet(small_mission(self.size), arrives=self.from_ground), chain=self.chain)
        world = air.begin()
        for _ in range(0 if self.from_ground else UNDER_WAY):
            world = air.step(world)
        bounds = Bounds.of(self.size, self.size - 1 if self.chain else 1)._replace(exclusive=self.exclusive)
        horizon = ON_THE_GROUND if self.from_ground else 0
        return (
            air,
            world,
            Rules(air, bounds),
            Bound(frozenset(self.acts), self.begins, frozenset(self.rests), horizon, self.lies),
        )

    def explore(self, *, seconds: float = 1e9) -> Found:
        """All of it, or until a rule is broken."""
        return explore(*self.build(), seconds=seconds)


def small_mission(size: int) -> Mission:
    """A tree 60 m off, a second in coverage, and back; those that are late to start are waited for as long."""
    return mission(
        swarm={"size": size, "start_timeout_s": 1.0},
        coverage={"duration_s": 1.0},
        route={"d2_enu_m": (60.0, 0.0, 8.0), "at_end": "return"},
    )


# As many as fit into a minute of pure Python.
QUICK = (
    Slice("four, one trouble", 4, LOSSES, 1, range(1, 29)),
    Slice("chain of four, one trouble", 4, LOSSES, 1, range(1, 29), chain=True),
    Slice("a mission of three, one trouble or an order", 3, (*LOSSES, Act.LAND), 1, range(1, 60, 9), from_ground=True),
    Slice("three, one liar", 3, (Act.LIE,), 1, (1, 5, 11, 16), lies=tuple(Lie)),
    Slice("a mission of three, one liar", 3, (Act.LIE,), 1, (1, 31), from_ground=True, lies=tuple(Lie)),
    Slice("chain of three, two troubles", 3, (Act.CUT, Act.CRASH, Act.WEAK), 2, (1, 14), chain=True),
    Slice("three, two troubles", 3, LOSSES, 2, (1, 14)),
)
ALL = (
    *QUICK,
    Slice("three, two troubles, at any of 9 times", 3, LOSSES, 2, (1, 3, 5, 6, 8, 11, 14, 16, 20)),
    Slice("three, three troubles", 3, (Act.CUT, Act.CRASH, Act.WEAK), 3, (1, 14)),
    Slice("three, two troubles or reboots", 3, (Act.CUT, Act.CRASH, Act.REBOOT), 2, (1, 5, 11, 14, 16)),
    Slice("four, two troubles", 4, LOSSES, 2, (1, 14)),
    Slice("chain of four, two troubles", 4, (Act.CUT, Act.CRASH, Act.WEAK), 2, (1, 14), chain=True),
    Slice("a mission of three, one at any time", 3, (*LOSSES, Act.LAND), 1, range(1, 60), from_ground=True),
    Slice("a mission of four, one trouble or an order", 4, (*LOSSES, Act.LAND), 1, range(1, 60, 9), from_ground=True),
    Slice("four, one liar", 4, (Act.LIE,), 1, (1, 5, 11, 16), lies=tuple(Lie)),
    Slice("three, one liar and a cut", 3, (Act.LIE, Act.CUT), 2, (14,), lies=tuple(Lie)),
    # Known: a leader counts a neighbour that does not hear it, or that has gone over to another, until both notice.
    Slice("three, three one-way links or other troubles", 3, LOSSES, 3, (1, 14)),
    Slice("chain of three, one-way links and crashes", 3, LOSSES, 2, (1, 4, 5, 6, 8, 9, 11, 14), chain=True),
)


def explore_all(slices: Iterable[Slice], *, seconds: float = 1e9) -> Iterator[tuple[Slice, Found]]:
    """One after the other."""
    for part in slices:
        yield part, part.explore(seconds=seconds)
