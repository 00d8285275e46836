"""Figures per hectare: what was seen, what was missed, and how far they may be off."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.stand.figures.detection import fit_detection, sightings_of
from companion.stand.figures.estimate import figures_of
from companion.stand.figures.ground import grid_of, looks_at, track_of, within_area
from companion.stand.fusion.fuse import fuse
from companion.stand.records import StoredRecord, harvest_of
from companion.survey.observation import STEM_KIND, Grade, decode, encode
from companion.survey.track import TRACK_KIND, TrackPoint, encode_track
from tests.bench.stand_figures import drawn, judge
from tests.unit.stand.stand_kit import Survey, records_of, regular_stand, rows_of, said

AREA = ((0.0, 0.0), (40.0, 0.0), (40.0, 30.0), (0.0, 30.0))
SURVEY = Survey(seed=2, vehicles=4)


def surveyed(survey: Survey = SURVEY, seed: int = 1, north_m: float = 30.0):
    """Trees, and the harvest of what was flown over up to `north_m`."""
    trees = regular_stand(seed, 400.0, east_m=40.0, north_m=30.0)
    return trees, harvest_of(records_of(trees, rows_of((0.0, 0.0), (40.0, north_m), survey), survey))


def figures(harvest, area_m=AREA):
    return figures_of(harvest, fuse(harvest.observations), area_m=area_m)


def track(*points: tuple[float, float, float]):
    """Time, east, north of vehicle 1, that sees 10 m far, and no stem."""
    records = [
        StoredRecord(1, 7, k, TRACK_KIND, at_s, encode_track(TrackPoint(1, at_s, north_m, east_m, 0.5, 10.0)))
        for k, (at_s, east_m, north_m) in enumerate(points, start=1)
    ]
    harvest = harvest_of(records)
    return track_of(harvest.track, fuse(()))


def test_the_truth_is_inside_the_intervals_of_drawn_stands() -> None:
    judged = [j for seed in range(801, 813) if (j := drawn(seed)) is not None]
    assert len(judged) == 12
    for name in ("stems_per_ha", "basal_area", "dbh_mean_cm", "dbh_quadratic_mean_cm"):
        held = [e.low <= true <= e.high for true, e in (getattr(j, name) for j in judged)]
        assert sum(held) >= 11, name


def test_stems_that_were_missed_are_made_up_for() -> None:
    seldom = Survey(seed=5, vehicles=6, found_in_step=0.12)
    trees = regular_stand(5, 400.0, east_m=80.0, north_m=60.0)
    judged = judge("", 5, trees, (80.0, 60.0), seldom, 1.0)
    assert judged is not None
    true, estimate = judged.stems_per_ha
    harvest = harvest_of(records_of(trees, rows_of((0.0, 0.0), (80.0, 60.0), seldom), seldom))
    ground = figures_of(
        harvest, fuse(harvest.observations), area_m=((0.0, 0.0), (80.0, 0.0), (80.0, 60.0), (0.0, 60.0))
    )
    assert ground.figures is not None
    assert ground.figures.stems / ground.figures.seen_ha < 0.85 * true  # as many were found
    assert estimate.value == pytest.approx(true, rel=0.15)


def test_what_was_not_seen_widens_the_interval() -> None:
    def half_width(north_m: float) -> float:
        told = figures(surveyed(north_m=north_m)[1]).figures
        assert told is not None
        assert told.basal_area_m2_per_ha.low is not None
        return math.log(told.basal_area_m2_per_ha.high / told.basal_area_m2_per_ha.low)

    assert half_width(15.0) > 1.5 * half_width(30.0)


def test_ground_that_was_looked_at_once_is_not_seen() -> None:
    one = Survey(seed=2, vehicles=1, lane_m=25.0)
    told = figures(surveyed(one)[1])
    assert told.figures is None
    assert not told.is_seen.any()


def test_poor_observations_neither_count_nor_make_detection_look_better() -> None:
    _, harvest = surveyed()
    whole = figures(harvest).figures
    half = [
        r
        if r.kind == TRACK_KIND or k % 2
        else StoredRecord(*r[:5], encode(replace(decode(r.body, r.vehicle_id), grade=Grade.POOR, reason="few rays")))
        for k, r in enumerate(harvest.records)
    ]
    told = figures(harvest_of(half)).figures
    assert whole is not None
    assert told is not None
    assert told.stems < whole.stems
    assert told.stems_per_ha.value == pytest.approx(whole.stems_per_ha.value, rel=0.12)


def test_ground_looked_at_once_counts_where_stems_looked_at_twice_tell_what_that_misses() -> None:
    three = Survey(seed=2, vehicles=3, lane_m=10.0, sight_m=9.0)  # lanes see half of each other's ground
    trees, harvest = surveyed(three)
    told = figures(harvest).figures
    assert told is not None
    assert told.seen_ha > 0.11
    inside = (trees.east_m > 0.0) & (trees.east_m < 40.0) & (trees.north_m > 0.0) & (trees.north_m < 30.0)
    true = float((inside & (trees.dbh_m >= 0.1)).sum()) / 0.12
    assert told.stems_per_ha.low <= true <= told.stems_per_ha.high


def test_without_an_area_the_figures_are_of_the_ground_seen() -> None:
    told = figures(surveyed()[1], area_m=None).figures
    assert told is not None
    assert told.area_ha is None
    assert told.seen_ha > 0.15


def test_too_little_ground_has_no_figures() -> None:
    records = [StoredRecord(1, 7, k, STEM_KIND, 0.0, encode(said(1, north_m=4.0 * k, east_m=3.0))) for k in range(1, 6)]
    assert figures(harvest_of(records)).figures is None
    assert figures(harvest_of([])).figures is None


def test_the_volume_is_basal_area_times_the_form_height() -> None:
    _, harvest = surveyed()
    told = figures_of(harvest, fuse(harvest.observations), area_m=AREA, form_height_m=10.0).figures
    assert told is not None
    assert told.volume_m3_per_ha.value == pytest.approx(10.0 * told.basal_area_m2_per_ha.value)


def test_classes_of_diameter_add_up_to_all_stems() -> None:
    told = figures(surveyed()[1]).figures
    assert told is not None
    assert sum(c.stems_per_ha.value for c in told.classes) == pytest.approx(told.stems_per_ha.value)


def test_a_trunk_hides_what_is_behind_it_and_nothing_else() -> None:
    way = track((10.0, 0.0, 0.0), (12.0, 0.0, 0.1))
    behind, beside, before = (6.0, 0.0), (0.0, 6.0), (2.0, 0.0)
    looks = looks_at(np.asarray([behind, beside, before]), way, np.asarray([(4.0, 0.0)]), np.asarray([0.3]))
    assert looks.place.tolist() == [1, 2]


def test_a_place_that_was_out_of_sight_for_a_while_was_looked_at_twice() -> None:
    way = track((10.0, 0.0, 0.0), (12.0, 1.0, 0.0), (14.0, 40.0, 0.0), (40.0, 1.0, 0.0))
    looks = looks_at(np.asarray([(0.0, 5.0)]), way, np.zeros((0, 2)), np.zeros(0))
    assert looks.points.sum(axis=1).tolist() == [2.0, 1.0]
    assert looks.first_s.tolist() == [10.0, 40.0]


def test_a_vehicle_that_hovers_does_not_look_ever_better() -> None:
    way = track(*[(10.0 + 2.0 * k, 0.1 * (k % 2), 0.0) for k in range(60)])
    looks = looks_at(np.asarray([(0.0, 5.0)]), way, np.zeros((0, 2)), np.zeros(0))
    assert looks.points.sum(axis=1).tolist() == [15.0]  # one look, of a point every 8 s
    assert looks.last_s - looks.first_s == pytest.approx(112.0)


def test_the_grid_is_what_is_within_sight_and_in_the_area() -> None:
    way = track((10.0, 0.0, 0.0))
    assert len(grid_of(way, None).middle_m) == pytest.approx(math.pi * 100.0, rel=0.03)
    half = grid_of(way, ((-50.0, 0.0), (50.0, 0.0), (50.0, 50.0), (-50.0, 50.0)))
    assert len(half.middle_m) == pytest.approx(math.pi * 50.0, rel=0.03)
    assert len(grid_of(way, ((100.0, 100.0), (120.0, 100.0), (120.0, 120.0))).middle_m) == 0


def test_within_area_heeds_notches() -> None:
    notched = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (5.0, 5.0), (0.0, 10.0))
    inside = within_area(np.asarray([(2.0, 2.0), (5.0, 8.0), (9.0, 8.0), (11.0, 1.0)]), notched)
    assert inside.tolist() == [True, False, True, False]


def test_detection_is_recovered_from_what_looks_found() -> None:
    rng = np.random.default_rng(4)
    way = track(*[(10.0 + 30.0 * k, 0.0, 0.0) for k in range(4)])  # four looks at all within 10 m
    places = rng.uniform(-7.0, 7.0, (600, 2))
    looks = looks_at(places, way, np.zeros((0, 2)), np.zeros(0))
    chance = np.where(np.hypot(*places.T) < 6.0, 0.7, 0.3)
    hit = rng.random(len(looks.place)) < chance[looks.place]
    found = np.bincount(looks.place, hit, len(places)) > 0
    stems = looks_at(places[found], way, np.zeros((0, 2)), np.zeros(0))
    fit = fit_detection(sightings_of(stems, np.full(int(found.sum()), 0.25)), hit[found[looks.place]])
    near, far = 1.0 - np.exp(-np.exp(fit.values[[1, 4]]))
    assert near == pytest.approx(0.7, abs=0.06)
    assert far == pytest.approx(0.3, abs=0.08)
