"""The part of a mission that says what grows there: `[forest]`. mission.stand makes a stand of it."""

from __future__ import annotations

import re
from typing import Annotated

from pydantic import Field, field_validator

from mission.common import plane
from mission.schema.boxes import StandBox, box_of
from mission.schema.fields import Coordinate, Integer, Number, Table, Text
from mission.schema.trees import Species, StandTree, height_of_m, tree_of

MAX_BOXES = 64
MAX_TREES = 700  # about what a file of 64 KiB can hold
MAX_STAND_TREES = 20_000  # 600 trees/ha over 33 ha
M2_PER_HA = 1e4
_FILE_NAME = re.compile(
    r"[^/\\:\x00-\x1f]+\.(?:csv|geojson|json|gpkg)", re.IGNORECASE
)  # beside the mission wherever it is copied


class Tree(Table):
    """A trunk: an upright cylinder on the ground, without a crown."""

    base_enu_m: Annotated[
        tuple[Coordinate, Coordinate],
        Field(examples=[[130.0, 0.0]], description="East, north of the trunk's axis, metres from the origin."),
    ]
    trunk_radius_m: Annotated[Number, Field(gt=0.0, le=10.0, examples=[0.3], description="Radius of the trunk.")]
    height_m: Annotated[
        Number, Field(gt=0.0, le=150.0, examples=[25.0], description="Height of the trunk above the ground.")
    ]


class Box(Table):
    """An upright block on the ground that is no tree, such as a wall or a building."""

    centre_enu_m: Annotated[
        tuple[Coordinate, Coordinate],
        Field(examples=[[60.0, 5.0]], description="East, north of its middle, metres from the origin."),
    ]
    length_m: Annotated[
        Number,
        Field(
            gt=0.0, le=1_000.0, examples=[12.0], description="Its side that lies east and west where it is not turned."
        ),
    ]
    width_m: Annotated[
        Number, Field(gt=0.0, le=1_000.0, examples=[3.0], description="Its other side. Of a wall: how thick it is.")
    ]
    height_m: Annotated[
        Number, Field(gt=0.0, le=500.0, examples=[10.0], description="Height above the ground at its middle.")
    ]
    rotation_deg: Annotated[
        Number, Field(ge=-360.0, le=360.0, description="How far it is turned, clockwise from above, as headings are.")
    ] = 0.0

    @property
    def block(self) -> StandBox:
        """Its geometry."""
        return box_of(
            self.centre_enu_m,
            length_m=self.length_m,
            width_m=self.width_m,
            height_m=self.height_m,
            rotation_deg=self.rotation_deg,
        )


class StandSpec(Table):
    """A stand that the simulator generates from the seed."""

    seed: Annotated[
        Integer | None,
        Field(
            ge=0,
            le=2**32 - 1,
            description="The same seed generates the same trees. Left out: sim.seed, so that each seed of a study has "
            "a forest of its own.",
        ),
    ] = None
    density_per_ha: Annotated[
        Number, Field(gt=0.0, le=3_000.0, examples=[400.0], description="Trees per hectare of its area.")
    ]
    margin_m: Annotated[
        Number,
        Field(
            ge=0.0,
            le=1_000.0,
            description="It covers the rectangle, east and north, that is this much wider than the route on each "
            "side. Not heeded with `area_enu_m`.",
        ),
    ] = 50.0
    area_enu_m: Annotated[
        tuple[tuple[Coordinate, Coordinate], ...] | None,
        Field(
            min_length=3,
            max_length=64,
            description="Optional: the area instead, as east, north of 3 to 64 vertices, as `fence.polygon_enu_m`.",
        ),
    ] = None
    spacing_min_m: Annotated[
        Number, Field(ge=0.1, le=50.0, description="Least distance between the axes of two trunks.")
    ] = 1.5
    dbh_min_m: Annotated[
        Number, Field(ge=0.02, le=2.0, description="Least diameter at breast height (1.3 m): where the Weibull begins.")
    ] = 0.1
    dbh_mean_m: Annotated[
        Number, Field(gt=0.0, le=2.0, description="Mean diameter of the Weibull distribution, before it is cut off.")
    ] = 0.25
    dbh_max_m: Annotated[Number, Field(gt=0.0, le=3.0, description="Greatest diameter: it is cut off there.")] = 0.6
    dbh_shape: Annotated[
        Number,
        Field(
            ge=0.5,
            le=20.0,
            description="Shape of the Weibull distribution: 1 or less, mostly thin trees, as in natural stands of all "
            "ages; 3.6, nearly normal, as in managed stands of one age.",
        ),
    ] = 2.0
    species: Annotated[
        tuple[Species, ...],
        Field(
            min_length=1,
            max_length=8,
            description="Drawn from in equal shares (one that is listed twice is twice as frequent): they say how tall "
            "and wide a tree of its diameter is.",
        ),
    ] = (Species.SPRUCE,)
    height_mean_m: Annotated[
        Number | None,
        Field(
            ge=2.0,
            le=100.0,
            description="Height of a tree of `dbh_mean_m`; the others are taller or lower by the curve of their "
            "species. Left out: as the curve has it.",
        ),
    ] = None
    crown_base_share: Annotated[
        Number, Field(ge=0.0, le=1.0, description="Height of the crown's base, as a share of the tree's height.")
    ] = 0.6
    undergrowth_per_ha: Annotated[
        Number, Field(ge=0.0, le=5_000.0, description="Bushes per hectare, 0.2 to 0.6 m in radius.")
    ] = 0.0
    undergrowth_height_m: Annotated[
        Number, Field(ge=0.3, le=5.0, description="Height of the tallest of them; the least is 0.3 m.")
    ] = 1.5
    clearing_m: Annotated[
        Number,
        Field(ge=1.0, le=100.0, description="Nothing stands this near to the simulator's starting points at d1."),
    ] = 2.0

    @field_validator("area_enu_m")
    @classmethod
    def _simple(cls, area: tuple[tuple[float, float], ...] | None) -> tuple[tuple[float, float], ...] | None:
        fault = area and plane.polygon_fault(area)
        if fault:
            raise ValueError(fault)
        return area

    def tree(self, east_m: float, north_m: float, dbh_m: float, species: Species) -> StandTree:
        """A tree of this stand."""
        share = 1.0 if self.height_mean_m is None else self.height_mean_m / height_of_m(self.dbh_mean_m, species)
        crown = self.crown_base_share
        return tree_of(east_m, north_m, dbh_m, species, crown_base_share=crown, height_share=share)


class Shapes(Table):
    """Shapes of trunks for lidars that tell every ray, drawn tree by tree from the seed; others see cylinders."""

    lean_deg: Annotated[
        Number, Field(ge=0.0, le=10.0, description="Standard deviation of a trunk's lean, north and east.")
    ] = 1.5
    ellipse: Annotated[
        Number,
        Field(
            ge=0.0, le=0.5, description="Standard deviation of how much a section's diameters differ, over their mean."
        ),
    ] = 0.06
    taper_exponent: Annotated[
        Number,
        Field(
            ge=0.1,
            le=2.0,
            description="Mean exponent p of a trunk's taper, d(h) = DBH ((H - h) / (H - 1.3))^p: at 4 m of a tree of "
            "20 m and 25 cm, 0.7 makes it 2.5 cm thinner.",
        ),
    ] = 0.7
    taper_exponent_sd: Annotated[Number, Field(ge=0.0, le=1.0, description="Its standard deviation.")] = 0.15
    bark_m: Annotated[
        Number, Field(ge=0.0, le=0.05, description="Roughness of bark, rms; at most a tenth of the radius.")
    ] = 0.004
    forks: Annotated[
        Number, Field(ge=0.0, le=1.0, description="Share of trunks that fork, between 1.8 and 7 m up.")
    ] = 0.03
    stubs_per_tree: Annotated[
        Number, Field(ge=0.0, le=20.0, description="Mean number of stubs of branches, 0.5 to 6 m up.")
    ] = 1.0
    saplings_per_ha: Annotated[
        Number, Field(ge=0.0, le=5_000.0, description="Saplings of 2 to 7 cm, 1.5 to 3.5 m tall. None is touched.")
    ] = 100.0
    litter_per_ha: Annotated[
        Number, Field(ge=0.0, le=5_000.0, description="Heaps and stones of 5 to 25 cm on the ground. None is touched.")
    ] = 200.0


class Forest(Table):
    """The forest as the simulator has it. Companions never see it: they know d2, and what their sensors tell."""

    grade: Annotated[
        tuple[Annotated[Number, Field(ge=-0.7, le=0.7)], Annotated[Number, Field(ge=-0.7, le=0.7)]],
        Field(
            description="Slope of the ground: how much it rises per metre east and per metre north; 0.1 is 10 %. "
            "Heights of d1, d2 and the fence count from the ground at the origin all the same.",
        ),
    ] = (0.0, 0.0)
    file: Annotated[
        Text | None,
        Field(
            max_length=80,
            description="Optional: a stem map beside the mission's file, measured trees as CSV, GeoJSON (.geojson or "
            ".json) or GeoPackage (.gpkg), by its name alone: `stems.csv`.",
        ),
    ] = None
    stand: Annotated[
        StandSpec | None, Field(description="Optional: a stand that the simulator generates from the seed.")
    ] = None
    trees: Annotated[
        tuple[Tree, ...],
        Field(max_length=MAX_TREES, description="Single trunks, one table for each, besides those of a stand."),
    ] = ()
    shapes: Annotated[
        Shapes | None,
        Field(
            description="Optional: trunks lean, get thinner with height, and have a section and bark of their own, for "
            "lidars whose scans are raw. A vehicle still touches the upright cylinder. Left out: all are cylinders."
        ),
    ] = None
    boxes: Annotated[
        tuple[Box, ...],
        Field(
            max_length=MAX_BOXES,
            description="Walls and buildings, one table for each. Lidars see them, and a vehicle that touches one "
            "falls. A link or a measured range across one is weakened as by one trunk; satellites are received "
            "through it.",
        ),
    ] = ()

    @field_validator("file")
    @classmethod
    def _name_alone(cls, file: str | None) -> str | None:
        if file is not None and not _FILE_NAME.fullmatch(file):
            raise ValueError(
                "must be the name of a .csv, .geojson, .json or .gpkg file beside the mission's, without folders"
            )
        return file
