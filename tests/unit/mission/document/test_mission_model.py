"""The model: defaults, immutability, checked copies."""

from __future__ import annotations

import math
import pickle
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import BaseModel, ValidationError

import mission
from mission.common.plane import clearance_m, polygon_fault
from mission.common.problems import MissionError
from mission.document import model
from mission.document.load import load_mission
from mission.document.model import AtEnd, CoverageShape, Mission, Origin, Placement
from mission.rules.flight_rules import coverage_spacing_m
from mission.schema.json_schema import json_schema

EXAMPLES = Path(mission.__file__).parent / "examples"
LEAST: dict[str, Any] = {
    "schema": 1,
    "route": {"d1_enu_m": [0, 0, 8], "d2_enu_m": [130, 0, 8], "vel_leader_mps": 3},
}
SQUARE = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))


def test_only_the_schema_and_the_route_must_be_decided() -> None:
    least = Mission.model_validate(LEAST)

    assert least.name == ""
    assert least.origin is None
    assert least.route.arrival_distance_m == 5.0
    assert least.route.at_end is AtEnd.HOLD
    assert least.swarm.size == 8
    assert least.swarm.leader_priority == ()
    assert least.swarm.start_timeout_s == 30.0
    assert least.swarm.reelection_period_s == 60.0
    assert (least.radio.transit_range_m, least.radio.full_range_m, least.radio.beacon_rate_hz) == (
        30.0,
        55.0,
        10.0,
    )
    assert (least.separation.hard_m, least.separation.soft_m) == (5.0, 10.0)
    assert least.coverage.shape is CoverageShape.RING
    assert (least.coverage.radius_m, least.coverage.keep_out_m, least.coverage.duration_s) == (
        15.0,
        2.0,
        60.0,
    )
    assert (least.limits.speed_max_mps, least.limits.climb_max_mps) == (5.0, 1.5)
    assert least.limits.acceleration_max_mps2 == 3.0
    assert (least.fence.altitude_min_m, least.fence.altitude_max_m) == (2.0, 30.0)
    assert least.fence.polygon_enu_m is None
    assert least.forest.trees == ()
    assert (least.sim.seed, least.sim.wind_mps, least.sim.turbulence_mps) == (1, (0.0, 0.0, 0.0), 0.0)
    assert (least.sim.radio_loss, least.sim.radio_delay_s, least.sim.time_limit_s) == (0.0, 0.0, None)
    assert (least.sim.placement, least.sim.placement_spacing_m) == (Placement.RANDOM, 6.0)


def test_integers_stand_for_floats_and_come_out_as_floats() -> None:
    least = Mission.model_validate(LEAST)

    assert all(isinstance(metres, float) for metres in least.route.d2_enu_m)
    assert isinstance(least.route.vel_leader_mps, float)


def test_a_mission_cannot_be_changed() -> None:
    least = Mission.model_validate(LEAST)

    with pytest.raises(ValidationError, match="frozen"):
        least.route.vel_leader_mps = 4.0
    assert hash(least) == hash(Mission.model_validate(LEAST))


def test_a_mission_with_values_for_single_vehicles_reaches_another_process_as_it_is() -> None:
    sim = {"personalities": {2: "ardupilot"}, "battery_mah": {3: 1000.0}}
    mixed = Mission.model_validate({**LEAST, "sim": sim})

    sent: Mission = pickle.loads(pickle.dumps(mixed))
    assert sent == mixed
    assert hash(sent) == hash(mixed)
    with pytest.raises(TypeError, match="cannot be changed"):
        sent.sim.battery_mah[3] = 2.0


def test_the_options_have_the_names_of_the_file() -> None:
    assert [str(option.value) for option in AtEnd] == ["hold", "land", "return"]
    assert [str(option.value) for option in CoverageShape] == ["ring", "sphere"]
    assert [str(option.value) for option in Placement] == ["random", "grid", "ring"]


@pytest.mark.parametrize("example", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
@pytest.mark.parametrize("n", [1, 4, 8, 12])
def test_the_examples_fly_with_the_papers_swarm_sizes(example: Path, n: int) -> None:
    flown = load_mission(example).with_size(n)

    assert flown.swarm.size == n
    assert flown.origin is None


def test_the_papers_example_has_the_papers_figures() -> None:
    paper = load_mission(EXAMPLES / "paper.toml")

    assert paper.route.d1_enu_m == (25.0, 25.0, 25.0)
    assert paper.route.d2_enu_m == (100.0, 100.0, 100.0)
    assert paper.route.vel_leader_mps == 0.7
    assert paper.radio.full_range_m == 55.0
    assert paper.swarm.size == 8
    assert paper.route.length_m == pytest.approx(129.904, abs=1e-3)


def test_the_lone_tree_stands_at_d2() -> None:
    lone = load_mission(EXAMPLES / "lone_tree.toml")

    assert lone.forest.trees[0].base_enu_m == lone.route.d2_enu_m[:2]
    assert lone.coverage.duration_s == 45.0


# Copies


def test_a_copy_with_another_seed_differs_in_nothing_else() -> None:
    first = Mission.model_validate(LEAST)
    other = first.with_seed(7)

    assert other.sim.seed == 7
    assert other.with_seed(first.sim.seed) == first


def test_a_copy_with_an_origin_gives_it_to_the_frames() -> None:
    placed = Mission.model_validate(LEAST).with_origin(Origin(lat_deg=49.5, lon_deg=6.36, alt_m=310.0))

    assert placed.origin is not None
    assert (placed.origin.wgs84.lat_deg, placed.origin.wgs84.lon_deg, placed.origin.wgs84.alt_m) == (
        49.5,
        6.36,
        310.0,
    )


def test_a_refused_size_names_the_option_that_it_came_from() -> None:
    with pytest.raises(MissionError) as caught:
        Mission.model_validate(LEAST).with_size(0)
    assert str(caught.value) == "--n: swarm.size = 0: must be an integer from 1 to 250"


def test_a_size_that_does_not_fit_the_ring_names_the_option_and_what_it_conflicts_with() -> None:
    with pytest.raises(MissionError) as caught:
        Mission.model_validate(LEAST).with_size(40, place="--vehicles")
    (problem,) = caught.value.problems
    assert (problem.place, problem.line, problem.key, problem.value) == (
        "--vehicles",
        None,
        "coverage.radius_m",
        "15.0",
    )
    assert "swarm.size = 40, separation.hard_m = 5.0" in problem.message


def test_a_smaller_swarm_must_still_hold_the_predetermined_leader() -> None:
    led = Mission.model_validate({**LEAST, "swarm": {"leader_priority": [8, 1]}})

    with pytest.raises(MissionError, match=r"swarm.leader_priority = \[8, 1\]: has no vehicle 8.*swarm.size = 4"):
        led.with_size(4)


def test_a_refused_seed_names_its_option() -> None:
    with pytest.raises(MissionError, match=r"--seed: sim.seed = -1: must be an integer from 0 to 4294967295"):
        Mission.model_validate(LEAST).with_seed(-1)


# Placement and coverage


@pytest.mark.parametrize("placement", list(Placement))
def test_a_vehicle_alone_starts_at_d1(placement: Placement) -> None:
    alone = Mission.model_validate({**LEAST, "swarm": {"size": 1}, "sim": {"placement": placement}})

    assert alone.placement_radius_m == 0.0


def test_the_ring_of_starting_points_leaves_the_spacing_between_neighbours() -> None:
    ring = Mission.model_validate({**LEAST, "sim": {"placement": "ring"}})

    assert 2.0 * ring.placement_radius_m * math.sin(math.pi / 8) == pytest.approx(6.0)


def test_the_grid_of_starting_points_is_the_smallest_square_that_holds_them() -> None:
    grid = Mission.model_validate({**LEAST, "swarm": {"size": 9}, "sim": {"placement": "grid"}})

    assert grid.placement_radius_m == pytest.approx(math.hypot(6.0, 6.0))


@pytest.mark.parametrize("n", [2, 3, 8, 50, 250])
def test_the_random_disc_leaves_room_for_blue_noise(n: int) -> None:
    values = {**LEAST, "swarm": {"size": n}, "coverage": {"radius_m": max(15.0, 1.2 * n), "duration_s": 0.0}}
    values["route"] = {**LEAST["route"], "d2_enu_m": [900, 0, 8]}
    disc_m = Mission.model_validate(values).placement_radius_m

    assert n * 3.0**2 / (disc_m + 3.0) ** 2 < 0.45  # well below where blue noise jams, 0.55


def test_neighbours_on_a_sphere_share_its_surface() -> None:
    values = {**LEAST, "coverage": {"shape": "sphere"}, "fence": {"altitude_max_m": 60}}
    values["route"] = {**LEAST["route"], "d2_enu_m": [130, 0, 20]}

    assert coverage_spacing_m(Mission.model_validate(values)) == pytest.approx(15.0 * math.sqrt(4.0 * math.pi / 8.0))


# Polygons


def test_clearance_is_the_distance_to_the_boundary_negative_outside() -> None:
    assert clearance_m((5.0, 3.0), SQUARE) == 3.0
    assert clearance_m((13.0, 14.0), SQUARE) == -5.0
    assert clearance_m((5.0, 3.0), SQUARE[::-1]) == 3.0


@pytest.mark.parametrize(
    ("polygon", "fault"),
    [
        (SQUARE, ""),
        (SQUARE[::-1], ""),
        (((0.0, 0.0), (5.0, 0.0), (10.0, 0.0), (5.0, 5.0)), ""),  # a vertex in the middle of a straight edge
        ((SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]), "cross or touch"),
        ((*SQUARE, SQUARE[0]), "must not repeat a vertex: [0] and [4]"),
        (((0.0, 0.0), (10.0, 0.0), (5.0, 0.0)), "cross or touch"),  # no area
        (((0.0, 0.0), (10.0, 0.0), (4.0, 0.0), (4.0, 5.0)), "cross or touch"),  # folds back on itself
        (
            ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 0.0), (0.0, 10.0)),
            "cross or touch",
        ),  # touches an edge
    ],
)
def test_a_polygon_must_be_simple(polygon: tuple[tuple[float, float], ...], fault: str) -> None:
    assert fault in polygon_fault(polygon)
    assert bool(fault) == bool(polygon_fault(polygon))


# The schema


def test_the_json_schema_is_valid_and_accepts_what_the_model_accepts() -> None:
    schema = json_schema(Mission)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)

    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    validator.validate(LEAST)
    validator.validate(Mission.model_validate(LEAST).model_dump(mode="json", by_alias=True, exclude_none=True))


@pytest.mark.parametrize(
    "change",
    [
        {"nmae": "x"},
        {"schema": 2},
        {"swarm": {"size": 0}},
        {"radio": {"beacon_rate_hz": 3}},
        {"route": {"d1_enu_m": [0, 0, 8], "vel_leader_mps": 3}},
        {"sim": {"time_limit_s": None}},
    ],
)
def test_the_json_schema_refuses_what_the_model_refuses(change: dict[str, object]) -> None:
    assert not jsonschema.Draft202012Validator(json_schema(Mission)).is_valid({**LEAST, **change})


def test_every_key_has_a_description() -> None:
    classes = [value for value in vars(model).values() if isinstance(value, type)]
    tables: list[type[BaseModel]] = [value for value in classes if issubclass(value, BaseModel)]
    assert Mission in tables
    undescribed = [
        f"{table.__name__}.{name}"
        for table in tables
        for name, field in table.model_fields.items()
        if not field.description
    ]
    assert undescribed == []


@pytest.mark.parametrize(
    "radio", [{"full_range_m": 6_501.0}, {"transit_range_m": 10_000.0, "full_range_m": 10_000.0}], ids=str
)
def test_a_range_that_a_beacon_cannot_carry_is_refused(radio: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match="less than or equal to 6500"):
        Mission.model_validate(LEAST | {"radio": radio})
