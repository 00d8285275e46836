"""What was seen before: kept for minutes, dropped where it is seen through, and bounded."""

from __future__ import annotations

import math

from companion.core.perception.obstacle_memory import CELLS_MAX, KEPT_S, LOOKS, NOTED_S, ObstacleMemory

HERE = (0.0, 0.0, -4.0)
SEEN_ALL_ROUND = [False] * 72


def noted(memory: ObstacleMemory, *points: tuple[float, float], at_s: float, blind: list[bool] | None = None) -> None:
    memory.note_points(
        [n for n, _ in points], [e for _, e in points], HERE, SEEN_ALL_ROUND if blind is None else blind, 8.0, at_s
    )


def remembered(memory: ObstacleMemory, from_ned_m: tuple[float, float, float] = HERE) -> list[tuple[float, float]]:
    return sorted(zip(*memory.seen_before(from_ned_m, 0.65).find_near(24.0), strict=True))


def test_what_is_out_of_sight_is_remembered_from_wherever_the_vehicle_is() -> None:
    memory = ObstacleMemory()
    noted(memory, (5.0, 0.0), at_s=0.0)
    memory.note_points([], [], (-10.0, 0.0, -4.0), SEEN_ALL_ROUND, 8.0, 10.0)
    assert remembered(memory, (-10.0, 0.0, -4.0)) == [(15.0, 0.0)]


def test_what_is_seen_through_is_gone_and_what_is_hidden_or_not_looked_at_is_not() -> None:
    free, hidden, unseen = ObstacleMemory(), ObstacleMemory(), ObstacleMemory()
    for memory in (free, hidden, unseen):
        noted(memory, (5.0, 0.0), at_s=0.0)
    for k in range(1, LOOKS + 1):
        noted(free, at_s=NOTED_S * k)
        noted(hidden, (3.0, 0.0), at_s=NOTED_S * k)
        noted(unseen, at_s=NOTED_S * k, blind=[True] * 72)
    assert remembered(free) == []
    assert remembered(hidden) == [(3.0, 0.0), (5.0, 0.0)]
    assert remembered(unseen) == [(5.0, 0.0)]


def test_it_forgets_after_minutes() -> None:
    memory = ObstacleMemory()
    noted(memory, (20.0, 0.0), at_s=0.0)
    noted(memory, at_s=KEPT_S - 1.0)
    assert remembered(memory) == [(20.0, 0.0)]
    noted(memory, at_s=KEPT_S + 1.0)
    assert remembered(memory) == []


def test_it_is_bounded_and_the_oldest_goes_first() -> None:
    memory = ObstacleMemory()
    noted(memory, (5.0, 5.0), at_s=0.0)
    for k in range(9):
        grid = [(10.0 + 0.5 * j, 100.0 * k + 0.5 * i) for j in range(25) for i in range(25)]
        noted(memory, *grid, at_s=1.0 + k)
    assert len(memory._cells) == CELLS_MAX
    assert (5.0, 5.0) not in remembered(memory)


def test_what_it_has_told_does_not_change_any_more() -> None:
    memory = ObstacleMemory()
    noted(memory, (5.0, 0.0), at_s=0.0)
    told = memory.seen_before(HERE, 0.65)
    noted(memory, (6.0, 1.0), at_s=1.0)
    assert told.find_near(24.0) == ([5.0], [0.0])
    assert all(map(math.isfinite, (*told.find_near(24.0)[0],)))
