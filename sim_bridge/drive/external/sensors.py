"""Sensors of vehicles that the bridge does not fly: they see the mission's stand, which is nowhere else.

Each looks from where its vehicle is, as tilted and as it moves, by its simulator's truth; where none is told, by its
autopilot.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack

from mission.document.model import Mission
from mission.schema.kinds import FaultKind
from mission.stand.stand import Stand
from sim_bridge.drive.external.autopilots import Autopilots
from sim_bridge.drive.links.hub import split
from sim_bridge.drive.links.ports import Address, Reader, bound_socket
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.table import link_name, simulated_sensors
from sim_bridge.world.strikes import Struck, strike_sensors

ZERO = (0.0, 0.0, 0.0)


class Sensors:
    """The simulated sensors of a mission's vehicles; and a socket for each vehicle's drivers, if they have a link."""

    def __init__(self, mission: Mission, stand: Stand, autopilots: Autopilots, stack: ExitStack) -> None:
        """`stack` closes the sockets. StartError."""
        self._autopilots = autopilots
        self._sensors = simulated_sensors(mission, stand, autopilots.ids)
        self._link = link_name(mission)
        self._addresses: dict[int, Address] = {}  # of the companions
        linked = autopilots.ids if self._link else ()
        self._sockets = {k: stack.enter_context(bound_socket(f"sensors {k}", 0)) for k in linked}
        for k, bound in self._sockets.items():
            autopilots.listener.listen(bound, self._reader(k))

    def ports(self, vehicle_id: int) -> dict[str, int]:
        """Of the socket of this vehicle's drivers, by the name of the sensor whose link it is."""
        bound = self._sockets.get(vehicle_id)
        return {} if bound is None else {self._link: bound.getsockname()[1]}

    def send_due(self, now_s: float, blind: Collection[int]) -> None:
        """Send what is due. `now_s`: of the flight; `blind`: vehicles whose optical sensors tell nothing."""
        if not self._sensors:
            return
        positions_ned_m = self._autopilots.positions()
        attitudes = self._autopilots.attitudes()
        for k in self._autopilots.ids:
            if k not in positions_ned_m:
                continue
            vel_ned_mps, rates_radps = self._autopilots.velocity(k), self._autopilots.rates(k)
            state = AirframeState(
                positions_ned_m[k], vel_ned_mps, attitudes.get(k, ZERO), rates_radps, on_ground=False, throttle=0.0
            )
            for sensor in self._sensors:
                if sensor.is_optical and k not in attitudes:
                    continue
                data = sensor.frames(k, state, positions_ned_m, now_s)
                if data and not (sensor.is_optical and k in blind):
                    self._send(k, data, by_autopilot=sensor.by_autopilot)

    def strike(self, kind: FaultKind, struck: Struck) -> None:
        """Sets which vehicles' sensors a kind of fault strikes now."""
        strike_sensors(self._sensors, kind, struck)

    def _send(self, vehicle_id: int, data: bytes, *, by_autopilot: bool) -> None:
        for datagram in split(data):
            if by_autopilot:
                self._autopilots.to_companion(vehicle_id, datagram)
            elif vehicle_id in self._addresses:
                try:
                    self._sockets[vehicle_id].sendto(datagram, self._addresses[vehicle_id])
                except OSError:  # it has just ended
                    self._addresses.pop(vehicle_id)

    def _reader(self, vehicle_id: int) -> Reader:
        def note_driver(_data: bytes, address: Address, _now_s: float) -> None:
            self._addresses[vehicle_id] = address

        return note_driver
