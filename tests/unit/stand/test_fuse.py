"""Observations of many vehicles become stems: each once, where it stands, as thick as it is."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from companion.stand.figures.estimate import figures_of
from companion.stand.figures.ground import track_of
from companion.stand.fusion import fuse as fuse_module
from companion.stand.fusion import windows
from companion.stand.fusion.fuse import TooManyError, fuse
from companion.stand.fusion.odometry import odometry_of
from companion.stand.records import StoredRecord, harvest_of
from companion.survey.observation import STEM_KIND, Grade, StemObservation, decode, encode
from companion.survey.track import TRACK_KIND, TrackPoint, encode_track
from tests.bench.stand_figures import drawn
from tests.unit.stand.stand_kit import Survey, clustered_stand, records_of, regular_stand, rows_of, said, tree_of

SIZE_M = (40.0, 30.0)


def fused(observations: list[StemObservation], log_id: int = 7):
    """As if each vehicle had written them in this order."""
    records = [
        StoredRecord(o.vehicle_id, log_id, k, STEM_KIND, o.last_s, encode(o))
        for k, o in enumerate(observations, start=1)
    ]
    return fuse(harvest_of(records).observations)


def surveyed(trees, survey: Survey):
    """Harvest of a survey of SIZE_M."""
    return harvest_of(records_of(trees, rows_of((0.0, 0.0), SIZE_M, survey), survey))


def test_two_vehicles_that_see_one_stem_make_one_stem_with_a_smaller_error() -> None:
    one = said(1, north_m=5.0, east_m=3.0, dbh_m=0.30)
    other = said(2, north_m=5.1, east_m=3.1, dbh_m=0.31)
    (stem,) = fused([one, other]).stems
    assert stem.vehicles == (1, 2)
    assert 0.30 < stem.dbh_m < 0.31
    assert stem.dbh_sd_m < one.dbh_sd_m
    assert stem.position_sd_m < one.frame_sd_m


def test_two_stems_that_one_vehicle_saw_at_one_time_stay_two_however_close() -> None:
    beside = [said(1, north_m=5.0, east_m=east_m, dbh_m=0.2) for east_m in (3.0, 3.15)]
    assert len(fused(beside).stems) == 2
    later = [beside[0], replace(beside[1], first_s=200.0, last_s=210.0)]
    assert len(fused(later).stems) == 1  # on another pass it is the same stem, seen again


def test_diameters_tell_two_neighbours_apart() -> None:
    thin, thick = (said(1, north_m=5.0, east_m=east_m, dbh_m=dbh_m) for east_m, dbh_m in ((3.0, 0.15), (3.8, 0.45)))
    shifted = [replace(o, vehicle_id=2, east_m=o.east_m + 0.5) for o in (thin, thick)]  # the thin one between both
    stems = fused([thin, thick, *shifted]).stems
    assert sorted(round(s.dbh_m, 2) for s in stems) == [0.15, 0.45]
    assert all(s.vehicles == (1, 2) for s in stems)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("make", [regular_stand, clustered_stand])
def test_frames_that_are_off_by_more_than_stems_are_apart_are_found_by_the_constellation(make, seed: int) -> None:
    trees = make(seed, 500.0, east_m=SIZE_M[0], north_m=SIZE_M[1])
    survey = Survey(seed=seed, vehicles=5, frame_sd_m=1.0)
    harvest = surveyed(trees, survey)
    stems = fuse(harvest.observations).stems
    seen = {tree_of(o.observation) for o in harvest.observations}
    assert abs(len(stems) - len(seen)) <= 0.03 * len(seen)


@pytest.mark.parametrize("seed", range(3))
def test_positions_and_diameters_are_as_far_off_as_their_errors_say(seed: int) -> None:
    trees = regular_stand(seed, 400.0, east_m=SIZE_M[0], north_m=SIZE_M[1])
    harvest = surveyed(trees, Survey(seed=seed))
    stems = fuse(harvest.observations).stems
    found = [(s, tree_of(harvest.observations[s.observed[0]].observation)) for s in stems]
    off_m = np.asarray([(s.east_m - trees.east_m[k], s.north_m - trees.north_m[k]) for s, k in found])
    told_m = np.asarray([s.position_sd_m for s, _ in found])
    within = np.hypot(*(off_m - off_m.mean(axis=0)).T)  # less what no vehicle knows: where all of them are
    assert np.sqrt((within**2).mean()) < 0.3
    assert np.hypot(*off_m.mean(axis=0)) < 3.0 * told_m.mean()
    diameters = np.asarray([(s.dbh_m - trees.dbh_m[k]) / s.dbh_sd_m for s, k in found])
    assert 0.5 < np.sqrt((diameters**2).mean()) < 1.5


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_the_order_of_arrival_and_duplicates_change_nothing(seed: int, twice: int) -> None:
    trees = clustered_stand(3, 400.0, east_m=20.0, north_m=20.0)
    survey = Survey(seed=3, vehicles=3)
    records = records_of(trees, rows_of((0.0, 0.0), (20.0, 20.0), survey), survey)
    first = fuse(harvest_of(records).observations)
    mixed = records + records[:twice]
    random.Random(seed).shuffle(mixed)
    again = fuse(harvest_of(mixed).observations)
    assert again.stems == first.stems


def test_a_stem_keeps_its_id_as_more_is_seen_of_it() -> None:
    first = said(2, north_m=5.0, east_m=3.0)
    (stem,) = fused([first]).stems
    (seen_again,) = fused([first, replace(first, first_s=90.0, last_s=95.0), said(3, north_m=5.1, east_m=3.0)]).stems
    assert seen_again.stem_id == stem.stem_id == "2-00000007-1"


def test_a_vehicle_that_lost_its_disk_starts_another_log_with_errors_of_its_own() -> None:
    trees = [(2.0, 1.0, 0.2), (6.0, 3.0, 0.3), (9.0, 8.0, 0.4), (3.0, 7.0, 0.25)]
    before = [said(1, north_m=n, east_m=e, dbh_m=d) for n, e, d in trees]
    after = [replace(o, north_m=o.north_m + 1.5) for o in before]  # its position jumped when it was started again
    records = [
        StoredRecord(1, log_id, k, STEM_KIND, 0.0, encode(o))
        for log_id, told in ((7, before), (9, after))
        for k, o in enumerate(told, start=1)
    ]
    fusion = fuse(harvest_of(records).observations)
    assert fusion.logs == ((1, 7, 0), (1, 9, 0))
    assert len(fusion.stems) == len(trees)


def test_one_wrong_diameter_among_five_hardly_moves_the_stem() -> None:
    good = [said(v, north_m=5.0, east_m=3.0, dbh_m=0.30) for v in (1, 2, 3, 4)]
    (stem,) = fused([*good, said(5, north_m=5.0, east_m=3.0, dbh_m=0.45)]).stems
    assert stem.dbh_m == pytest.approx(0.30, abs=0.015)


def test_one_wrong_position_among_five_counts_less() -> None:
    good = [replace(said(v, north_m=5.0, east_m=3.0), frame_sd_m=0.01) for v in (1, 2, 3, 4)]
    (stem,) = fused([*good, replace(good[0], vehicle_id=5, east_m=3.3)]).stems
    assert stem.vehicles == (1, 2, 3, 4, 5)
    assert stem.east_m < 3.04  # the plain mean is 3.06


def test_frames_of_which_two_fit_each_other_in_a_wrong_place_are_found() -> None:
    judged = drawn(5079, frame_sd_m=1.5)  # comes out a third too dense where windows of 20 s are registered alone
    assert judged is not None
    assert abs(judged.stems / judged.observed - 1.0) < 0.03


def test_an_error_by_taper_is_not_averaged_away() -> None:
    tapered = [
        replace(said(v, north_m=5.0, east_m=3.0), dbh_sd_m=0.02, diameter_sd_m=0.005, cut_up_m=4.0) for v in range(1, 9)
    ]
    (stem,) = fused(tapered).stems
    assert stem.dbh_from == "taper"
    assert stem.dbh_sd_m > 0.019
    (measured,) = fused([*tapered, replace(said(9, north_m=5.0, east_m=3.0), is_dbh_measured=True)]).stems
    assert measured.dbh_from == "measured and taper"
    assert measured.dbh_sd_m < 0.013


def test_poor_observations_alone_make_a_stem_that_is_not_counted() -> None:
    poor = [replace(said(v, north_m=5.0, east_m=3.0), grade=Grade.POOR, reason="few rays") for v in (1, 2)]
    (stem,) = fused(poor).stems
    assert not stem.is_counted
    assert stem.reason == "few rays"
    (better,) = fused([*poor, said(3, north_m=5.0, east_m=3.0)]).stems
    assert better.is_counted
    assert better.reason == ""


def test_nothing_observed_is_no_stem() -> None:
    assert fuse(()).stems == ()


def test_more_observations_than_the_bound_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuse_module, "MAX_OBSERVATIONS", 1)
    with pytest.raises(TooManyError, match="2 observations of stems: must be at most 1"):
        fused([said(1, north_m=5.0, east_m=3.0), said(2, north_m=9.0, east_m=3.0)])


def test_clocks_that_say_nonsense_do_not_make_the_matrix_large() -> None:
    wild = [said(1, north_m=5.0 * k, east_m=3.0, at_s=10.0 ** (k % 9)) for k in range(60)]
    fusion = fused(wild)
    assert len(fusion.frames.knots.log) <= 2 * len(wild)
    assert len(fusion.stems) == len(wild)


def test_a_position_far_from_all_others_is_left_out_and_counted() -> None:
    told = [said(1, north_m=4.0 * k, east_m=3.0) for k in range(5)]
    wild = replace(told[0], first_s=90.0, last_s=95.0, north_m=9e5)
    records = [StoredRecord(1, 7, k, STEM_KIND, 0.0, encode(o)) for k, o in enumerate([*told, wild], start=1)]
    records.append(StoredRecord(1, 7, 9, TRACK_KIND, 0.0, encode_track(TrackPoint(1, 10.0, -9e5, 0.0, 1.0, 8.0))))
    harvest = harvest_of(records)
    assert (len(harvest.observations), len(harvest.track), harvest.refused) == (5, 0, 2)


def test_a_frame_error_that_is_unknown_spoils_nothing() -> None:
    told = [said(v, north_m=4.0 * k, east_m=3.0, dbh_m=0.1 + 0.05 * k) for v in (1, 2) for k in range(6)]
    lost = [replace(o, frame_sd_m=1e6) if o.vehicle_id == 2 else o for o in told]
    stems = fused(lost).stems
    assert len(stems) == 6
    assert all(s.vehicles == (1, 2) and s.position_sd_m < 1.0 for s in stems)


def test_a_long_survey_has_knots_farther_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "MAX_KNOTS", 8)
    told = [said(1, north_m=4.0 * k, east_m=3.0, at_s=60.0 * k) for k in range(40)]
    fusion = fused(told)
    assert len(fusion.frames.knots.log) <= 8
    assert len(fusion.stems) == len(told)


def test_malformed_bodies_are_counted_and_left_out() -> None:
    good = encode(said(1, north_m=5.0, east_m=3.0))
    bodies = [b"", b"\xff" * 20, good, good[:-1]]
    harvest = harvest_of([StoredRecord(1, 7, k, STEM_KIND, 0.0, body) for k, body in enumerate(bodies, start=1)])
    assert len(harvest.observations) == 1
    assert harvest.refused == 3
    assert decode(good, 1) is not None


def test_stems_of_a_survey_stand_apart() -> None:
    trees = clustered_stand(5, 500.0, east_m=SIZE_M[0], north_m=SIZE_M[1])
    stems = fuse(surveyed(trees, Survey(seed=5)).observations).stems
    places = np.asarray([(s.east_m, s.north_m) for s in stems])
    pairs = cKDTree(places).query_pairs(0.5)
    assert all(stems[a].dbh_m + stems[b].dbh_m < 2.4 * float(np.hypot(*(places[a] - places[b]))) for a, b in pairs)


def flown_again(records: list[StoredRecord], *, log_id: int) -> list[StoredRecord]:
    """The same flight once more, after those numbers, by clocks that started anew."""
    last = {v: max(r.number for r in records if r.vehicle_id == v) for v in {r.vehicle_id for r in records}}
    return [r._replace(log_id=log_id, number=last[r.vehicle_id] + r.number) for r in records]


def two_flights(log_id: int) -> list[StoredRecord]:
    """Over the same trees; the second one's records are in this log."""
    trees = regular_stand(2, 300.0, east_m=20.0, north_m=20.0)
    first, second = (
        records_of(trees, rows_of((0.0, 0.0), (20.0, 20.0), survey), survey)
        for survey in (Survey(seed=2, vehicles=2), Survey(seed=3, vehicles=2))
    )
    return [*first, *flown_again(second, log_id=log_id)]


def test_a_second_flight_in_the_same_log_makes_no_stem_twice() -> None:
    one_log, two_logs = harvest_of(two_flights(7)), harvest_of(two_flights(8))
    stems, expected = (fuse(harvest.observations).stems for harvest in (one_log, two_logs))
    seen = {tree_of(o.observation) for o in one_log.observations}
    assert len(stems) == len(expected)
    assert abs(len(stems) - len(seen)) <= 0.05 * len(seen)
    figures, as_expected = (figures_of(h, fuse(h.observations), area_m=None).figures for h in (one_log, two_logs))
    assert figures is not None
    assert as_expected is not None
    assert figures.stems_per_ha.value == pytest.approx(as_expected.stems_per_ha.value, rel=0.01)


def test_two_flights_in_one_log_are_the_same_in_any_order() -> None:
    records = two_flights(7)
    mixed = [*records, *records[::5]]
    random.Random(5).shuffle(mixed)
    assert fuse(harvest_of(mixed).observations).stems == fuse(harvest_of(records).observations).stems


def test_a_stem_keeps_its_id_when_a_later_flights_clock_is_younger() -> None:
    first = said(2, north_m=5.0, east_m=3.0, at_s=50.0)
    again = replace(first, first_s=9.0, last_s=13.0)
    (stem,) = fused([first, again]).stems
    assert stem.stem_id == "2-00000007-1"


def test_records_a_little_out_of_order_are_of_one_session() -> None:
    beside = [said(1, north_m=5.0, east_m=e, dbh_m=0.2, at_s=at_s) for e, at_s in ((3.0, 12.0), (3.15, 9.0))]
    assert len(fused(beside).stems) == 2  # seen at one time


def test_more_restarts_than_the_bound_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuse_module, "MAX_LOGS", 2)
    told = [said(1, north_m=5.0, east_m=3.0, at_s=at_s) for at_s in (90.0, 60.0, 30.0)]
    with pytest.raises(TooManyError, match="3 logs and restarts"):
        fused(told)


def test_vehicles_that_know_the_frame_by_anothers_word_do_not_move_the_map() -> None:
    """Three of them err by one and the same metre and a half: that is one word, and not three measurements."""
    rng = np.random.default_rng(3)
    places = rng.uniform(0.0, 30.0, (20, 2))
    seen = [
        replace(
            said(vehicle, north_m=north + 1.5 * (vehicle > 1), east_m=east, dbh_m=0.15 + 0.02 * k, at_s=20.0 * vehicle),
            frame_sd_m=1.0 if vehicle == 1 else 1.4,
        )
        for vehicle in (1, 2, 3, 4)
        for k, (north, east) in enumerate(places)
    ]
    records = [StoredRecord(o.vehicle_id, 7, k, STEM_KIND, o.last_s, encode(o)) for k, o in enumerate(seen, start=1)]
    observations = harvest_of(records).observations

    def off_m(by_word: tuple[int, ...]) -> float:
        stems = fuse(observations, by_word).stems
        assert len(stems) == len(places)
        near, _ = cKDTree(places).query([(stem.north_m, stem.east_m) for stem in stems])
        return float(np.mean(near))

    assert off_m(()) > 0.7
    assert off_m((2, 3, 4)) < 0.3


def walked(
    *, tells: bool, swing_m: float = 2.0, compass_deg: float = 0.0, seen_to_m: float = 30.0
) -> tuple[list[StoredRecord], np.ndarray]:
    """Of two vehicles, and the trees: the first saw those up to seen_to_m, by satellites. The second went on alone.

    It knows the mission's frame by a word that swings within 40 s; its odometry goes by a compass, and is right but for
    that. `tells`: in its track.
    """
    rng = np.random.default_rng(8)
    trees = np.column_stack((rng.uniform(-6.0, 6.0, 60), np.sort(rng.uniform(0.0, 150.0, 60))))
    cos, sin = math.cos(math.radians(compass_deg)), math.sin(math.radians(compass_deg))
    by_compass = np.array([[cos, -sin], [sin, cos]])

    def added_m(at_s: float) -> np.ndarray:
        here = np.array([0.0, 1.5 * (at_s - 10.0)])
        return here - by_compass @ here + swing_m * np.array([math.sin(at_s / 6.0), math.cos(at_s / 6.0)])

    seen, track = [], []
    for k, (north, east) in enumerate(trees):
        at_s, dbh_m = 10.0 + east / 1.5, 0.15 + 0.005 * k
        if east < seen_to_m:
            seen.append(said(1, north_m=north, east_m=east, dbh_m=dbh_m, at_s=at_s))
        told = by_compass @ trees[k] + (added_m(at_s) + added_m(at_s + 4.0)) / 2.0
        seen.append(said(2, north_m=float(told[0]), east_m=float(told[1]), dbh_m=dbh_m, at_s=at_s))
    for at_s in np.arange(4.0, 124.0, 2.0).tolist():
        added = added_m(at_s)
        told = by_compass @ np.array([0.0, 1.5 * (at_s - 10.0)]) + added
        shift = (float(added[0]), float(added[1])) if tells else None
        track.append(TrackPoint(2, at_s, float(told[0]), float(told[1]), 0.6, 7.0, shift))
    made = [(o.last_s, o.vehicle_id, STEM_KIND, encode(o)) for o in seen]
    made += [(p.at_s, p.vehicle_id, TRACK_KIND, encode_track(p)) for p in track]
    records = [StoredRecord(who, 7, k, kind, at_s, body) for k, (at_s, who, kind, body) in enumerate(sorted(made), 1)]
    return records, trees


def test_what_a_vehicle_saw_stays_together_as_its_odometry_had_it() -> None:
    def worst_m(*, tells: bool) -> float:
        records, trees = walked(tells=tells)
        harvest = harvest_of(records)
        stems = fuse(harvest.observations, (2,), harvest.track).stems
        assert len(stems) == len(trees)
        return float(cKDTree(trees).query([(stem.north_m, stem.east_m) for stem in stems])[0].max())

    assert worst_m(tells=True) < 0.4
    assert worst_m(tells=False) > 1.5


@pytest.mark.parametrize("compass_deg", [-6.0, 5.0])
def test_odometry_by_a_wrong_compass_is_turned_to_what_others_saw(compass_deg: float) -> None:
    records, trees = walked(tells=True, compass_deg=compass_deg, seen_to_m=75.0)
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations, (2,), harvest.track)
    assert len(fusion.stems) == len(trees)
    assert cKDTree(trees).query([(stem.north_m, stem.east_m) for stem in fusion.stems])[0].max() < 0.5
    frame = fusion.frames.odometry[1]
    assert frame is not None
    assert math.degrees(frame.turn_rad) == pytest.approx(-compass_deg, abs=0.3)


def test_a_track_lies_where_its_stems_do() -> None:
    records, _ = walked(tells=True)
    harvest = harvest_of(records)
    track = track_of(harvest.track, fuse(harvest.observations, (2,), harvest.track))
    assert np.abs(track.pos_m[:, 1]).max() < 0.4  # north of the way that was flown
    assert np.abs(track.pos_m[:, 0] - 1.5 * (track.time_s - 10.0)).max() < 0.4


def test_a_shift_that_no_vehicle_can_have_is_not_gone_by() -> None:
    assert len(odometry_of(harvest_of(walked(tells=True)[0]).track)) == 1
    assert not odometry_of(harvest_of(walked(tells=True, swing_m=40.0)[0]).track)
