"""Own motion that nothing corrects is told to people, once, also where it never was; what flickers is not."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from companion.core.model.actions import TEXT_MAX, Say
from companion.core.model.events import LidarScan, Position
from companion.core.perception.obstacle_perception import build_perception
from companion.mavlink.endpoint import Endpoint
from companion.sensors.table import sensors_of
from companion.shell.flight_log import AGAIN_S, CORRECTED, UNSEEN, UNSEEN_S, ChangeLogger, MotionLog
from tests.unit.core.core_kit import mission
from tests.unit.sensors.lidar_kit import scan

TICK_S = 0.05


class Told:
    """A vehicle's log of its motion, and what it told."""

    def __init__(self) -> None:
        self.told: list[tuple[float, str]] = []
        self.log = MotionLog(self.line, self.report)
        self.ticks = 0

    def line(self, now_s: float, text: str) -> None:
        self.told.append((round(now_s, 2), text))

    def report(self, say: Say) -> None:
        self.line(self.ticks * TICK_S, say.text)

    def fly(self, for_s: float, *, seen: bool, airborne: bool = True, sees: bool = True) -> None:
        for _ in range(round(for_s / TICK_S)):
            self.ticks += 1
            self.log.update(self.ticks * TICK_S, is_corrected=seen, is_airborne=airborne, sees_several=lambda: sees)

    @property
    def texts(self) -> list[str]:
        return [text for _, text in self.told]


def test_one_that_nothing_ever_corrects_says_so_once() -> None:
    one = Told()
    one.fly(60.0, seen=False, airborne=False)
    assert one.told == []
    one.fly(120.0, seen=False)
    ((at_s, text),) = one.told
    assert text == UNSEEN.text
    assert abs(at_s - 60.0 - UNSEEN_S) <= 1.1
    assert len(text) <= TEXT_MAX


def test_that_trunks_correct_it_is_a_line_at_once_and_after_it_was_lost_when_it_lasts() -> None:
    one = Told()
    one.fly(3.0, seen=True)
    one.fly(UNSEEN_S + 2.0, seen=False)
    one.fly(AGAIN_S - 1.0, seen=True)
    one.fly(30.0, seen=False)
    assert one.texts == [CORRECTED, UNSEEN.text]
    one.fly(AGAIN_S + 1.0, seen=True)
    assert one.texts == [CORRECTED, UNSEEN.text, CORRECTED]


def test_what_comes_and_goes_is_one_line() -> None:
    one = Told()
    for _ in range(140):
        one.fly(0.7, seen=True)
        one.fly(2.0, seen=False)
    assert one.texts == [CORRECTED]


def test_a_clearing_has_nothing_to_see() -> None:
    one = Told()
    one.fly(300.0, seen=False, sees=False)
    assert one.told == []


def test_the_flight_log_has_it_and_the_operator_is_told() -> None:
    flown = mission(sensing={"sensor": "scan-1deg"})
    endpoint = Endpoint(flown, 3, sensors=sensors_of(flown), sensor_streams={"lidar": True})
    agent: Any = endpoint.agent
    agent.flight.vehicle.position = Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0))
    lines: list[str] = []
    said: list[Say] = []
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    log: Any = SimpleNamespace(line=lambda _, text: lines.append(text))
    status = agent.status
    agent.status = lambda now_s: replace(status(now_s), airborne=True)
    watch = ChangeLogger(log, endpoint, link, link, report=said.append)

    def fly(began_s: float) -> None:
        for k in range(round(2.0 * UNSEEN_S / TICK_S)):
            now_s = began_s + k * TICK_S
            if k % 2 == 0:
                agent.perception.integrate_scan(some_trunks(k // 2), agent.flight.vehicle.position, now_s, ())
            watch.log_changes(now_s, [])

    fly(10.0)
    assert said == [UNSEEN]
    agent.perception.motion.velocity_bias_ne_mps = (0.1, 0.0)
    for k in range(round(2.0 * AGAIN_S / TICK_S)):
        watch.log_changes(40.0 + k * TICK_S, [])
    assert lines == [CORRECTED]


def some_trunks(turn: int) -> LidarScan:
    return scan(tuple(5.0 if k % 90 in (10, 11) else float("inf") for k in range(360)), turn=turn)


def test_what_stands_within_the_sensors_range_is_seen() -> None:
    perception, here = (
        build_perception(mission(sensing={"sensor": "scan-1deg", "range_m": 12.0}), 3),
        Position((0.0, 0.0, -4.0), (0.0, 0.0, 0.0)),
    )
    assert not perception.sees_several(here)
    perception.integrate_scan(some_trunks(1), here, 10.0, ())
    assert perception.sees_several(here)
    assert not perception.sees_several(None)
    assert not perception.sees_several(Position((30.0, 0.0, -4.0), (0.0, 0.0, 0.0)))
    assert not build_perception(mission(), 3).sees_several(here)
