"""Streams of the autopilot at another's rate: those of its parameters, or as a ground station has asked."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from companion.core.agent import TICK_HZ
from companion.mavlink import dialect
from companion.mavlink.endpoint import Endpoint
from companion.mavlink.streams import RATE_WINDOW_S, SLOW_TOLD, STREAMS_RETRY_S
from tests.unit.mavlink.endpoint_kit import FLOWING, HOME, TICK_S, endpoint, heartbeat, ids, packed, position, read

ORIGIN = dialect.MAVLink_gps_global_origin_message(470_000_000, 80_000_000, 400_000, 0)
POSITION_ID, SET_INTERVAL = dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, dialect.MAV_CMD_SET_MESSAGE_INTERVAL
NOTICED_S = RATE_WINDOW_S + STREAMS_RETRY_S  # it is looked at no more often than every 2 s


class Autopilot:
    """Its position comes as fast as was asked last, all else as it is wanted."""

    def __init__(self, one: Endpoint, rate_hz: float, *, obeys: bool = True) -> None:
        self.rate_hz = rate_hz
        self._obeys = obeys
        self._one = one
        self._next_s = self.now_s = 10.0
        self.asked_s: list[float] = []  # for positions
        self.said: list[str] = []
        one.from_autopilot(packed(HOME, ORIGIN, heartbeat()), self.now_s)

    def run(self, seconds: float, heard: Callable[[int], bool] = lambda _: True) -> None:
        """`heard`: whether what is sent in a tick arrives."""
        for k in range(round(seconds / TICK_S)):
            if self.now_s >= self._next_s - 1e-6:
                self._next_s = max(self._next_s + 1.0 / self.rate_hz, self.now_s)
                if heard(k):
                    self._one.from_autopilot(packed(position(boot_ms=round(self.now_s * 1e3))), self.now_s)
            self._one.from_autopilot(packed(*FLOWING[1:]), self.now_s)
            out = self._one.tick(self.now_s)
            self.said += [say.text for say in out.said if "Hz" in say.text]
            for m in read(out.autopilot):
                if m.get_type() == "COMMAND_LONG" and (m.command, m.param1) == (SET_INTERVAL, POSITION_ID):
                    self.asked_s.append(self.now_s)
                    if self._obeys:
                        self.rate_hz = 1e6 / m.param2
            self.now_s += TICK_S


@pytest.mark.parametrize("rate_hz", [1.0, 4.0, 15.0])
def test_a_stream_that_comes_too_slowly_from_the_start_is_asked_for(rate_hz: float) -> None:
    autopilot = Autopilot(endpoint(), rate_hz)
    autopilot.run(30.0)
    assert len(autopilot.asked_s) == 1
    assert autopilot.asked_s[0] <= 10.0 + NOTICED_S
    assert (autopilot.rate_hz, autopilot.said) == (TICK_HZ, [])


def test_a_rate_that_a_ground_station_has_lowered_is_asked_for_anew() -> None:
    autopilot = Autopilot(endpoint(), TICK_HZ)
    autopilot.run(20.0)
    for _ in range(3):
        autopilot.rate_hz, lowered_s = 3.0, autopilot.now_s
        autopilot.run(20.0)
        assert autopilot.rate_hz == TICK_HZ
        assert lowered_s < autopilot.asked_s[-1] <= lowered_s + 2.0 * NOTICED_S
    assert (len(autopilot.asked_s), autopilot.said) == (3, [])


def test_one_that_stays_slow_is_told_once_and_not_asked_for_more_often_than_one_that_is_silent() -> None:
    autopilot = Autopilot(endpoint(), 4.0, obeys=False)
    autopilot.run(120.0)
    between_s = [later - before for before, later in zip(autopilot.asked_s, autopilot.asked_s[1:], strict=False)]
    assert min(between_s) >= RATE_WINDOW_S > STREAMS_RETRY_S
    assert len(between_s) > SLOW_TOLD
    assert autopilot.said == ["LOCAL_POSITION_NED comes at 4 Hz, not 20, though asked for"]


def test_a_tenth_of_the_frames_lost_is_no_slow_stream() -> None:
    autopilot = Autopilot(endpoint(), TICK_HZ)
    autopilot.run(60.0, lambda k: k % 10 != 5)
    assert (autopilot.asked_s, autopilot.said) == ([], [])


def test_a_state_that_comes_once_a_second_is_not_asked_for() -> None:
    """Of a receiver that measures once a second no more are to be had."""
    one = endpoint()
    one.from_autopilot(packed(HOME, ORIGIN, heartbeat()), 10.0)
    for k in range(400):
        one.from_autopilot(packed(*FLOWING if k % 20 == 0 else FLOWING[:1]), 10.0 + k * TICK_S)
        assert "COMMAND_LONG" not in ids(one.tick(10.0 + k * TICK_S).autopilot)
