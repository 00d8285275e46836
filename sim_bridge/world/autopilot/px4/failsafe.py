"""Failsafes of PX4's commander: the stream of setpoints, and the conditions that make it act by itself."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from sim_bridge.world.autopilot.protocols.parameters import ParameterTable
from sim_bridge.world.autopilot.px4 import tables
from sim_bridge.world.autopilot.px4.tables import Action
from sim_bridge.world.autopilot.types import BatteryLevel, Failsafe

SETPOINT_FRESH_S: Final = 0.5  # PX4 asks for more than 2 Hz
SETPOINTS_NEEDED: Final = 2  # within SETPOINT_FRESH_S; recorded: two or three are enough


class SetpointStream:
    """Stream of setpoints received. `now_s`: seconds since boot."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._times_s: deque[float] = deque(maxlen=SETPOINTS_NEEDED)

    @property
    def begun(self) -> bool:
        """One has come since boot."""
        return bool(self._times_s)

    def record_setpoint(self, now_s: float) -> None:
        """A setpoint has come."""
        self._times_s.append(now_s)

    def alive(self, now_s: float) -> bool:
        """Enough setpoints lately to begin OFFBOARD."""
        times_s = self._times_s
        return len(times_s) == SETPOINTS_NEEDED and now_s - times_s[0] <= SETPOINT_FRESH_S

    def lost(self, now_s: float) -> bool:
        """None for COM_OF_LOSS_T, or none yet."""
        times_s = self._times_s
        return not times_s or now_s - times_s[-1] > self._parameters["COM_OF_LOSS_T"]


class Conditions:
    """Battery, ground station, fence and position. Each condition trips once, and again only after it has cleared."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._tripped: set[tuple[Failsafe, str]] = set()  # those that have tripped and still hold
        self._gcs_heard_s: float | None = None

    def hear_gcs(self, now_s: float) -> None:
        """A ground station's heartbeat has come."""
        self._gcs_heard_s = now_s
        self._clear(Failsafe.GCS_LOSS)

    def gcs_alive(self, now_s: float) -> bool:
        """A ground station was heard within COM_DL_LOSS_T."""
        heard_s = self._gcs_heard_s
        return heard_s is not None and now_s - heard_s <= self._parameters["COM_DL_LOSS_T"]

    def forget(self) -> None:
        """Disarmed: all may trip again."""
        self._tripped.clear()

    def trip(
        self, now_s: float, level: BatteryLevel, outside_fence: Callable[[], bool], *, has_position: bool
    ) -> list[tuple[Failsafe, str, Action]]:
        """Failsafes that begin now: cause, the same in words, and the action that its parameter asks for."""
        began: list[tuple[Failsafe, str, Action]] = []
        for cause, what, action in self._holding(now_s, level, outside_fence, has_position=has_position):
            if (cause, what) not in self._tripped:
                self._tripped.add((cause, what))
                began.append((cause, what, action))
        return began

    def _holding(
        self, now_s: float, level: BatteryLevel, outside_fence: Callable[[], bool], *, has_position: bool
    ) -> list[tuple[Failsafe, str, Action]]:
        found: list[tuple[Failsafe, str, Action]] = []
        value = self._parameters
        if not has_position:  # and no sticks to hold it by
            found.append((Failsafe.POSITION_LOSS, "Position lost", Action.DESCEND))
        elif self._tripped:
            self._clear(Failsafe.POSITION_LOSS)
        if level is not BatteryLevel.OK:
            what, table = tables.BATTERY_ACTIONS[level]
            found.append((Failsafe.BATTERY, what, table.get(int(value["COM_LOW_BAT_ACT"]), Action.WARN)))
        action = tables.GCS_LOSS_ACTIONS.get(int(value["NAV_DLL_ACT"]))
        if action is not None and not self.gcs_alive(now_s):
            found.append((Failsafe.GCS_LOSS, "Ground station lost", action))
        action = tables.GEOFENCE_ACTIONS.get(int(value["GF_ACTION"]))
        if action is not None and outside_fence():
            found.append((Failsafe.GEOFENCE, "Geofence violated", action))
        elif self._tripped:
            self._clear(Failsafe.GEOFENCE)
        return found

    def _clear(self, cause: Failsafe) -> None:
        self._tripped = {trip for trip in self._tripped if trip[0] is not cause}
