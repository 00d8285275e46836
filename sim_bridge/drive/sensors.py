"""Obstacle sensors of vehicles that the bridge does not fly: they see the mission's stand, which is nowhere else.

Each looks from where its vehicle's autopilot says that it is, and as tilted as that says.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import ExitStack

from mission.document.model import Mission, ScansVia
from mission.stand.stand import Stand
from sim_bridge.drive.autopilots import Autopilots
from sim_bridge.drive.ports import Address, Reader, bound_socket
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.sensors.lidar import Driver, Lidar
from sim_bridge.world.sensors.scene import Scene

ZERO = (0.0, 0.0, 0.0)


class Sensors:
    """A lidar for each vehicle of a mission with [sensing], none without; and a socket, if it has a link of its own.

    `ports`: of those sockets, by vehicle id.
    """

    def __init__(self, mission: Mission, stand: Stand, autopilots: Autopilots, stack: ExitStack) -> None:
        """`stack` closes the sockets. StartError."""
        self._autopilots = autopilots
        self._drivers: dict[int, Driver] = {}
        self._addresses: dict[int, Address] = {}  # of the companions
        sensing, sim = mission.sensing, mission.sim
        ids: Sequence[int] = () if sensing is None else autopilots.ids
        linked = ids if sim.lidar.via is ScansVia.LINK else ()
        self._sockets = {k: stack.enter_context(bound_socket(f"obstacle sensor {k}", 0)) for k in linked}
        self.ports = {k: bound.getsockname()[1] for k, bound in self._sockets.items()}
        if sensing is None:
            return
        scene = Scene(stand, sensing.range_m)
        self._drivers = {k: Driver(Lidar(scene, sensing, sim.lidar, seed=sim.seed, vehicle_id=k), k) for k in ids}
        for k, bound in self._sockets.items():
            autopilots.listener.listen(bound, self._reader(k))

    def look(self, now_s: float, blind: Collection[int]) -> None:
        """What is due is sent. `now_s`: of the flight; `blind`: vehicles whose sensors tell nothing."""
        if not self._drivers:
            return
        places = self._autopilots.positions()
        attitudes = self._autopilots.attitudes()
        for k, driver in self._drivers.items():
            if k not in places or k not in attitudes:
                continue
            others = [place for other, place in places.items() if other != k]
            state = AirframeState(places[k], ZERO, attitudes[k], ZERO, False, 0.0)
            data = driver.frames(state, others, now_s)
            if not data or k in blind:
                continue
            if k not in self._sockets:
                self._autopilots.to_companion(k, data)
            elif k in self._addresses:
                try:
                    self._sockets[k].sendto(data, self._addresses[k])
                except OSError:  # it has just ended
                    self._addresses.pop(k)

    def _reader(self, vehicle_id: int) -> Reader:
        def read(_data: bytes, address: Address, _now_s: float) -> None:
            self._addresses[vehicle_id] = address

        return read
