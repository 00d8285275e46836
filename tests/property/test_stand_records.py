"""A stand from whatever records a radio brings: it never raises, and says figures that are numbers or nothing."""

from __future__ import annotations

import math
from dataclasses import astuple

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.stand.figures.estimate import figures_of
from companion.stand.fusion.fuse import fuse
from companion.stand.products.report import report_page
from companion.stand.records import StoredRecord, harvest_of
from companion.survey.observation import STEM_KIND, Grade, StemObservation, encode
from companion.survey.track import TRACK_KIND, TrackPoint, encode_track
from mission.document.model import Mission


def single(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high)  # encoded in single precision


PLACES = single(-20.0, 20.0) | single(-1e6, 1e6)
ERRORS = single(0.0, 1.0) | single(0.0, 1e6)
DIAMETERS = single(0.01, 1.0) | single(0.002, 19.9)
STEMS = st.builds(
    StemObservation,
    vehicle_id=st.just(0),
    first_s=st.floats(0.0, 100.0),
    last_s=st.floats(100.0, 1e12),
    north_m=PLACES,
    east_m=PLACES,
    position_sd_m=ERRORS,
    frame_sd_m=ERRORS,
    cut_up_m=single(-100.0, 200.0),
    diameter_m=DIAMETERS,
    diameter_sd_m=single(0.0, 19.9),
    dbh_m=DIAMETERS,
    dbh_sd_m=single(0.0, 19.9),
    is_dbh_measured=st.booleans(),
    lean_rad=st.none() | single(0.0, 1.5),
    arc_share=single(0.0, 1.0),
    rays=st.integers(0, 1_000_000),
    grade=st.sampled_from(Grade),
    reason=st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=40),
)
POINTS = st.builds(
    TrackPoint,
    vehicle_id=st.just(0),
    at_s=st.floats(0.0, 200.0) | st.floats(0.0, 1e12),
    north_m=PLACES,
    east_m=PLACES,
    frame_sd_m=ERRORS,
    range_m=single(0.0, 12.0) | single(0.0, 1000.0),
    shift_ne_m=st.none() | st.tuples(PLACES, PLACES),
)
BODIES = st.one_of(
    st.tuples(st.just(STEM_KIND), STEMS.map(encode)),
    st.tuples(st.just(TRACK_KIND), POINTS.map(encode_track)),
    st.tuples(st.sampled_from([STEM_KIND, TRACK_KIND, 3]), st.binary(max_size=60)),
)
SOMEWHERE = Mission.model_validate(
    {
        "schema": 1,
        "route": {"d1_enu_m": (0.0, 0.0, 5.0), "d2_enu_m": (40.0, 30.0, 5.0), "vel_leader_mps": 1.0},
        "swarm": {"size": 2},
    }
)
RECORDS = st.lists(st.tuples(st.integers(1, 3), st.integers(0, 1), BODIES), max_size=40)


@settings(max_examples=40)
@given(RECORDS)
def test_any_records_make_a_report_with_numbers_that_are_numbers(
    told: list[tuple[int, int, tuple[int, bytes]]],
) -> None:
    records = [StoredRecord(v, log, k, kind, 0.0, body) for k, (v, log, (kind, body)) in enumerate(told, start=1)]
    harvest = harvest_of(records)
    fusion = fuse(harvest.observations)
    ground = figures_of(harvest, fusion, area_m=None)
    assert report_page(SOMEWHERE, harvest, fusion, ground).endswith("</html>\n")
    assert sorted(i for stem in fusion.stems for i in stem.observed) == list(range(len(harvest.observations)))
    for stem in fusion.stems:
        numbers = [value for value in astuple(stem) if isinstance(value, float)]
        assert all(map(math.isfinite, numbers))
    if ground.figures is not None:
        estimate = ground.figures.stems_per_ha
        assert estimate.low is None or estimate.low <= estimate.value <= estimate.high
