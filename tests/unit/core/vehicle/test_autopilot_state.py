"""What the autopilot told, and how old it is: silence, late telemetry, restarts, wraps, clocks that drift."""

from __future__ import annotations

import pytest

from companion.core.model.events import AutopilotHealth, AutopilotMode, AutopilotText, BootTime, Landed, Position
from companion.core.model.states import FlightMode, LandedState
from companion.core.vehicle import failsafe_engine
from companion.core.vehicle.autopilot_state import GAP_S, LANDED_OLD_S, WRAP_S, Delay, Vehicle
from companion.core.vehicle.failsafe import Cause, Readings, Source
from companion.mavlink.makes.px4 import PX4

GAP_SHOWN_S = failsafe_engine.row(Cause.SETPOINTS_CUT).lingers_s
IN_TIME_S = failsafe_engine.row(Cause.TELEMETRY_LATE).clear_below_s
LATE_S = failsafe_engine.row(Cause.TELEMETRY_LATE).delay_s
POSITION_LOST_S = failsafe_engine.row(Cause.NO_POSITION).delay_s
SILENT_S = failsafe_engine.row(Cause.AUTOPILOT_SILENT).delay_s

FRAME_S = 0.05
ZERO = (0.0, 0.0, 0.0)


class Telemetry:
    """Frames every 50 ms of the local clock, stamped by a clock that was started at `boot_at_s`."""

    def __init__(self, boot_at_s: float = -100.0) -> None:
        self.delay = Delay()
        self.now_s = 1000.0
        self.boot_at_s = boot_at_s
        self.late_s = 0.0
        self.rate = 1.0  # of the autopilot's clock

    def frames(self, seconds: float, *, late_s: float | None = None) -> list[bool]:
        """Whether each was believed."""
        self.late_s = self.late_s if late_s is None else late_s
        believed = []
        for _ in range(round(seconds / FRAME_S)):
            self.now_s += FRAME_S
            self.boot_at_s += (1.0 - self.rate) * FRAME_S
            believed.append(self.delay.accept_time(self.boot_s % WRAP_S, self.now_s))
        return believed

    @property
    def boot_s(self) -> float:
        return self.now_s - self.late_s - self.boot_at_s

    def restart(self, now_s: float) -> None:
        self.now_s = self.boot_at_s = now_s


def test_telemetry_in_time_is_not_late_however_the_clocks_are_set() -> None:
    for boot_at_s in (-100.0, 999.0, 5000.0):
        told = Telemetry(boot_at_s)
        assert all(told.frames(60.0))
        assert (told.delay.late, told.delay.late_s) == (False, pytest.approx(0.0, abs=1e-3))


@pytest.mark.parametrize("late_s", [LATE_S + 0.1, 1.5, 30.0])
def test_telemetry_that_gets_late_is_noticed_within_half_a_second_and_not_forgotten_in_a_flight(late_s: float) -> None:
    told = Telemetry()
    told.frames(10.0)
    told.frames(0.5, late_s=late_s)
    assert told.delay.late
    assert told.delay.late_s == pytest.approx(late_s, abs=0.06)
    if late_s >= 1.5:
        told.frames(900.0)
        assert told.delay.late


def test_backlog_that_grows_frame_by_frame_is_noticed() -> None:
    told = Telemetry()
    told.frames(10.0)
    for k in range(1, 16):
        told.frames(FRAME_S, late_s=0.03 * k)
    assert told.delay.late


def test_on_the_edge_it_does_not_flutter() -> None:
    told = Telemetry()
    told.frames(1.0)
    seen = []
    for late_s in (LATE_S + 0.02, LATE_S - 0.02, LATE_S + 0.02, IN_TIME_S - 0.02, LATE_S - 0.02):
        told.frames(0.3, late_s=late_s)
        seen.append(told.delay.late)
    assert seen == [True, True, True, False, False]


@pytest.mark.parametrize("ppm", [-200, 200])
def test_clocks_that_drift_are_not_late(ppm: int) -> None:
    told = Telemetry()
    told.rate = 1.0 + ppm * 1e-6
    told.frames(1800.0)
    assert told.delay.late_s < 0.01


@pytest.mark.parametrize("rate", [0.3, 0.9, 20.0])
def test_simulator_slower_or_faster_than_real_time_is_not_late_when_it_answers_in_time(rate: float) -> None:
    told = Telemetry()
    told.rate = rate
    late = []
    for _ in range(30):
        told.frames(1.0)
        told.delay.bound(BootTime(told.boot_s, 0.02), told.now_s)
        told.frames(FRAME_S)
        late.append(told.delay.late)
    assert not any(late)


def test_answers_that_are_late_themselves_excuse_nothing() -> None:
    told = Telemetry()
    told.frames(10.0)
    told.frames(1.0, late_s=1.5)
    for round_trip_s in (1.5, 3.0, -1.0, 1e9):
        told.delay.bound(BootTime(told.boot_s, round_trip_s), told.now_s)
        told.frames(FRAME_S)
        assert told.delay.late


def test_answers_in_time_do_not_excuse_positions_that_are_late() -> None:
    told = Telemetry()
    told.frames(10.0)
    told.frames(1.0, late_s=1.5)
    told.delay.bound(BootTime(told.boot_s + 1.5, 0.02), told.now_s)
    told.frames(1.0)
    assert told.delay.late


@pytest.mark.parametrize("up_s", [30.0, 500.0, 3e6])
@pytest.mark.parametrize("away_s", [1.0, 20.0])
def test_autopilot_that_starts_again_is_believed_after_a_few_frames_and_not_late(up_s: float, away_s: float) -> None:
    told = Telemetry(1000.0 - up_s)
    told.frames(5.0)
    told.restart(told.now_s + away_s)
    assert sum(not ok for ok in told.frames(5.0)) == 2
    assert not told.delay.late
    told.frames(1.0, late_s=1.0)
    assert told.delay.late


def test_time_that_wraps_is_no_restart() -> None:
    told = Telemetry(1000.0 - WRAP_S + 10.0)
    assert all(told.frames(20.0))
    assert told.boot_s > WRAP_S
    assert not told.delay.late


@pytest.mark.parametrize("by_s", [-1e6, -5.0, -0.3, 3.0, 1e6])
def test_stray_time_is_not_believed_and_leaves_no_trace(by_s: float) -> None:
    told = Telemetry(1000.0 - 1e5)
    told.frames(5.0)
    for _ in range(10):
        assert not told.delay.accept_time((told.boot_s + by_s) % WRAP_S, told.now_s)
        assert all(told.frames(0.2))
    assert told.delay.late_s < 0.01


def test_time_that_was_far_ahead_for_a_while_does_no_lasting_harm() -> None:
    told = Telemetry()
    told.frames(5.0)
    told.frames(1.0, late_s=-1e5)
    told.frames(1.0, late_s=0.0)
    assert told.delay.late
    told.delay.bound(BootTime(told.boot_s, 0.02), told.now_s)
    told.frames(FRAME_S)
    assert not told.delay.late


# --- the vehicle ---


def placed(now_s: float = 100.0) -> Vehicle:
    vehicle = Vehicle()
    vehicle.receive(Position((1.0, 2.0, -3.0), ZERO, 50.0), now_s)
    return vehicle


def test_position_is_missing_when_it_came_long_ago_or_was_long_under_way() -> None:
    assert Vehicle().position_missing(0.0) == "no position"
    vehicle = placed()
    assert vehicle.position_missing(100.0 + POSITION_LOST_S) == ""
    assert vehicle.position_missing(100.01 + POSITION_LOST_S) == "no position"
    vehicle.receive(Position(ZERO, ZERO, 50.1), 101.0)
    assert vehicle.position_missing(101.0) == "telemetry late"


def test_position_with_a_stray_time_is_not_taken() -> None:
    vehicle = placed()
    vehicle.receive(Position((9.0, 9.0, 9.0), ZERO, 49.0), 100.05)
    assert vehicle.position == Position((1.0, 2.0, -3.0), ZERO, 50.0)


def test_position_without_a_time_is_judged_by_its_arrival_alone() -> None:
    vehicle = Vehicle()
    for now_s in (1.0, 50.0):
        vehicle.receive(Position(ZERO, ZERO), now_s)
        assert vehicle.position_missing(now_s) == ""


@pytest.mark.parametrize("event", [Landed(LandedState.IN_AIR), AutopilotText(6, "hello"), BootTime(1.0, 0.1)])
def test_any_message_is_a_sign_of_life(event: Landed | AutopilotText | BootTime) -> None:
    vehicle = placed()
    assert not failsafe_engine.detect(Source.LINK, Readings(silence_s=vehicle.silence_s(100.0 + SILENT_S)))
    assert failsafe_engine.detect(Source.LINK, Readings(silence_s=vehicle.silence_s(100.5 + SILENT_S)))
    assert vehicle.silence_s(100.5 + SILENT_S) == pytest.approx(SILENT_S + 0.5)
    vehicle.receive(event, 100.9)
    assert vehicle.silence_s(100.9 + SILENT_S) <= SILENT_S


def test_link_that_was_down_is_remembered_for_a_while() -> None:
    vehicle = placed(100.0)
    for k in range(1, 101):
        vehicle.receive(Landed(LandedState.IN_AIR), 100.0 + k * (GAP_S - 0.01))
    now_s = 100.0 + 100 * (GAP_S - 0.01)
    assert not vehicle.was_cut_off(now_s)
    vehicle.receive(Landed(LandedState.IN_AIR), now_s + GAP_S + 0.01)
    assert vehicle.was_cut_off(now_s + GAP_S + GAP_SHOWN_S)
    assert not vehicle.was_cut_off(now_s + GAP_S + GAP_SHOWN_S + 0.1)


def test_a_vehicle_in_the_air_that_has_lost_its_fix_holds_and_does_not_lead() -> None:
    vehicle = Vehicle()
    vehicle.receive(Position(ZERO, ZERO), 10.0)
    lost_s = failsafe_engine.row(Cause.GNSS_LOST).delay_s + 0.1
    for landed, causes in ((LandedState.ON_GROUND, []), (LandedState.IN_AIR, [Cause.GNSS_LOST])):
        vehicle.receive(Landed(landed), 10.0)
        found = [k for k in vehicle.findings(10.0, gnss_lost_s=lost_s) if k.cause is not Cause.NO_HEARTBEAT]
        assert [k.cause for k in found] == causes
        assert failsafe_engine.resigns(found) is bool(causes)
    assert Cause.GNSS_LOST not in [k.cause for k in vehicle.findings(10.0, gnss_lost_s=0.1)]


# --- what comes no more, while all else comes ---


def told(*, landed: LandedState, armed: bool, percent: int | None = 80) -> Vehicle:
    """A vehicle that has told all, and from then on its mode and position alone."""
    vehicle = Vehicle()
    vehicle.receive(AutopilotHealth(ready_to_arm=True, battery_percent=percent), 10.0)
    vehicle.receive(Landed(landed), 10.0)
    go_on(vehicle, 10.0, armed=armed)
    return vehicle


def go_on(vehicle: Vehicle, now_s: float, *, armed: bool) -> None:
    vehicle.receive(AutopilotMode(FlightMode.HOLD, armed, "HOLD", False, PX4.traits), now_s)
    vehicle.receive(Position(ZERO, ZERO, None), now_s)


def test_armed_vehicle_whose_landed_state_comes_no_more_counts_as_in_the_air() -> None:
    vehicle = told(landed=LandedState.ON_GROUND, armed=True)
    go_on(vehicle, 10.0 + LANDED_OLD_S, armed=True)
    assert not vehicle.airborne
    go_on(vehicle, 10.1 + LANDED_OLD_S, armed=True)
    assert vehicle.airborne
    vehicle.receive(Landed(LandedState.ON_GROUND), 10.2 + LANDED_OLD_S)
    assert not vehicle.airborne


def test_disarmed_vehicle_whose_landed_state_comes_no_more_waits_for_it() -> None:
    vehicle = told(landed=LandedState.ON_GROUND, armed=False)
    assert vehicle.missing(10.0) == ""
    go_on(vehicle, 10.1 + LANDED_OLD_S, armed=False)
    assert vehicle.missing(10.1 + LANDED_OLD_S) == "no landed state"
    assert not vehicle.airborne


def test_charge_that_is_not_told_any_more_is_not_known_and_costs_the_lead() -> None:
    vehicle, row = told(landed=LandedState.IN_AIR, armed=True), failsafe_engine.row(Cause.BATTERY_UNKNOWN)
    go_on(vehicle, 10.0 + row.delay_s, armed=True)
    assert (vehicle.battery_percent, vehicle.findings(10.0 + row.delay_s)) == (80, [])
    go_on(vehicle, 10.1 + row.delay_s, armed=True)
    assert vehicle.battery_percent is None
    found = vehicle.findings(10.1 + row.delay_s)
    assert [finding.cause for finding in found] == [Cause.BATTERY_UNKNOWN]
    assert failsafe_engine.resigns(found)


def test_autopilot_that_has_never_told_a_charge_has_none_to_miss() -> None:
    vehicle = told(landed=LandedState.IN_AIR, armed=True, percent=None)
    go_on(vehicle, 60.0, armed=True)
    assert vehicle.findings(60.0) == []


def test_readiness_to_arm_that_is_old_does_not_count() -> None:
    vehicle = told(landed=LandedState.ON_GROUND, armed=False)
    for k in range(1, 13):
        vehicle.receive(Landed(LandedState.ON_GROUND), 10.0 + k)
        go_on(vehicle, 10.0 + k, armed=False)
    assert vehicle.missing(22.0) == "autopilot not ready to arm"


def test_a_companion_began_aloft_where_its_autopilot_first_says_that_it_flies_until_it_has_landed() -> None:
    vehicle = Vehicle()
    assert not vehicle.began_aloft
    vehicle.receive(Landed(LandedState.IN_AIR), 10.0)
    vehicle.receive(Landed(LandedState.LANDING), 11.0)
    assert vehicle.began_aloft
    vehicle.receive(Landed(LandedState.ON_GROUND), 12.0)
    assert not vehicle.began_aloft
    vehicle.receive(Landed(LandedState.IN_AIR), 13.0)
    assert not vehicle.began_aloft
