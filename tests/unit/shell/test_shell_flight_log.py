"""The flight log: a line for each change, and a flight that goes on when there is no room for it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import Any

import pytest

from companion.core.agent import Agent
from companion.core.model.actions import Say
from companion.core.model.beacon import Lease
from companion.core.model.events import Position
from companion.core.model.states import FlightState, Severity
from companion.mavlink import dialect
from companion.mavlink.autopilot_link.signing import LinkSigning
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.framing.signing import Gate
from companion.mavlink.packing import pack_ranges
from companion.mavlink.sensor_inputs import SensorInputs
from companion.sensors.table import sensors_of
from companion.shell.flight_log import COUNTERS_S, UNANSWERED_S, UNSIGNED, ChangeLogger, FlightLog
from mission.document.model import Mission
from tests.unit.core.core_kit import mission
from tests.unit.core.core_surroundings import surroundings
from tests.unit.core.ranging_kit import ranging_mission
from tests.unit.mavlink.endpoint_kit import heartbeat, packed

ATTITUDE: bytes = dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0).pack(
    dialect.MAVLink(None, srcSystem=3, srcComponent=1)
)


def scan_frame(system: int = 3) -> bytes:
    message = dialect.MAVLink_obstacle_distance_message(0, 0, [300] * 72, 5, 20, 800, 0, 0, 12)
    frame: bytes = message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=196))
    return frame


def ranges_frame(system: int = 3) -> bytes:
    message = dialect.MAVLink_swarm_ranges_message(0, list(pack_ranges([(1, 8.0, 0.0)])))
    frame: bytes = message.pack(dialect.MAVLink(None, srcSystem=system, srcComponent=158))
    return frame


def endpoint_of(flown: Mission, streams: Mapping[str, bool] = MappingProxyType({})) -> Endpoint:
    return Endpoint(flown, 3, sensors=sensors_of(flown), sensor_streams=streams)


@pytest.fixture
def log_file(tmp_path: Path) -> Iterator[tuple[FlightLog, Callable[[], list[str]]]]:
    path = tmp_path / "flight.log"
    fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    yield FlightLog(fd), lambda: path.read_text().splitlines()
    os.close(fd)


def test_a_line_is_there_at_once_with_its_time(log_file: tuple[FlightLog, Callable[[], list[str]]]) -> None:
    log, lines = log_file
    log.line(None, "start")
    log.line(12.3456, "later")
    assert lines() == ["[         -] start", "[    12.346] later"]


def test_text_from_outside_cannot_forge_lines(log_file: tuple[FlightLog, Callable[[], list[str]]]) -> None:
    log, lines = log_file
    log.line(1.0, "bad\n[     2.000] forged \x1b[2J" + "x" * 10_000)
    assert len(lines()) == 1
    assert len(lines()[0]) < 400
    assert lines()[0].isprintable()


def test_a_full_disk_loses_lines_and_counts_them() -> None:
    fd = os.open("/dev/full", os.O_WRONLY)
    log = FlightLog(fd)
    log.line(1.0, "one")
    log.line(2.0, "two")
    os.close(fd)
    assert log.lost == 2


def test_a_pipe_that_nobody_empties_does_not_stop_the_flight() -> None:
    far, near = os.pipe()  # blocking, as stderr is
    log = FlightLog(near)
    written = 0
    while not log.lost:
        log.line(0.0, "x" * 200)
        written += 1
    assert log.lost == 1
    os.read(far, 1 << 20)
    log.line(1.0, "again")
    log.line(2.0, "and on")
    lines = os.read(far, 1 << 20).decode().splitlines()
    assert lines == ["[     1.000] again (1 lines before this one were lost)", "[     2.000] and on"]
    os.close(far)
    log.line(3.0, "nobody reads")
    os.close(near)
    assert log.lost == 2


def test_a_broken_invariant_is_logged_in_full(log_file: tuple[FlightLog, Callable[[], list[str]]]) -> None:
    log, lines = log_file
    log.broken(3.0, "Traceback\n  line 1\nAssertionError\n")
    assert lines()[1:] == ["Traceback", "  line 1", "AssertionError"]


@pytest.fixture
def watched(
    log_file: tuple[FlightLog, Callable[[], list[str]]],
) -> tuple[Any, Any, ChangeLogger, Callable[[], list[str]]]:
    """An endpoint and its autopilot link, as far as a watch looks; the watch; its lines without their times."""
    log, lines = log_file
    endpoint: Any = SimpleNamespace(
        id=3,
        autopilot=SimpleNamespace(bad=0),
        autopilot_gate=Gate(takes_signed=True),
        peers=SimpleNamespace(without_beacon=0, guard=SimpleNamespace(refused={})),
        orders=SimpleNamespace(counters=dict),
        codec=SimpleNamespace(dropped=0, other_versions=0, has_answered=False),
        foreign_autopilots=frozenset(),
        sensors=SensorInputs((), 3, {}),
        records=None,
        survey=None,
        payload=None,
        agent=Agent(mission(), 3),
    )
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    peers: Any = SimpleNamespace(up=True, errors=0, lost=0)
    return endpoint, link, ChangeLogger(log, endpoint, link, peers), lambda: [line[13:] for line in lines()]


Watched = tuple[Any, Any, ChangeLogger, Callable[[], list[str]]]


def test_nothing_changes_nothing_is_logged(watched: Watched) -> None:
    _, _, watch, lines = watched
    for k in range(1000):
        watch.log_changes(k / 20, [])
    assert lines() == []


def test_changes_are_logged_once(watched: Watched) -> None:
    endpoint, link, watch, lines = watched
    endpoint.agent.flight.state = FlightState.READY
    watch.log_changes(0.0, [Say(Severity.NOTICE, "leader: vehicle 2")])
    endpoint.agent.swarm.election.lease = Lease(2, 9, 0, 0, established=True)
    watch.log_changes(0.1, [])
    endpoint.agent.swarm.election.lease = Lease(4, 1, 0, 0, established=False)
    watch.log_changes(0.2, [])
    endpoint.foreign_autopilots = frozenset({7})
    watch.log_changes(0.3, [])
    link.up = False
    watch.log_changes(0.4, [])
    watch.log_changes(0.5, [])
    link.up = True
    watch.log_links(None)
    watch.log_changes(0.6, [])
    assert lines() == [
        "notice: leader: vehicle 2",
        "state waiting -> ready",
        "leader lost (it was vehicle 2)",
        "the autopilot of vehicle 7 is on this link of vehicle 3: wrong --id?",
        "autopilot link lost: retrying",
        "autopilot link connected",
    ]


def test_growing_counters_are_logged_every_ten_seconds_at_most(watched: Watched) -> None:
    endpoint, _, watch, lines = watched
    for k in range(int(COUNTERS_S * 20 * 2)):
        endpoint.peers.without_beacon += 1
        watch.log_changes(k / 20, [])
    assert len(lines()) == 2
    assert "of the peers without a beacon 201" in lines()[1]


def lines_of(lines: Callable[[], list[str]]) -> list[str]:
    return [line.split("] ")[1] for line in lines()]


def test_range_radio_of_another_system_is_named_once(log_file: tuple[FlightLog, Callable[[], list[str]]]) -> None:
    log, lines = log_file
    endpoint = endpoint_of(ranging_mission())
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log, endpoint, link, link)
    for k in range(3):
        endpoint.from_sensor(ranges_frame(system=7), k / 20)
        watch.log_changes(k / 20, [])
    assert endpoint.sensors.foreign("ranges") == {7}
    assert lines_of(lines) == [
        "range radio of system 7 is on a link of vehicle 3, and is not heard: its driver's system id must be 3"
    ]


def test_range_radio_whose_link_or_driver_drops_is_logged_and_counted(
    log_file: tuple[FlightLog, Callable[[], list[str]]],
) -> None:
    log, lines = log_file
    endpoint = endpoint_of(ranging_mission(), {"ranges": True})
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    radio: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log, endpoint, link, link, {"ranges": radio})
    for k in range(240):
        if k < 10 or k > 200:
            endpoint.from_sensor(ranges_frame(), k / 20, "ranges")
        watch.log_changes(k / 20, [])
    radio.up, radio.errors = False, 1
    watch.log_changes(12.0, [])
    assert "no range radio's link" in watch.status_line()
    radio.up = True
    watch.log_changes(12.05, [])
    assert [line for line in lines_of(lines) if not line.startswith("bad frames")] == [
        "range radio 158 (component): heard",
        "range radio 158 (component): lost: no range that is fresh",
        "range radio 158 (component): heard again",
        "range radio's link lost: retrying",
        "range radio's link connected",
    ]
    assert watch.counters()["errors of the range radio's link"] == 1
    assert watch.counters()["times range radio lost"] == 1


def test_sensor_that_is_heard_lost_and_heard_again_is_told_each_time(
    log_file: tuple[FlightLog, Callable[[], list[str]]],
) -> None:
    log, lines = log_file
    endpoint = endpoint_of(mission(sensing={"stale_s": 0.3}), {"obstacles": False})
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    sensor: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log, endpoint, link, link, {"obstacles": sensor})
    for k in range(40):
        if k < 10 or k > 30:
            endpoint.from_autopilot(ATTITUDE, k / 20)
            endpoint.from_sensor(scan_frame(), k / 20, "obstacles")
        endpoint.tick(k / 20)
        watch.log_changes(k / 20, [])
    endpoint.from_sensor(scan_frame(system=7), 2.0)
    watch.log_changes(2.0, [])
    sensor.up = False
    watch.log_changes(2.05, [])
    assert [line for line in lines_of(lines) if "sensor" in line] == [
        "obstacle sensor 196 (component): heard",
        "obstacle sensor 196 (component): lost: no scan that is fresh",
        "obstacle sensor 196 (component): heard again",
        "obstacle sensor of system 7 is on a link of vehicle 3, and is not heard: its driver's system id must be 3",
        "obstacle sensor's link lost: retrying",
    ]
    assert "no obstacle sensor's link" in watch.status_line()
    assert "cut by" not in watch.status_line()
    assert {"scans refused", "scans without attitude", "errors of the obstacle sensor's link"} <= set(watch.counters())


def test_status_says_what_the_safety_filter_cuts_of_the_desired_velocity(
    log_file: tuple[FlightLog, Callable[[], list[str]]],
) -> None:
    endpoint = Endpoint(mission(), 3)
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log_file[0], endpoint, link, link)
    own = Position((0.0, 0.0, -10.0), (0.0, 0.0, 0.0))
    endpoint.agent.setpoint = endpoint.agent.safety_filter.apply((30.0, 0.0, 0.0), surroundings(own), dt_s=9.0)
    assert watch.status_line().endswith(", setpoint cut by: speed limits 25.0 m/s")


def test_how_far_the_records_are_is_logged_once_a_minute(watched: Watched) -> None:
    counts = {"records heard of": 0}
    endpoint, _, watch, lines = watched
    endpoint.records = SimpleNamespace(counters=lambda: counts)
    for now_s in range(70):
        counts["records heard of"] = now_s
        watch.log_changes(float(now_s), [])
    assert [line for line in lines() if line.startswith("records")] == ["records heard of 0", "records heard of 60"]


def test_an_error_that_stopped_the_survey_is_logged_once(watched: Watched) -> None:
    endpoint, _, watch, lines = watched
    endpoint.survey = SimpleNamespace(error="")
    watch.log_changes(1.0, [])
    assert not [line for line in lines() if "survey" in line]
    endpoint.survey.error = "ValueError: nothing to fit (surveyor.py:1 in take_records)"
    watch.log_changes(2.0, [])
    watch.log_changes(3.0, [])
    stopped = [line for line in lines() if "survey" in line]
    assert stopped == [f"survey stopped, the flight goes on: {endpoint.survey.error}"]


def statustexts(data: bytes) -> list[tuple[int, str]]:
    """Severity and text of each."""
    parsed = dialect.MAVLink(None).parse_buffer(data) or []
    return [(m.severity, m.text.rstrip("\0")) for m in parsed if m.get_type() == "STATUSTEXT"]


@pytest.mark.sources
def test_a_flood_is_told_to_the_operator_with_the_beacons_that_are_lost(
    log_file: tuple[FlightLog, Callable[[], list[str]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    log, lines = log_file
    endpoint = endpoint_of(mission())
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    peers: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log, endpoint, link, peers)
    heard = [SimpleNamespace(beacon=SimpleNamespace(sender=k), share=share) for k, share in ((1, 1.0), (2, 0.43))]
    status = endpoint.agent.status(0.0)
    monkeypatch.setattr(endpoint.agent, "localiser", SimpleNamespace(neighbours=heard))
    monkeypatch.setattr(endpoint.agent, "status", lambda _now_s: status)
    told: list[Say] = []
    monkeypatch.setattr(endpoint, "report_surroundings", told.append)
    for second in range(9):
        peers.lost += 4120 if second == 1 else 0
        watch.log_changes(float(second), [])
    assert told == [
        Say(Severity.WARNING, "peers' link flooded: 4120 lost unread"),
        Say(Severity.WARNING, "vehicle 2's beacons: 57 % lost"),
        Say(Severity.NOTICE, "peers' link flood over: 4120 lost unread"),
    ]
    assert "beacons that arrive: 1 100 %, 2 43 %" in lines_of(lines)


def test_what_is_told_goes_to_the_operator_with_the_next_tick() -> None:
    endpoint = endpoint_of(mission())
    endpoint.tick(10.0)
    endpoint.report_surroundings(Say(Severity.WARNING, "peers' link flooded: 4120 lost unread"))
    out = endpoint.tick(10.05)
    assert (4, "peers' link flooded: 4120 lost unread") in statustexts(out.autopilot)
    assert Say(Severity.WARNING, "peers' link flooded: 4120 lost unread") in out.said
    assert statustexts(endpoint.tick(10.1).autopilot) == []


@pytest.mark.parametrize(
    ("signs", "answers", "has_key", "told"),
    [
        (True, False, False, [UNSIGNED]),
        (True, True, False, []),  # as PX4 whose key is missing: it takes all
        (False, False, False, []),
        (True, False, True, []),  # what is amiss with a key the counters of its gate say
    ],
)
def test_autopilot_that_takes_only_what_is_signed_is_told_once(
    log_file: tuple[FlightLog, Callable[[], list[str]]], signs: bool, answers: bool, has_key: bool, told: list[str]
) -> None:
    log, lines = log_file
    theirs = LinkSigning(bytes(32))
    endpoint = Endpoint(mission(), 3, autopilot_gate=LinkSigning(bytes(32)) if has_key else None)
    link: Any = SimpleNamespace(up=True, errors=0, lost=0)
    watch = ChangeLogger(log, endpoint, link, link)
    for k in range(round(3.0 * UNANSWERED_S * 20)):
        now_s = 100.0 + k / 20
        frames = [packed(heartbeat())]
        if answers:
            frames.append(packed(dialect.MAVLink_timesync_message(k + 1, round(now_s * 1e9))))
        endpoint.from_autopilot(b"".join([theirs.seal(frame, now_s) if signs else frame for frame in frames]), now_s)
        watch.log_changes(now_s, endpoint.tick(now_s).said)
    assert [line for line in lines_of(lines) if "sign" in line] == told
