"""A quadrotor flown by JSBSim; its velocity control runs inside JSBSim (quad/control.xml).

The only module that talks to JSBSim: feet, its terrain and its geodesy stay in here.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any
from zlib import crc32

from mission.common.frames import LocalFrame, Vec3, Wgs84, enu_to_ned
from mission.document.model import Drag, Mission
from sim_bridge.world.airframe.base import AirframeError, AirframeFactory
from sim_bridge.world.airframe.drag import SIH_DOWN_I, SIH_DOWN_P, SIH_DRAG_PER_S, SIH_LEVEL_I, SIH_LEVEL_P
from sim_bridge.world.airframe.state import AirframeState
from sim_bridge.world.airframe.wind import CALM, Wind

RATES_HZ = (200, 400)  # legs need 200; both divide the companion's 50 ms tick
MODEL_DIR = Path(str(files("sim_bridge.world.airframe") / "quad"))  # a compiled module's `__file__` leads elsewhere

M_PER_FT = 0.3048
STANDING_HEIGHT_M = 0.14886  # centre of mass above the ground at rest: 0.15 m legs, springs in by 1.14 mm
BURIED_MAX_M = 0.01  # a spawn point this deep is rounding, or a leg under load; deeper is a mistake

COMMANDS = ("fcs/cmd-north-fps", "fcs/cmd-east-fps", "fcs/cmd-down-fps", "fcs/cmd-yaw-rad")
POSITION = ("position/lat-geod-deg", "position/long-gc-deg", "position/geod-alt-ft")
VELOCITY = ("velocities/v-north-fps", "velocities/v-east-fps", "velocities/v-down-fps")
ATTITUDE = ("attitude/phi-rad", "attitude/theta-rad", "attitude/psi-rad")
RATES = ("velocities/p-rad_sec", "velocities/q-rad_sec", "velocities/r-rad_sec")
LEGS = tuple(f"contact/unit[{leg}]/WOW" for leg in range(4))
PROPELLER_DRAG_PER_S = 0.2  # what a climbing propeller loses in thrust
MASS_SLUG = 0.09593
SIH = {
    "aero/linear-drag-lbf_per_fps": -SIH_DRAG_PER_S * MASS_SLUG,
    "fcs/level-p": SIH_LEVEL_P,
    "fcs/level-i": SIH_LEVEL_I,
    "fcs/level-drag": 0.0,
    "fcs/down-p": SIH_DOWN_P,
    "fcs/down-i": SIH_DOWN_I,
    "fcs/down-drag": PROPELLER_DRAG_PER_S,
}
GROUND_FORCE = "forces/fbz-gear-lbs"  # of the legs and the top; in the step that first has it, it has not acted yet
ROTORS = tuple(f"fcs/throttle-pos-norm[{rotor}]" for rotor in range(4))
READ = (*POSITION, *VELOCITY, *ATTITUDE, *RATES, *LEGS, *ROTORS)  # after each step


class JsbsimQuad:
    """An Airframe: the F450's mass, motors and propellers on four legs.

    Its position is the point below the centre of mass that touches the ground when it stands: there, down = 0
    (toppled, up to 0.12 m lower). In JSBSim the mission lies on the prime meridian, away from the date line,
    and at sea level, since JSBSim's turbulence takes altitude for height above the ground: the air is never
    thin. The same arguments and calls give the same states to the bit, whatever else runs.
    """

    __slots__ = (
        "_armed",
        "_commands",
        "_fdm",
        "_frame",
        "_ground_force",
        "_hit",
        "_rate_hz",
        "_readers",
        "_run",
        "_state",
    )

    def __init__(
        self,
        frame: LocalFrame,
        pos_ned_m: Vec3,
        yaw_rad: float,
        *,
        rate_hz: int = 200,
        seed: int = 0,
        wind: Wind = CALM,
        drag: Drag = Drag.LOW,
        ground_down_m: float = 0.0,
    ) -> None:
        """Disarmed and at rest at `pos_ned_m`. ValueError for another rate, or a place under the ground."""
        if rate_hz not in RATES_HZ:
            raise ValueError(f"rate_hz = {rate_hz}: must be one of {RATES_HZ}")
        if not all(map(math.isfinite, (*pos_ned_m, yaw_rad))) or pos_ned_m[2] > ground_down_m + BURIED_MAX_M:
            limit = f"must be finite, down <= {ground_down_m:g}"
            raise ValueError(f"pos_ned_m = {pos_ned_m}, yaw_rad = {yaw_rad}: {limit}")
        self._rate_hz = rate_hz
        self._frame = LocalFrame(Wgs84(frame.origin.lat_deg, 0.0, 0.0))
        self._fdm = _load(rate_hz)
        _place(self._fdm, self._frame.to_wgs84(pos_ned_m), yaw_rad, ground_down_m)
        _blow(self._fdm, wind, seed)
        if drag is Drag.SIH:
            for name, value in SIH.items():
                self._node(name).set_double_value(value)
        self._run = self._fdm.run
        self._armed = self._node("fcs/armed")
        self._commands = [self._node(name).set_double_value for name in COMMANDS]
        self._readers: list[Callable[[], float]] = [self._node(name).get_double_value for name in READ]
        self._ground_force: Callable[[], float] = self._node(GROUND_FORCE).get_double_value
        self._hit: Vec3 | None = None
        self._state: AirframeState | None = None
        self.command((0.0, 0.0, 0.0), yaw_rad)

    @property
    def state(self) -> AirframeState:
        """Read from JSBSim once after each step; yaw in -pi..pi, on_ground when any leg touches.

        hit_ned_mps: as it was when it first touched the ground in the last `step`, with a leg or its top.
        """
        if self._state is None:
            self._state = self._read_state()
        return self._state

    def set_armed(self, armed: bool) -> None:
        """Start or stop the rotors. Armed on the ground they idle until a climb is commanded."""
        self._armed.set_double_value(1.0 if armed else 0.0)

    def command(self, vel_ned_mps: Vec3, yaw_rad: float) -> None:
        """Sets what to follow: velocity (NED m/s), heading (rad). ValueError unless all are finite."""
        north, east, down = vel_ned_mps
        if not math.isfinite(north + east + down + yaw_rad):
            raise ValueError(f"vel_ned_mps = {vel_ned_mps}, yaw_rad = {yaw_rad}: must be finite")
        set_north, set_east, set_down, set_yaw = self._commands
        set_north(north / M_PER_FT)
        set_east(east / M_PER_FT)
        set_down(down / M_PER_FT)
        set_yaw(yaw_rad)

    def set_ground(self, down_m: float) -> None:
        """Sets how far below the origin the ground under it lies."""
        self._fdm["position/terrain-elevation-asl-ft"] = -down_m / M_PER_FT

    def set_wind(self, mean_ned_mps: Vec3) -> None:
        """Sets how the air about it moves; its turbulence stays."""
        _set_mean(self._fdm, mean_ned_mps)

    def step(self, dt_s: float) -> None:
        """Advance by `dt_s`. ValueError when it is not a whole number of physics steps."""
        steps = round(dt_s * self._rate_hz)
        if steps < 1 or abs(steps - dt_s * self._rate_hz) > 1e-6:
            raise ValueError(f"dt_s = {dt_s}: must be a multiple of the physics step, {1 / self._rate_hz} s")
        run, ground_force = self._run, self._ground_force
        self._hit = None
        for _ in range(steps):
            run()
            if self._hit is None and ground_force() != 0.0:  # a bounce is over within 40 ms
                self._hit = self._read_velocity()
        self._state = None

    def _node(self, name: str) -> Any:
        node = self._fdm.get_property_manager().get_node(name)
        if node is None:
            raise AirframeError(f"JSBSim has no property {name}")
        return node

    def _read_state(self) -> AirframeState:
        at = [read() for read in self._readers]  # in the order of READ
        return AirframeState(
            pos_ned_m=self._frame.to_ned(Wgs84(at[0], at[1], at[2] * M_PER_FT - STANDING_HEIGHT_M)),
            vel_ned_mps=(at[3] * M_PER_FT, at[4] * M_PER_FT, at[5] * M_PER_FT),
            attitude_rad=(at[6], at[7], math.remainder(at[8], math.tau)),
            rates_radps=(at[9], at[10], at[11]),
            on_ground=at[12] != 0.0 or at[13] != 0.0 or at[14] != 0.0 or at[15] != 0.0,
            throttle=(at[16] + at[17] + at[18] + at[19]) / 4.0,
            hit_ned_mps=self._hit,
        )

    def _read_velocity(self) -> Vec3:
        north, east, down = [read() * M_PER_FT for read in self._readers[3:6]]  # in the order of READ
        return (north, east, down)


def jsbsim_airframes(mission: Mission) -> AirframeFactory:
    """JSBSim quadrotors in the mission's wind, with its drag."""
    wind = Wind(enu_to_ned(mission.sim.wind_mps), mission.sim.turbulence_mps)
    drag = mission.sim.drag
    return lambda frame, pos_ned_m, seed: JsbsimQuad(
        frame, pos_ned_m, 0.0, seed=seed, wind=wind, drag=drag, ground_down_m=pos_ned_m[2]
    )


def _load(rate_hz: int) -> Any:
    """A JSBSim with the quad in it."""
    fdm = quiet_jsbsim().FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(MODEL_DIR.parent))
    fdm.set_engine_path(str(MODEL_DIR))
    fdm.set_dt(1.0 / rate_hz)  # before loading: the control's filters take it then
    if not fdm.load_model(MODEL_DIR.name):
        raise AirframeError(f"JSBSim cannot load {MODEL_DIR}")
    return fdm


def _place(fdm: Any, position: Wgs84, yaw_rad: float, ground_down_m: float) -> None:
    """At rest over `position`, or on it."""
    fdm["ic/terrain-elevation-ft"] = 0.0 - ground_down_m / M_PER_FT
    fdm["ic/lat-geod-deg"] = position.lat_deg
    fdm["ic/long-gc-deg"] = position.lon_deg
    fdm["ic/h-agl-ft"] = (position.alt_m + ground_down_m + STANDING_HEIGHT_M) / M_PER_FT
    fdm["ic/psi-true-rad"] = yaw_rad
    if not fdm.run_ic():
        raise AirframeError(f"JSBSim refuses to start at {position}")


def _blow(fdm: Any, wind: Wind, seed: int) -> None:
    # JSBSim takes 0 for 1, and starts close seeds on close gusts.
    fdm["atmosphere/randomseed"] = 1 + crc32(str(seed).encode()) % (2**31 - 2)
    _set_mean(fdm, wind.mean_ned_mps)
    fdm["atmosphere/turb-type"] = 3 if wind.turbulence_mps else 0  # 3: milspec, 0: none
    fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = wind.turbulence_mps / M_PER_FT
    fdm["atmosphere/turbulence/milspec/severity"] = 3  # on; which of 1..7 matters only above 1000 ft


def _set_mean(fdm: Any, mean_ned_mps: Vec3) -> None:
    for name, speed_mps in zip(("north", "east", "down"), mean_ned_mps, strict=True):
        fdm[f"atmosphere/wind-{name}-fps"] = speed_mps / M_PER_FT


def quiet_jsbsim() -> Any:
    """The jsbsim module, silenced in this thread (it keeps a logger per thread). AirframeError without it."""
    try:
        import jsbsim
    except ImportError as error:
        raise AirframeError(f"JSBSim is not there ({error}): in the checkout, pip install -e '.[sim]'") from error
    jsbsim.set_logger(_silence(jsbsim.FGLogger))
    return jsbsim


@cache
def _silence(logger_class: Any) -> Any:
    """A JSBSim logger that says nothing."""
    return type("Silence", (logger_class,), {"message": lambda _self, _message: None})()
