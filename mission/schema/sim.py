"""The part of a mission that is for the simulator alone: `[sim]`. Nothing of it reaches an aircraft."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field, WrapValidator

from mission.schema.by_vehicle import FrozenTable, as_vehicle_id, each_id_once
from mission.schema.faults import MAX_FAULTS, Fault, WindComponent
from mission.schema.fields import MAX_VEHICLES, Boolean, Integer, Number, Table, VehicleId
from mission.schema.kinds import Estimates as Estimates
from mission.schema.kinds import Personality as Personality


class Placement(StrEnum):
    """Arrangement by the simulator of vehicles about d1 before take-off."""

    RANDOM = "random"
    GRID = "grid"
    RING = "ring"


class Drag(StrEnum):
    """Drag of a simulated vehicle, and what its velocity control makes of it."""

    LOW = "low"
    SIH = "sih"


class RadioTrunks(StrEnum):
    """Attenuation of a link by trunks between two antennas."""

    DISC = "disc"
    ATTENUATED = "attenuated"
    CUT = "cut"


class ScansVia(StrEnum):
    """Way by which a simulated obstacle sensor's scans get to the companion."""

    LINK = "link"
    AUTOPILOT = "autopilot"


class Lidar(Table):
    """Errors of the simulated obstacle sensor; what it is to be is in `[sensing]`."""

    noise_m: Annotated[
        Number | None,
        Field(
            ge=0.0,
            le=1.0,
            examples=[0.05],
            description="Standard deviation of a range. Optional: that of `sensing.sensor`, 0.05 m for sectors, 0.03 m "
            "at 1 degree, else 0.02 m.",
        ),
    ] = None
    dropout: Annotated[
        Number, Field(ge=0.0, lt=1.0, description="Probability that a scan misses a sector or ray, each on its own.")
    ] = 0.02
    delay_s: Annotated[Number, Field(ge=0.0, le=1.0, description="How old a scan is when it is delivered.")] = 0.0
    via: Annotated[
        ScansVia,
        Field(description="How scans get to the companion: by a link of their own, or forwarded by the autopilot."),
    ] = ScansVia.LINK


class RangeTrunks(StrEnum):
    """Effect of a trunk between two range radios."""

    CLEAR = "clear"
    LATE = "late"
    CUT = "cut"


class RangingErrors(Table):
    """Errors of the simulated range radios; what they are to be is in `[ranging]`."""

    noise_m: Annotated[Number, Field(ge=0.0, le=2.0, description="Standard deviation of a range.")] = 0.1
    loss: Annotated[Number, Field(ge=0.0, lt=1.0, description="Probability that a measurement fails.")] = 0.1
    late: Annotated[
        Number,
        Field(ge=0.0, lt=1.0, description="Probability that a range is too long by 0.2 to 1.2 m, wherever it is."),
    ] = 0.0
    trunks: Annotated[
        RangeTrunks,
        Field(
            description="What trunks between do: nothing (clear), ranges are too long by 0.2 to 1.2 m for as long as "
            "one stands there (late), or there is none (cut)."
        ),
    ] = RangeTrunks.LATE
    slots_hz: Annotated[
        Number,
        Field(ge=20.0, le=2_000.0, description="Measurements a second that fit on the air, of all vehicles together."),
    ] = 320.0
    start_error_m: Annotated[
        Number,
        Field(
            ge=0.0, le=2.0, description="Standard deviation of where vehicles stand from ranging.start_enu_m, an axis."
        ),
    ] = 0.5


class OdometryErrors(Table):
    """Errors of simulated autopilots without GNSS; level. Heights are wrong by 0.1 m, and change slowly."""

    velocity_noise_mps: Annotated[
        Number,
        Field(ge=0.0, le=1.0, description="Standard deviation of a velocity's noise, new every 0.1 s, an axis."),
    ] = 0.1
    velocity_bias_mps: Annotated[
        Number, Field(ge=0.0, le=1.0, description="Standard deviation of its slow error, forgotten in 20 s, an axis.")
    ] = 0.05
    yaw_deg: Annotated[
        Number, Field(ge=0.0, le=20.0, description="Standard deviation of the compass's error, forgotten in 300 s.")
    ] = 2.0


class Sky(StrEnum):
    """Attenuation of satellites' signals by crowns."""

    CLEAR = "clear"
    SHADE = "shade"


class SatelliteErrors(Table):
    """GNSS reception of simulated receivers."""

    crowns: Annotated[
        Sky,
        Field(
            description="What crowns do to satellites' signals: nothing, and positions are as `estimates` says "
            "(clear), or they weaken them (shade): fewer satellites, larger errors, no fix. Then vehicles with "
            "receivers have the errors of `[sim.odometry]` where they have no fix. Only where swarm.gnss leaves some "
            "without.",
        ),
    ] = Sky.CLEAR
    crown_db_per_m: Annotated[
        Number, Field(ge=0.0, le=20.0, description="Loss of a signal by each metre of crown on its way, shaded; dB.")
    ] = 1.0


class Sim(Table):
    """For the simulator alone: nothing here reaches an aircraft."""

    seed: Annotated[Integer, Field(ge=0, le=2**32 - 1, description="The same seed flies the same flight.")] = 1
    wind_mps: Annotated[
        tuple[WindComponent, WindComponent, WindComponent],
        Field(description="Steady wind: east, north, up, where the air moves to."),
    ] = (0.0, 0.0, 0.0)
    turbulence_mps: Annotated[
        Number, Field(ge=0.0, le=30.0, description="Wind speed at 20 ft of the MIL-F-8785C gusts; 0: none.")
    ] = 0.0
    radio_loss: Annotated[
        Number,
        Field(ge=0.0, lt=1.0, description="Probability that a receiver loses a beacon, each on its own."),
    ] = 0.0
    radio_delay_s: Annotated[Number, Field(ge=0.0, le=2.0, description="Mean extra delay of a beacon.")] = 0.0
    radio_trunks: Annotated[
        RadioTrunks,
        Field(
            description="What trunks between two antennas do: nothing (disc: the range alone counts), each takes "
            "radio_trunk_db (attenuated), or any one cuts the link.",
        ),
    ] = RadioTrunks.DISC
    radio_trunk_db: Annotated[
        Number, Field(ge=0.0, le=60.0, description="Loss of a link by each trunk across it, when attenuated; dB.")
    ] = 6.0
    personality: Annotated[
        Personality, Field(description="How the autopilots behave: as PX4, or as ArduPilot's copter.")
    ] = Personality.PX4
    personalities: Annotated[
        dict[Annotated[VehicleId, BeforeValidator(as_vehicle_id)], Personality],
        WrapValidator(each_id_once),
        AfterValidator(FrozenTable),
        Field(
            max_length=MAX_VEHICLES,
            description='For single vehicles, by id: `3 = "ardupilot"`; the others have `personality`.',
        ),
    ] = {}  # noqa: RUF012 - pydantic copies it
    estimates: Annotated[
        Estimates,
        Field(
            description="What autopilots know of position, velocity and yaw, tell, and fly by: exact (the truth), "
            "recorded (as wrong as PX4 was against its simulator's truth, each vehicle in its own measure; ArduCopter "
            "as in 2026-11), or 2026-11 (as wrong as telemetry logs had shown until then; yaw exact). All figures "
            "are of the truth.",
        ),
    ] = Estimates.EXACT
    velocity_bias_mps: Annotated[
        Number | None,
        Field(
            ge=0.0,
            le=3.0,
            description="Every velocity in the air is wrong by this much, level, always the same way: each vehicle's "
            "own, by the seed. One that is to stand still drifts at it. Left out: as `estimates` says.",
        ),
    ] = None
    climb_bias_mps: Annotated[
        Number | None,
        Field(
            ge=0.0,
            le=0.2,
            description="The same for the vertical velocity, up or down by the seed; with more, vehicles that descend "
            "at 0.3 m/s to land would hardly come down. Left out: as `estimates` says.",
        ),
    ] = None
    velocity_noise_mps: Annotated[
        Number | None,
        Field(
            ge=0.0,
            le=1.0,
            description="Standard deviation of a slow error of the velocity in the air, for each level axis (vertical: "
            "half), forgotten in about 4 s, or as `estimates` has it. Left out: as `estimates` says.",
        ),
    ] = None
    position_noise_m: Annotated[
        Number | None,
        Field(
            ge=0.0,
            le=10.0,
            description="Standard deviation of a slow error of the position, for each level axis (vertical: half), "
            "forgotten in about 10 s, or as `estimates` has it. Left out: as `estimates` says.",
        ),
    ] = None
    estimate_delay_s: Annotated[
        Number,
        Field(ge=0.0, le=2.0, description="Positions and velocities are this old; their time stamps say fresh."),
    ] = 0.0
    range_finder: Annotated[
        Boolean,
        Field(
            description="Autopilots estimate their height by a downward range finder: over the ground, wrong by 0.1 m "
            "rms at most, the vertical velocity by 0.05 m/s, whatever `estimates` says. `separation.height_layers` "
            "needs it where estimates are wrong.",
        ),
    ] = False
    drag: Annotated[
        Drag,
        Field(
            description="low: the quadrotor's own, and it follows velocities closely. sih: that of PX4's simulator SIH "
            "by default, and as slow: of a step to 3 m/s 85 % after 6 s.",
        ),
    ] = Drag.LOW
    battery_mah: Annotated[
        dict[
            Annotated[VehicleId, BeforeValidator(as_vehicle_id)],
            Annotated[Number, Field(ge=100.0, le=100_000.0)],
        ],
        WrapValidator(each_id_once),
        AfterValidator(FrozenTable),
        Field(
            max_length=MAX_VEHICLES,
            description="Capacity of single vehicles' batteries, by id: `3 = 1000.0`; the others have their "
            "autopilot's default, 5000 (px4) or 3300 (ardupilot). All are full at the start.",
        ),
    ] = {}  # noqa: RUF012 - pydantic copies it
    placement: Annotated[
        Placement,
        Field(
            description="Where vehicles start about d1: random (a disc, by the seed), grid, or ring.",
        ),
    ] = Placement.RANDOM
    placement_spacing_m: Annotated[
        Number, Field(gt=0.0, le=1_000.0, description="Least distance between vehicles at the start.")
    ] = 6.0
    time_limit_s: Annotated[
        Number | None,
        Field(
            gt=0.0,
            le=604_800.0,
            description="Simulated time after which the flight has failed. Left out: derived from the route.",
        ),
    ] = None

    lidar: Annotated[Lidar, Field(description="Errors of the simulated obstacle sensor.")] = Lidar()
    ranging: Annotated[RangingErrors, Field(description="Errors of the simulated range radios.")] = RangingErrors()
    odometry: Annotated[OdometryErrors, Field(description="Errors of simulated autopilots without GNSS.")] = (
        OdometryErrors()
    )
    satellites: Annotated[SatelliteErrors, Field(description="How simulated receivers receive satellites.")] = (
        SatelliteErrors()
    )
    faults: Annotated[
        tuple[Fault, ...],
        Field(
            max_length=MAX_FAULTS,
            description="What goes wrong on the way, one table for each. `sim-bridge fly` and studies that fly agents "
            "heed them, and `fly` takes them as options too.",
        ),
    ] = ()

    def personality_of(self, vehicle_id: int) -> Personality:
        """Make of this vehicle's autopilot."""
        return self.personalities.get(vehicle_id, self.personality)
