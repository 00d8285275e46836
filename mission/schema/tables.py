"""The tables of a mission file: each key with its description, bounds and default.

Positions are ENU metres about the origin, z above the ground there, as in the paper. The reference and the JSON Schema
are generated from here, and a refusal quotes it.
"""

from __future__ import annotations

import math
from enum import StrEnum
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

from pydantic import ConfigDict, Field, field_validator

from mission.common import plane
from mission.common.frames import Vec3, Wgs84
from mission.lanes.lay import Lane, Swath, lay_lanes
from mission.lanes.spread import LineAbreast, line_abreast, swath_of
from mission.schema.fields import (
    COORDINATE_MAX_M,
    MAX_VEHICLES,
    Boolean,
    Coordinate,
    Integer,
    Number,
    Table,
    Text,
    VehicleId,
)
from mission.schema.forest import Forest
from mission.schema.kinds import RAW_LIDARS, SensorClass
from mission.schema.payload import PAYLOADS_MAX, Payload
from mission.schema.sim import Sim

RANGE_MAX_M = 6_500.0  # SWARM_BEACON.range_dm is a uint16
VEHICLE_RADIUS_M = 0.35  # half the 0.70 m from propeller tip to propeller tip along an arm of the F450
MAX_STOPS = 20
MAX_LANES = 15  # each is two visits, and their number takes five bits of a beacon
FENCE_SLACK_M = 5.0  # overshoot and gusts, and room to brake before the fence
STALE_MAX_S = 4.0  # what no scan has hit for so long is forgotten: beyond, trunks would count as free
BEACON_RATES_HZ = (1.0, 2.0, 4.0, 5.0, 10.0, 20.0)  # whole numbers of 20 Hz control ticks


def _simple_polygon(polygon: tuple[plane.Point, ...] | None) -> tuple[plane.Point, ...] | None:
    fault = polygon and plane.polygon_fault(polygon)
    if fault:
        raise ValueError(fault)
    return polygon


class AtEnd(StrEnum):
    """Action of the swarm once its time in coverage is over."""

    HOLD = "hold"
    LAND = "land"
    RETURN = "return"


class Gnss(StrEnum):
    """Vehicles that have satellite positions, where no ids are given."""

    ALL = "all"
    LEADER = "leader"


class PositionUncertain(StrEnum):
    """Action of a swarm whose leader does not know any more where it is."""

    RETURN = "return"
    HOLD = "hold"


class CoverageShape(StrEnum):
    """The surface that vehicles spread over around d2."""

    RING = "ring"
    SPHERE = "sphere"


class Origin(Table):
    """Anchor on Earth of the mission's ENU frame is anchored. Without it the simulator supplies one."""

    lat_deg: Annotated[
        Number,
        Field(
            ge=-85.0,
            le=85.0,
            examples=[47.0],
            description="Geodetic latitude, WGS84. The local plane fails near the poles.",
        ),
    ]
    lon_deg: Annotated[Number, Field(ge=-180.0, le=180.0, examples=[8.0], description="Longitude, WGS84.")]
    alt_m: Annotated[
        Number,
        Field(
            ge=-500.0,
            le=9_000.0,
            examples=[400.0],
            description="Altitude above mean sea level of the ground: z = 0.",
        ),
    ]

    @property
    def wgs84(self) -> Wgs84:
        """The origin as `frames.LocalFrame` takes it."""
        return Wgs84(self.lat_deg, self.lon_deg, self.alt_m)


class Stop(Table):
    """A tree on the way, visited before d2."""

    pos_enu_m: Annotated[
        tuple[Coordinate, Coordinate, Coordinate],
        Field(
            examples=[[60.0, 20.0, 8.0]],
            description="Centre of the coverage there: east, north, up in metres from the origin, as d2.",
        ),
    ]
    duration_s: Annotated[
        Number | None,
        Field(ge=0.0, le=86_400.0, description="How long to stay in coverage there. Left out: coverage.duration_s."),
    ] = None


class Visit(NamedTuple):
    """A place that is covered: its centre, ENU m, and for how long; or the end of a lane, which is passed."""

    pos_enu_m: Vec3
    duration_s: float
    is_passed: bool = False


def _point_or_tree(schema: dict[str, Any]) -> None:
    """A file may name the tree instead of the point: `load_mission` finds it in the stem map."""
    for point, tree in (("d1_enu_m", "d1_tree"), ("d2_enu_m", "d2_tree")):
        schema["required"].remove(point)
        schema.setdefault("allOf", []).append({"anyOf": [{"required": [point]}, {"required": [tree]}]})


TreeId = Annotated[str, Field(min_length=1, max_length=40, examples=["A-17"])]


class Route(Table):
    """From deployment to destination."""

    model_config = ConfigDict(json_schema_extra=_point_or_tree)

    d1_enu_m: Annotated[
        tuple[Coordinate, Coordinate, Coordinate],
        Field(
            examples=[[0.0, 0.0, 8.0]],
            description="Deployment d1: east, north, up in metres from the origin, up from the ground there. "
            "Required, unless `d1_tree` says it.",
        ),
    ]
    d2_enu_m: Annotated[
        tuple[Coordinate, Coordinate, Coordinate],
        Field(
            examples=[[130.0, 0.0, 8.0]],
            description="Destination d2, the centre of coverage, and the last of them where there are stops: east, "
            "north, up in metres from the origin. Required, unless `d2_tree` says it.",
        ),
    ]
    d1_tree: Annotated[
        TreeId | None,
        Field(
            description="Instead of `d1_enu_m`: the id of a tree in the stem map `forest.file`, where d1 is, as high "
            "as d2. Vehicles start around it: `sim.placement` must be a ring that leaves it room.",
        ),
    ] = None
    d2_tree: Annotated[
        TreeId | None,
        Field(
            description="Instead of `d2_enu_m`: the id of a tree in the stem map `forest.file`, where d2 is, as high "
            "as d1.",
        ),
    ] = None
    vel_leader_mps: Annotated[
        Number,
        Field(
            ge=0.05,
            le=30.0,
            examples=[3.0],
            description="Speed of the leader in transit: the paper's vel_leader.",
        ),
    ]
    arrival_distance_m: Annotated[
        Number, Field(gt=0.0, le=1_000.0, description="The leader has arrived when it is this close to d2.")
    ] = 5.0
    at_end: Annotated[
        AtEnd,
        Field(
            description="After coverage: hold in the air, land there, or return to d1 and land.",
        ),
    ] = AtEnd.HOLD
    stops: Annotated[
        tuple[Stop, ...],
        Field(
            max_length=MAX_STOPS,
            description="Trees that are visited and covered before d2, in this order, one table for each.",
        ),
    ] = ()

    @property
    def points_enu_m(self) -> tuple[Vec3, ...]:
        """d1, the stops, d2: ENU m. The swarm goes straight from each to the next."""
        return (self.d1_enu_m, *(stop.pos_enu_m for stop in self.stops), self.d2_enu_m)

    @property
    def length_m(self) -> float:
        """The way from d1 over all stops to d2; `MissionTables.way_m` has lanes, too."""
        return sum(math.dist(a, b) for a, b in pairwise(self.points_enu_m))


class Swarm(Table):
    """Vehicles that fly, and which of them may lead."""

    size: Annotated[
        Integer, Field(ge=1, le=MAX_VEHICLES, description="Number of vehicles n; their ids are 1 to n.")
    ] = 8
    leader_priority: Annotated[
        tuple[VehicleId, ...],
        Field(
            max_length=MAX_VEHICLES,
            description="Empty: the leader is elected among all. Else ids, best first (the paper's "
            "predetermined leader); an id that is not listed leads only if none of these is there. Where not all have "
            "satellites those with a GNSS fix come before all others.",
        ),
    ] = ()
    reelection_period_s: Annotated[
        Number,
        Field(
            ge=0.0,
            le=3_600.0,
            description="How often the leader hands over to a vehicle that is clearly better, by two steps of 10 % of "
            "battery; 0: never. One that precedes by leader_priority takes over at once.",
        ),
    ] = 60.0
    gnss: Annotated[
        Gnss | tuple[VehicleId, ...],
        Field(
            description='Which vehicles have satellite positions: "all", "leader" (the first of leader_priority), or '
            "an array of ids. The others fly by odometry and by ranges to one another, or by trunks, and the mission "
            "has [ranging].",
        ),
    ] = Gnss.ALL
    position_error_max_m: Annotated[
        Number,
        Field(
            ge=1.0,
            le=1_000.0,
            description="Where not all have GNSS: a leader without a GNSS fix leads on by odometry until it may "
            "be off by so much, two standard deviations. Then the swarm does as position_uncertain says.",
        ),
    ] = 10.0
    position_uncertain: Annotated[
        PositionUncertain,
        Field(
            description="return: back along the leader's own way to where it left d1, and land there. hold: until a "
            "leader has a GNSS fix again, but for two minutes on the way at most; then land.",
        ),
    ] = PositionUncertain.RETURN
    start_timeout_s: Annotated[
        Number,
        Field(
            ge=0.0,
            le=3_600.0,
            description="How long to wait for absent vehicles before departing with those present, a "
            "majority at least.",
        ),
    ] = 30.0

    @field_validator("gnss", mode="before")
    @classmethod
    def _all_leader_or_ids(cls, gnss: object) -> object:
        if isinstance(gnss, str) and gnss in tuple(Gnss):
            return Gnss(gnss)
        ids = gnss if isinstance(gnss, (list, tuple)) else (None,)
        if not all([type(one) is int and 1 <= one <= MAX_VEHICLES for one in ids]) or len(set(ids)) != len(ids):
            raise ValueError(f'must be "all", "leader", or an array of ids, 1 to {MAX_VEHICLES}, each at most once')
        return tuple(ids)

    @field_validator("leader_priority")
    @classmethod
    def _ids_listed_once(cls, ids: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(ids)) != len(ids):
            raise ValueError("each id at most once")
        return ids


class Radio(Table):
    """Links between vehicles."""

    transit_range_m: Annotated[
        Number,
        Field(gt=0.0, le=RANGE_MAX_M, description="Range that the formation is kept within on the way, out and back."),
    ] = 30.0
    full_range_m: Annotated[
        Number, Field(gt=0.0, le=RANGE_MAX_M, description="Range r at full power, used in coverage.")
    ] = 55.0
    beacon_rate_hz: Annotated[
        Number,
        Field(
            description="Beacons per second from each vehicle: the paper's f. Divides the 20 Hz of control.",
            json_schema_extra={"enum": list(BEACON_RATES_HZ)},
        ),
    ] = 10.0

    bit_rate_kbps: Annotated[
        Number | None,
        Field(
            ge=20.0,
            le=1e6,
            examples=[250.0],
            description="Of the channel that all radios share: records are sent in what beacons leave of it. The "
            "simulator's radio is then as slow. Optional: records take 1000 kbit/s to be there, and the simulator's "
            "radio has no limit.",
        ),
    ] = None

    @field_validator("beacon_rate_hz")
    @classmethod
    def _whole_number_of_ticks(cls, rate_hz: float) -> float:
        if rate_hz not in BEACON_RATES_HZ:
            raise ValueError(f"must be one of {', '.join(f'{rate:g}' for rate in BEACON_RATES_HZ)}")
        return rate_hz


class Separation(Table):
    """Distances that vehicles keep from one another, between centres."""

    hard_m: Annotated[
        Number,
        Field(gt=0.0, le=1_000.0, description="What the safety filter keeps between two vehicles, centre to centre."),
    ] = 5.0
    soft_m: Annotated[
        Number,
        Field(
            gt=0.0,
            le=1_000.0,
            description="Repulsion starts at this distance: at most 70 % of radio.transit_range_m.",
        ),
    ] = 10.0
    height_layers: Annotated[
        Boolean,
        Field(
            description="Parts of the swarm that do not hear one another fly at different heights, where the fence has "
            "room for them. Needs a downward range finder on every vehicle: the preflight asks for it."
        ),
    ] = False


class Coverage(Table):
    """Spread of the vehicles around d2 once the leader has arrived."""

    shape: Annotated[
        CoverageShape,
        Field(description="ring: level, around a trunk at the height of d2. sphere: around d2 in open sky."),
    ] = CoverageShape.RING
    radius_m: Annotated[Number, Field(gt=0.0, le=RANGE_MAX_M, description="Radius of the ring or sphere.")] = 15.0
    keep_out_m: Annotated[
        Number,
        Field(
            gt=0.0,
            le=RANGE_MAX_M,
            description="Never closer than this to d2: horizontally, to its vertical axis, for a ring; in "
            "space for a sphere.",
        ),
    ] = 2.0
    duration_s: Annotated[
        Number,
        Field(
            ge=0.0,
            le=86_400.0,
            description="How long to stay in coverage before route.at_end; longer, by at most 60 s, where the ring or "
            "sphere has not been formed for the last 5 s. 0: no coverage.",
        ),
    ] = 60.0


class Limits(Table):
    """Limits that a setpoint never exceeds."""

    speed_max_mps: Annotated[Number, Field(gt=0.0, le=30.0, description="Speed in any direction.")] = 5.0
    climb_max_mps: Annotated[Number, Field(gt=0.0, le=15.0, description="Vertical speed, up and down.")] = 1.5
    acceleration_max_mps2: Annotated[Number, Field(gt=0.0, le=20.0, description="Acceleration in any direction.")] = 3.0


class Fence(Table):
    """The volume that no vehicle leaves."""

    altitude_min_m: Annotated[
        Number,
        Field(ge=0.0, le=COORDINATE_MAX_M, description="Lowest height above the origin's ground, once flying."),
    ] = 2.0
    altitude_max_m: Annotated[
        Number, Field(gt=0.0, le=COORDINATE_MAX_M, description="Greatest height above the origin's ground.")
    ] = 30.0
    polygon_enu_m: Annotated[
        tuple[tuple[Coordinate, Coordinate], ...] | None,
        Field(
            min_length=3,
            max_length=64,
            description="Optional boundary: east, north of 3 to 64 vertices in order, either way round, the "
            "first not repeated, edges not crossing.",
        ),
    ] = None

    @field_validator("polygon_enu_m")
    @classmethod
    def _simple(cls, polygon: tuple[tuple[float, float], ...] | None) -> tuple[tuple[float, float], ...] | None:
        return _simple_polygon(polygon)


class Sensing(Table):
    """Obstacle sensor of every vehicle, and how far it keeps from what it sees."""

    range_m: Annotated[Number, Field(ge=1.0, le=100.0, description="How far the sensor sees.")] = 8.0
    rate_hz: Annotated[Number, Field(ge=1.0, le=50.0, description="Scans per second.")] = 10.0
    field_of_view_deg: Annotated[
        Number, Field(ge=30.0, le=360.0, description="Width of a scan, level, to both sides of ahead.")
    ] = 360.0
    vehicle_radius_m: Annotated[
        Number, Field(gt=0.0, le=5.0, description="From a vehicle's centre to the tips of its propellers.")
    ] = VEHICLE_RADIUS_M
    margin_m: Annotated[
        Number, Field(ge=0.0, le=10.0, description="What is kept beyond vehicle_radius_m from all that was seen.")
    ] = 0.3
    stale_s: Annotated[
        Number,
        Field(
            gt=0.0,
            le=STALE_MAX_S,
            description="A vehicle whose last scan is older brakes and holds. What no scan has hit for 4 s is "
            "forgotten.",
        ),
    ] = 0.3
    sensor: Annotated[
        SensorClass,
        Field(
            description="72 sectors (OBSTACLE_DISTANCE), or a lidar's raw scan (SWARM_LIDAR_SCAN): of 1 degree up to "
            "12 m, of 0.5 degree up to 20 m, or of 15 layers between -7 and 52 degrees up to 40 m."
        ),
    ] = SensorClass.SECTORS
    upside_down: Annotated[
        Boolean,
        Field(description="The multi-layer lidar hangs below the vehicle: its layers are between -52 and 7 degrees."),
    ] = False
    sends_odometry: Annotated[
        Boolean,
        Field(
            description="The autopilot is told of the own motion by trunks (ODOMETRY; to ArduPilot "
            "VISION_SPEED_ESTIMATE), and flies on by it when it loses its GNSS fix. For vehicles with GNSS; the "
            "autopilot must be set to use it (PX4: EKF2_EV_CTRL 4)."
        ),
    ] = False


class Until(Table):
    """End of coverage before its time: the leader knows the stand well enough."""

    basal_area_pct: Annotated[
        Number,
        Field(
            ge=1.0,
            le=100.0,
            description="Half of the interval of the basal area per hectare, over it: from here on it is enough.",
        ),
    ]
    confidence: Annotated[
        Number, Field(ge=0.5, le=0.999, description="That the true basal area is in that interval.")
    ] = 0.95
    after_s: Annotated[
        Number,
        Field(
            ge=1.0,
            le=86_400.0,
            description="Time at a tree before which coverage never ends by this, whatever the figures: no followers "
            "believe it sooner.",
        ),
    ] = 10.0


class Survey(Table):
    """Stems measured by every vehicle along its way, with a lidar that tells every ray."""

    reach_m: Annotated[
        Number,
        Field(
            ge=2.0,
            le=20.0,
            description="How near, level, a trunk must be for its rays to count: farther off too few hit it.",
        ),
    ] = 7.0
    dbh_min_m: Annotated[
        Number, Field(ge=0.03, le=1.0, description="Stems that are thinner at breast height (1.3 m) are not recorded.")
    ] = 0.08
    taper_cm_per_m: Annotated[
        Number,
        Field(
            ge=0.0,
            le=5.0,
            description="By how much a stem gets thinner with height: what brings the diameter of a cut at another "
            "height to breast height.",
        ),
    ] = 1.0
    taper_sd_cm_per_m: Annotated[
        Number,
        Field(ge=0.0, le=5.0, description="Standard deviation of that between trees: part of such a diameter's error."),
    ] = 0.4
    until: Annotated[
        Until | None,
        Field(
            description="The leader goes on from a tree before its time, and from lanes to d2 once the first has been "
            "flown, when it knows the stand so well. Left out: it stays the whole time, and flies all lanes.",
            examples=[{"basal_area_pct": 10.0, "confidence": 0.95}],
        ),
    ] = None
    area_enu_m: Annotated[
        tuple[tuple[Coordinate, Coordinate], ...] | None,
        Field(
            min_length=3,
            max_length=64,
            examples=[[[20.0, -30.0], [100.0, -30.0], [100.0, 30.0], [20.0, 30.0]]],
            description="Boundary of a stand that is surveyed on the way from d1 to d2, instead of stops: as "
            "fence.polygon_enu_m. The swarm flies lanes over it, at the height of d2, so that stems are passed on two "
            "sides, and stand figures are of it. Left out: none are flown, and stand figures are of the fence.",
        ),
    ] = None
    lane_m: Annotated[
        Number | None,
        Field(
            ge=1.0,
            le=1_000.0,
            description="How far apart lanes are, at most. Left out: the width of the swarm, which flies them line "
            "abreast, and 85 % of the reach.",
        ),
    ] = None
    rise_to_m: Annotated[
        Number | None,
        Field(
            gt=0.0,
            le=COORDINATE_MAX_M,
            examples=[25.0],
            description="Greatest height above the origin's ground to which the leader rises in coverage, to deliver "
            "records that the base station has not acknowledged: only where its own rays have seen the column above "
            "free, and alone; fence.altitude_max_m holds all others, and itself elsewhere. Left out: nobody rises.",
        ),
    ] = None

    @field_validator("area_enu_m")
    @classmethod
    def _simple(cls, polygon: tuple[tuple[float, float], ...] | None) -> tuple[tuple[float, float], ...] | None:
        return _simple_polygon(polygon)


class Ranging(Table):
    """The range radio that every vehicle carries, and where they start.

    Where not all have GNSS they fly by it, or by trunks alone; where all have, positions are held against it.
    """

    radio: Annotated[
        Boolean,
        Field(
            description="false: no vehicle carries a range radio, and those without satellites find one another by "
            "trunks alone: sensing.sensor must tell raw scans, and swarm.gnss leave some without.",
        ),
    ] = True

    start_enu_m: Annotated[
        tuple[tuple[Coordinate, Coordinate, Coordinate], ...],
        Field(
            max_length=MAX_VEHICLES,
            examples=[[[-4.0, -4.0, 0.0], [4.0, -4.0, 0.0], [4.0, 4.0, 0.0], [-4.0, 4.0, 0.0]]],
            description="Where vehicle 1, 2, ... stands at the start: east, north in metres from the origin, to "
            "within about 0.5 m, and 0: on the ground, wherever it is. At least as many as swarm.size, where not all "
            "have GNSS; else of no account.",
        ),
    ] = ()
    reach_m: Annotated[
        Number, Field(ge=5.0, le=500.0, description="How far apart two vehicles still measure their distance.")
    ] = 25.0
    rate_hz: Annotated[
        Number,
        Field(ge=1.0, le=20.0, description="How often each two of them do, where the radio has the time for it."),
    ] = 10.0


SensorName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_-]{0,31}$")]


class MissionTables(Table):
    """All tables of a mission file, each valid by itself; mission.rules says what they must satisfy together."""

    # The key `schema` of the file: pydantic keeps that attribute for itself
    schema_version: Integer = Field(alias="schema", ge=1, le=1, description="Version of this layout.", examples=[1])
    name: Annotated[Text, Field(max_length=80, description="For people: it heads reports and logs.")] = ""
    sensors: Annotated[
        tuple[SensorName, ...],
        Field(
            max_length=8,
            description="Sensors of installed packages (entry points `understory.sensors`) that every vehicle carries "
            "besides, by name.",
            examples=[["rangefinder"]],
        ),
    ] = ()
    origin: Annotated[
        Origin | None,
        Field(description="Anchor of the ENU frame on Earth. Optional: the simulator supplies one."),
    ] = None
    route: Annotated[Route, Field(description="From deployment to destination.")]
    swarm: Annotated[Swarm, Field(description="Which vehicles fly, and which may lead.")] = Swarm()
    radio: Annotated[Radio, Field(description="Links between vehicles.")] = Radio()
    separation: Annotated[Separation, Field(description="How far vehicles stay apart.")] = Separation()
    coverage: Annotated[Coverage, Field(description="How vehicles spread around d2.")] = Coverage()
    limits: Annotated[Limits, Field(description="What a setpoint never exceeds.")] = Limits()
    fence: Annotated[Fence, Field(description="The volume that no vehicle leaves.")] = Fence()
    sensing: Annotated[
        Sensing | None,
        Field(
            description="Optional: every vehicle carries a sensor that sees obstacles, and flies by it. Left out: none "
            "does, and companions know the trunk at d2 alone."
        ),
    ] = None
    ranging: Annotated[
        Ranging | None,
        Field(
            description="Optional: every vehicle carries a radio that measures the distance to others, unless `radio` "
            "is false. Needed where swarm.gnss leaves some without satellite positions."
        ),
    ] = None
    survey: Annotated[
        Survey | None,
        Field(
            description="Optional: every vehicle measures the stems along its way (`sensing.sensor` must tell raw "
            "scans), keeps a record of each, and passes its records on to the base station."
        ),
    ] = None
    payload: Annotated[
        tuple[Payload, ...],
        Field(
            max_length=PAYLOADS_MAX,
            description="Optional: quantities that every vehicle records along its way besides, one table for each: "
            "light, humidity, temperature. Its records go to the base station as those of a survey do.",
        ),
    ] = ()
    forest: Annotated[Forest, Field(description="What grows there, for the simulator.")] = Forest()
    sim: Annotated[Sim, Field(description="For the simulator alone.")] = Sim()

    def has_satellites(self, vehicle_id: int) -> bool:
        """True if this vehicle has satellite positions (`swarm.gnss`)."""
        gnss = self.swarm.gnss
        if isinstance(gnss, tuple):
            return vehicle_id in gnss
        return gnss is Gnss.ALL or self.swarm.leader_priority[:1] == (vehicle_id,)

    @property
    def without_satellites(self) -> frozenset[int]:
        """Ids of the vehicles that have no satellite positions."""
        return frozenset(k for k in range(1, self.swarm.size + 1) if not self.has_satellites(k))

    @property
    def keeps_records(self) -> bool:
        """Vehicles make records, and there is a base station for them."""
        return self.survey is not None or bool(self.payload)

    @property
    def rise_to_m(self) -> float | None:
        """Greatest height of the one vehicle that may rise above `fence.altitude_max_m`; None: none may."""
        return None if self.survey is None else self.survey.rise_to_m

    @property
    def ceiling_m(self) -> float:
        """Height that no vehicle exceeds: autopilots' fences are set to it."""
        return self.fence.altitude_max_m if self.rise_to_m is None else self.rise_to_m

    @property
    def flies_by_ranges(self) -> bool:
        """Some vehicles have no satellite positions: all find one another by odometry and ranges."""
        return not all(map(self.has_satellites, range(1, self.swarm.size + 1)))

    @property
    def has_range_radios(self) -> bool:
        """Every vehicle carries a radio that measures the distance to others."""
        return self.ranging is not None and self.ranging.radio

    @property
    def shares_trunks(self) -> bool:
        """Vehicles that find one another by ranges tell one another of trunks: not by sectors, which look alike."""
        return self.flies_by_ranges and self.sensing is not None and self.sensing.sensor in RAW_LIDARS

    @property
    def visits(self) -> tuple[Visit, ...]:
        """The places that are covered, in order; d2 is the last, and for most missions the only one."""
        stay_s = self.coverage.duration_s
        stops = (Visit(s.pos_enu_m, stay_s if s.duration_s is None else s.duration_s) for s in self.route.stops)
        ends = ((*end, self.route.d2_enu_m[2]) for lane in self.lanes for end in (lane.start, lane.end))
        return (
            *(Visit(end_enu_m, 0.0, is_passed=True) for end_enu_m in ends),
            *stops,
            Visit(self.route.d2_enu_m, stay_s),
        )

    @property
    def trees(self) -> tuple[Visit, ...]:
        """The visits that are covered; d2 is the last."""
        return tuple(visit for visit in self.visits if not visit.is_passed)

    @property
    def named_places(self) -> tuple[tuple[str, Vec3], ...]:
        """d1, the stops or the ends of lanes, d2, with their names; ENU m."""
        ends = (f"lane {k}{end}" for k in range(1, len(self.lanes) + 1) for end in ("", " end"))
        stops = (f"stop {k}" for k in range(1, len(self.route.stops) + 1))
        return tuple(zip(("d1", *ends, *stops, "d2"), self.way_enu_m, strict=True))

    @property
    def way_enu_m(self) -> tuple[Vec3, ...]:
        """d1, the visits, d2: ENU m. The swarm goes straight from each to the next."""
        return (self.route.d1_enu_m, *(visit.pos_enu_m for visit in self.visits))

    @property
    def way_m(self) -> float:
        """The way from d1 over all visits to d2."""
        return sum(math.dist(a, b) for a, b in pairwise(self.way_enu_m))

    @property
    def swath(self) -> Swath:
        """Distances of the lanes of this swarm."""
        lane_m = None if self.survey is None else self.survey.lane_m
        return swath_of(line=self.line_abreast, size=self.swarm.size, reach_m=self._reach_m, lane_m=lane_m)

    @property
    def line_abreast(self) -> LineAbreast:
        """Line abreast of this swarm, on lanes."""
        return line_abreast(
            size=self.swarm.size,
            soft_m=self.separation.soft_m,
            reach_m=self._reach_m,
            range_m=self.radio.full_range_m,
        )

    @property
    def _reach_m(self) -> float:
        """Stems are measured so far."""
        survey, sensing = self.survey or Survey(), self.sensing or Sensing()
        return min(survey.reach_m, sensing.range_m)

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """Lanes over the stand that is surveyed, in the order in which they are flown; without one none."""
        if self.survey is None or self.survey.area_enu_m is None:
            return ()
        swath, (d1, d2) = self.swath, (self.route.d1_enu_m, self.route.d2_enu_m)
        slack_m = FENCE_SLACK_M + swath.spread_m / 2.0
        return lay_lanes(self.survey.area_enu_m, swath, (d1[:2], d2[:2]), self.fence.polygon_enu_m, slack_m)

    @property
    def surveyed_enu_m(self) -> tuple[tuple[float, float], ...] | None:
        """The ground that stand figures are of: that of the lanes, else the fence's; None: all that is seen."""
        area = None if self.survey is None else self.survey.area_enu_m
        return self.fence.polygon_enu_m if area is None else area

    @field_validator("name")
    @classmethod
    def _printable(cls, name: str) -> str:
        if not name.isprintable():
            raise ValueError("must be one line of printable characters")
        return name
