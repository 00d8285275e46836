"""The local frame of an autopilot that has started again elsewhere, and an origin that home contradicts."""

from __future__ import annotations

from typing import Any

import pytest

from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.streams import FRAME_TRIES, STREAMS_RETRY_S
from mission.common.frames import LocalFrame, Wgs84
from tests.unit.core.core_kit import mission
from tests.unit.mavlink.endpoint_kit import FLOWING, ME, TICK_S, endpoint, heartbeat, packed, position, read

FRAME = LocalFrame(Wgs84(47.0, 8.0, 400.0))
ORIGIN_ID, HOME_ID = dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, dialect.MAVLINK_MSG_ID_HOME_POSITION
START, ELSEWHERE = (0.0, 0.0, 0.0), (25.0, 10.0, 0.0)
UP_S = 300.0  # the autopilot, when the test begins


def degrees(place_ned_m: tuple[float, float, float]) -> tuple[int, int, int]:
    at = FRAME.to_wgs84(place_ned_m)
    return round(at.lat_deg * 1e7), round(at.lon_deg * 1e7), round(at.alt_m * 1e3)


def origin(place_ned_m: tuple[float, float, float]) -> Any:
    return dialect.MAVLink_gps_global_origin_message(*degrees(place_ned_m), 0)


def home(place_ned_m: tuple[float, float, float], local: tuple[float, float, float] = START) -> Any:
    return dialect.MAVLink_home_position_message(*degrees(place_ned_m), *local, [1, 0, 0, 0], 0, 0, 0)


class Link:
    """One companion and what it asks its autopilot for, which stands at (1, 0, -8) in its own frame."""

    def __init__(self, one: Endpoint | None = None) -> None:
        self.one = one or endpoint()
        self.now_s = 100.0
        self.boot_s = UP_S
        self.asked: list[tuple[float, int]] = []  # (s, message) of single requests
        self.one.from_autopilot(packed(heartbeat()), self.now_s)

    def run(self, seconds: float, *messages: Any) -> None:
        """`messages`: with the first tick, before its position."""
        for k in range(round(seconds / TICK_S)):
            said = (*(messages if k == 0 else ()), position(boot_ms=round(self.boot_s * 1e3)), *FLOWING[1:])
            self.one.from_autopilot(packed(*said), self.now_s)
            for m in read(self.one.tick(self.now_s).autopilot):
                if m.get_type() == "COMMAND_LONG" and m.command == dialect.MAV_CMD_REQUEST_MESSAGE:
                    self.asked.append((self.now_s, int(m.param1)))
            self.now_s += TICK_S
            self.boot_s += TICK_S

    def restart(self) -> None:
        """It is silent for 6 s, and then 5 s old."""
        self.now_s, self.boot_s = self.now_s + 6.0, 5.0

    @property
    def north_east_m(self) -> tuple[float, float] | None:
        """Of the last position that may be flown by."""
        vehicle = self.one.agent.flight.vehicle
        if vehicle.position is None or vehicle.position_missing(self.now_s):
            return None
        return vehicle.position.pos_ned_m[0], vehicle.position.pos_ned_m[1]


def test_an_autopilot_that_started_again_elsewhere_is_asked_for_its_frame_at_once() -> None:
    """It was carried there without power. Its one GPS_GLOBAL_ORIGIN is lost."""
    link = Link()
    link.run(10.0, home(START), origin(START))
    assert (link.asked, link.north_east_m) == ([], pytest.approx((1.0, 0.0), abs=0.01))
    link.restart()
    began_s = link.now_s
    link.run(1.0)
    assert {message_id for _, message_id in link.asked} == {ORIGIN_ID, HOME_ID}
    assert link.asked[0][0] <= began_s + 4 * TICK_S
    assert link.north_east_m is None  # of the old frame it knows nothing any more
    link.asked.clear()
    link.run(10.0, origin(ELSEWHERE), home(ELSEWHERE))
    assert (link.asked, link.north_east_m) == ([], pytest.approx((26.0, 10.0), abs=0.01))


def test_home_alone_stands_in_for_the_frame_of_one_that_started_again() -> None:
    link = Link()
    link.run(10.0, home(START), origin(START))
    link.restart()
    link.run(1.0)
    link.run(30.0, home(ELSEWHERE))
    assert link.north_east_m == pytest.approx((26.0, 10.0), abs=0.01)
    assert [message_id for now_s, message_id in link.asked if now_s > 117.0] == [ORIGIN_ID] * FRAME_TRIES


@pytest.mark.parametrize(("back_s", "in_a_row"), [(1.0, 6), (250.0, 2)])
def test_stray_frames_of_an_earlier_time_are_no_start_anew(back_s: float, in_a_row: int) -> None:
    link = Link()
    link.run(10.0, home(START), origin(START))
    for k in range(22):
        stray = position(boot_ms=round((link.boot_s - back_s) * 1e3))
        link.run(1.0, *[stray] * (k % (in_a_row + 1)))
    assert (link.one.codec.reboots, link.asked) == (0, [])
    assert link.north_east_m == pytest.approx((1.0, 0.0), abs=0.01)


def test_tries_are_not_used_up_while_there_is_no_fix() -> None:
    link = Link()
    link.run(60.0)
    assert len(link.asked) > 2 * FRAME_TRIES
    link.asked.clear()
    link.run(30.0, home(START))
    assert [message_id for _, message_id in link.asked] == [ORIGIN_ID] * FRAME_TRIES


def test_an_origin_that_home_contradicts_is_asked_for_and_what_is_told_counts() -> None:
    link = Link()
    link.run(10.0, home(START), origin(START))
    contradicted_s = link.now_s
    link.run(3.0, home(ELSEWHERE, (2.0, 0.0, 0.0)))
    assert link.asked[0] == (pytest.approx(contradicted_s, abs=STREAMS_RETRY_S + TICK_S), ORIGIN_ID)
    assert link.north_east_m == pytest.approx((1.0, 0.0), abs=0.01)  # until it has answered
    link.asked.clear()
    link.run(10.0, origin((23.0, 10.0, 0.0)))
    assert (link.asked, link.north_east_m) == ([], pytest.approx((24.0, 10.0), abs=0.01))


def test_an_origin_that_is_told_again_is_believed_whatever_home_says() -> None:
    """A make that tells no home in its local frame: 0, 0, 0."""
    link = Link()
    link.run(10.0, origin(START), home(START))
    link.run(3.0, home(ELSEWHERE))
    assert {message_id for _, message_id in link.asked} == {ORIGIN_ID}
    link.asked.clear()
    link.run(1.0, origin(START))
    for _ in range(30):
        link.run(2.0, home(ELSEWHERE))
    assert (link.asked, link.north_east_m) == ([], pytest.approx((1.0, 0.0), abs=0.01))


def test_a_doubt_that_is_not_answered_is_asked_about_a_few_times_only() -> None:
    link = Link()
    link.run(10.0, origin(START), home(START))
    for _ in range(30):
        link.run(2.0, home(ELSEWHERE))
    assert [message_id for _, message_id in link.asked] == [ORIGIN_ID] * FRAME_TRIES


def test_a_vehicle_without_satellites_keeps_its_frame_whatever_starts_again() -> None:
    start_enu_m = [[8.0 * k, 0.0, 0.0] for k in range(4)]
    swarm = {"size": 4, "gnss": "leader", "leader_priority": [1]}
    link = Link(Endpoint(mission(swarm=swarm, ranging={"start_enu_m": start_enu_m}), ME))
    link.run(5.0)
    before = link.north_east_m
    link.restart()
    link.run(5.0)
    assert before is not None
    assert link.north_east_m == before
