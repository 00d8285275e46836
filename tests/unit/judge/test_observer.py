"""When a flight is over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion.core.model.states import FlightState, SwarmPhase
from companion.mavlink.framing import texts, wire
from mission.common.forming import FORMING_LIMIT_S
from mission.common.frames import Vec3
from mission.document.model import Mission
from sim_bridge.judge.observer import LEFT_LIMIT_S, Observer, time_limit_s
from tests.unit.judge.tick_kit import a_tick

FLYING, DOWN = dict.fromkeys((1, 2, 3), True), dict.fromkeys((1, 2, 3), False)


def a_mission(at_end: str, **changes: Any) -> Mission:
    route = {"d1_enu_m": (0.0, 0.0, 10.0), "d2_enu_m": (50.0, 0.0, 10.0), "vel_leader_mps": 2.0, "at_end": at_end}
    route |= changes
    return Mission.model_validate(
        {"schema": 1, "route": route, "swarm": {"size": 3}, "coverage": {"duration_s": 20.0, "radius_m": 8.0}}
    )


class Watched:
    """An observer, and what the companions have said: the same of all three vehicles, 1 leads."""

    def __init__(self, folder: Path, at_end: str, **route: Any) -> None:
        self.said: dict[int, Any] = {}
        self.observer = Observer(a_mission(at_end, **route), (1, 2, 3), folder)

    def announce(self, phase: SwarmPhase, state: FlightState = FlightState.TRANSIT, *, stop: int = 0) -> None:
        self.said = {
            k: SimpleNamespace(swarm_phase=phase, stop=stop, acting_leader=1, leader=1, flight_state=state)
            for k in (1, 2, 3)
        }

    def finished(
        self,
        now_s: float,
        armed: dict[int, bool],
        alive: tuple[int, ...] = (1, 2, 3),
        places: tuple[Vec3, ...] | None = None,
    ) -> str | None:
        changes: dict[str, Any] = {} if places is None else {"pos_ned_m": places, "on_ground": (False,) * 3}
        return self.observer.finished(
            a_tick(now_s, armed=tuple(armed.values()), alive=alive, said=self.said, **changes)
        )


@pytest.fixture
def lands(tmp_path: Path) -> Iterator[Watched]:
    watched = Watched(tmp_path, "land")
    yield watched
    watched.observer.close()


@pytest.fixture
def holds(tmp_path: Path) -> Iterator[Watched]:
    watched = Watched(tmp_path, "hold")
    yield watched
    watched.observer.close()


def test_all_landed_when_nobody_is_armed_in_the_last_phase(lands: Watched) -> None:
    lands.announce(SwarmPhase.LAND, FlightState.LANDING)
    assert lands.finished(10.0, {**DOWN, 2: True}) is None
    assert lands.finished(11.0, DOWN) == "all landed"


def test_a_vehicle_whose_companion_is_dead_is_waited_for(lands: Watched) -> None:
    lands.announce(SwarmPhase.LAND, FlightState.LANDING)
    assert lands.finished(10.0, {**DOWN, 3: True}, alive=(1, 2)) is None
    assert lands.finished(10.0 + LEFT_LIMIT_S - 1.0, DOWN, alive=(1, 2)) == "all landed"


def test_a_vehicle_that_hangs_in_the_air_for_ever_ends_the_flight_by_name(lands: Watched) -> None:
    lands.announce(SwarmPhase.LAND, FlightState.LANDING)
    assert lands.finished(5.0, FLYING, alive=(1, 2)) is None
    assert lands.finished(10.0, {**DOWN, 3: True}, alive=(1, 2)) is None
    assert lands.finished(9.9 + LEFT_LIMIT_S, {**DOWN, 3: True}, alive=(1, 2)) is None
    assert lands.finished(10.0 + LEFT_LIMIT_S, {**DOWN, 3: True}, alive=(1, 2)) == "all landed but 3"


def test_the_wait_starts_anew_when_one_of_the_living_is_armed_again(lands: Watched) -> None:
    lands.announce(SwarmPhase.LAND, FlightState.LANDING)
    lands.finished(10.0, {**DOWN, 3: True}, alive=(1, 2))
    lands.finished(20.0, {**DOWN, 2: True, 3: True}, alive=(1, 2))
    assert lands.finished(11.0 + LEFT_LIMIT_S, {**DOWN, 3: True}, alive=(1, 2)) is None


@pytest.mark.parametrize("at_end", ["land", "hold"])
def test_those_that_gave_up_and_landed_before_the_last_phase_end_the_flight(at_end: str, tmp_path: Path) -> None:
    watched = Watched(tmp_path, at_end)
    watched.announce(SwarmPhase.GATHER, FlightState.READY)
    assert watched.finished(1.0, DOWN) is None  # not yet armed
    watched.announce(SwarmPhase.GATHER, FlightState.LANDED)
    assert watched.finished(90.0, {**DOWN, 1: True}) is None
    assert watched.finished(91.0, DOWN) == "all landed"
    watched.observer.close()


def around_d2(*bearings_deg: float, radius_m: float = 8.0) -> tuple[Vec3, ...]:
    angles = [math.radians(bearing) for bearing in bearings_deg]
    return tuple((radius_m * math.cos(a), 50.0 + radius_m * math.sin(a), -10.0) for a in angles)


EVEN, TORN = around_d2(0.0, 120.0, 240.0), around_d2(0.0, 60.0, 120.0)


def test_a_mission_that_holds_ends_with_its_time_in_coverage(holds: Watched) -> None:
    holds.announce(SwarmPhase.COVERAGE, FlightState.COVERAGE)
    for now_s in (30.0, 45.0, 49.9):
        assert holds.finished(now_s, FLYING, places=EVEN) is None
    assert holds.finished(50.0, FLYING, places=EVEN) == "coverage complete"


@pytest.mark.parametrize("not_formed", [TORN, around_d2(0.0, 120.0, 240.0, radius_m=11.0)])
def test_a_ring_that_is_torn_when_the_time_is_up_has_time_to_form(holds: Watched, not_formed: tuple[Vec3, ...]) -> None:
    holds.announce(SwarmPhase.COVERAGE, FlightState.COVERAGE)
    assert holds.finished(30.0, FLYING, places=EVEN) is None
    assert holds.finished(48.0, FLYING, places=not_formed) is None
    assert holds.finished(53.0, FLYING, places=EVEN) is None  # the verdict looks at 5 s, with both their ends
    assert holds.finished(53.05, FLYING, places=EVEN) == "coverage complete"


def test_a_ring_that_never_forms_ends_a_while_after_the_last_change(holds: Watched) -> None:
    holds.announce(SwarmPhase.COVERAGE, FlightState.COVERAGE)
    holds.finished(30.0, FLYING, places=TORN)
    assert holds.finished(70.0, FLYING, places=TORN, alive=(1, 2)) is None
    assert holds.finished(69.9 + FORMING_LIMIT_S, FLYING, places=TORN, alive=(1, 2)) is None
    assert holds.finished(70.0 + FORMING_LIMIT_S, FLYING, places=TORN, alive=(1, 2)) == "coverage complete"


def test_an_abort_in_coverage_is_no_completed_coverage(holds: Watched) -> None:
    holds.announce(SwarmPhase.COVERAGE, FlightState.COVERAGE)
    holds.finished(30.0, FLYING)
    holds.announce(SwarmPhase.LAND, FlightState.LANDING)
    assert holds.finished(50.0, FLYING) is None
    assert holds.finished(55.0, DOWN) == "all landed"


def test_without_companions_or_time_the_flight_is_over(lands: Watched) -> None:
    assert lands.finished(1.0, FLYING, alive=()) == "no companion left"
    ended = lands.finished(1e6, FLYING)
    assert ended is not None
    assert ended.startswith("time limit of")


def test_a_long_word_of_a_companion_is_shown_whole_though_others_speak_between_its_chunks(lands: Watched) -> None:
    missing = "hold: no quorum, without " + ", ".join(map(str, range(9, 26)))
    first, last = (wire.pack(m, seq=0, system=1, component=191) for m in texts.encode(4, missing, 1))
    lands.observer.log_traffic(1.0, 1, b"", first)
    lands.observer.log_traffic(1.0, 2, b"", wire.pack(texts.encode(4, "ready", 1)[0], seq=0, system=2, component=191))
    lands.observer.log_traffic(1.05, 1, b"", last)
    assert lands.observer.events == [(1.0, "vehicle 2: ready"), (1.05, f"vehicle 1: {missing}")]


def say(observer: Observer, now_s: float, text: str, *vehicles: int) -> None:
    """These say it then; the tick before has been looked at."""
    observer.finished(a_tick(now_s))
    for k in vehicles:
        said = wire.pack(texts.encode(k, text, 1)[0], seq=0, system=k, component=191)
        observer.log_traffic(now_s, k, b"", said)


def test_of_a_text_that_several_say_one_is_shown_at_once_and_all_others_by_number() -> None:
    observer = Observer(a_mission("land"), range(1, 9), None)
    say(observer, 10.0, "to layer 2.4 m: no quorum", 5)
    say(observer, 11.0, "to layer 2.4 m: no quorum", 1, 2, 5)
    say(observer, 13.0, "to layer 2.4 m: no quorum", 6, 8, 7)
    say(observer, 13.5, "searching for lost peers", 6)
    assert observer.events == [
        (10.0, "vehicle 5: to layer 2.4 m: no quorum"),
        (13.5, "vehicle 6: searching for lost peers"),
    ]
    observer.finished(a_tick(15.0))
    assert observer.events[2:] == [(15.0, "vehicles 1, 2, 6 to 8 also: to layer 2.4 m: no quorum")]
    say(observer, 15.1, "to layer 2.4 m: no quorum", 4)  # later: another moment
    say(observer, 17.0, "to layer 2.4 m: no quorum", 3, 4)
    assert observer.events[3:] == [(15.1, "vehicle 4: to layer 2.4 m: no quorum")]
    observer.close()  # nothing is left unsaid
    assert observer.events[4:] == [(17.0, "vehicle 3 also: to layer 2.4 m: no quorum")]


def test_a_vehicle_that_repeats_itself_is_shown_once(lands: Watched) -> None:
    for tenth in range(0, 100, 15):
        say(lands.observer, 0.1 * tenth, "takeoff not answered", 2)
    assert lands.observer.events == [(0.0, "vehicle 2: takeoff not answered")]
    say(lands.observer, 30.0, "takeoff not answered", 2)
    assert len(lands.observer.events) == 2


def test_status_counts_links_within_both_ranges_and_shows_the_closest_pair(lands: Watched) -> None:
    lands.announce(SwarmPhase.TRANSIT)
    tick = a_tick(
        7.0,
        pos_ned_m=((0.0, 0.0, -10.0), (0.0, 20.0, -10.0), (0.0, 45.0, -10.0)),
        range_m=(20.0, 30.0, 24.9),
        said=lands.said,
    )
    status = lands.observer.status(tick, 3.0)
    assert (status.links, status.separation_m, status.leader, status.phase) == (1, 20.0, 1, "transit")
    assert status.to_go_m == 50.0


def test_status_of_a_single_vehicle_has_no_pair(tmp_path: Path) -> None:
    watched = Watched(tmp_path, "land")
    status = watched.observer.status(a_tick(0.0, n=1), 1.0)
    assert (status.links, status.separation_m, status.leader, status.to_go_m) == (0, None, None, None)
    watched.observer.close()


def test_a_mission_of_two_trees_ends_with_its_time_at_the_second(tmp_path: Path) -> None:
    watched = Watched(tmp_path, "hold", stops=[{"pos_enu_m": (50.0, 50.0, 10.0), "duration_s": 5.0}])
    watched.announce(SwarmPhase.COVERAGE)
    assert watched.finished(10.0, FLYING) is None
    assert watched.finished(100.0, FLYING) is None
    watched.announce(SwarmPhase.TRANSIT, stop=1)
    assert watched.finished(101.0, FLYING) is None
    watched.announce(SwarmPhase.COVERAGE, stop=1)
    assert watched.finished(120.0, FLYING, places=EVEN) is None
    assert watched.finished(139.0, FLYING, places=EVEN) is None
    assert watched.finished(140.0, FLYING, places=EVEN) is not None
    watched.observer.close()


def test_time_at_every_tree_counts_for_the_time_limit() -> None:
    stops = [{"pos_enu_m": (25.0, 0.0, 10.0), "duration_s": 500.0}]
    assert time_limit_s(a_mission("hold", stops=stops)) == pytest.approx(time_limit_s(a_mission("hold")) + 500.0)
