"""Reports of third vehicles: bounded whatever is said, and no member ends another's alarm."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from companion.core.localisation.peer_reports import PLACES_MAX, SAME_PLACE_M, PeerReports
from companion.core.localisation.peer_table import STALE_S
from companion.core.model.beacon import PeerReport
from companion.core.model.vectors import ZERO, norm, sub

SILENT, REPORTER, LIAR = 9, 1, 2
PLACE = (8.0, 0.0, 0.0)
BEGAN_S = 100.0
members = st.integers(1, 8)
words = st.builds(
    PeerReport,
    members,
    st.tuples(*[st.floats(-100.0, 100.0)] * 3),
    st.floats(0.0, 900.0),
    st.booleans(),
    st.integers(0, 7),
)


@given(st.lists(st.tuples(members, words, st.floats(0.0, 3.0)), max_size=60))
def test_the_table_is_bounded_whatever_is_said(said: list[tuple[int, PeerReport, float]]) -> None:
    reports, now_s = PeerReports(8, STALE_S), 1000.0
    for sender, word, later_s in said:
        now_s += later_s
        reports.store(sender, word, ZERO, now_s)
    assert all(len(word.places) <= PLACES_MAX for by in reports._words.values() for word in by.values())
    assert all(len(by) <= 8 for by in reports._words.values())
    assert max(len(reports._words), len(reports._refuted), len(reports._alarmed_s)) <= 8
    for vehicle in range(1, 9):
        assert len(reports.places(vehicle, ZERO, now_s, since_s=-1e9)) <= 8 * PLACES_MAX


@given(st.integers(2, 12), st.lists(st.tuples(words, st.floats(0.0, 2.0), st.booleans()), max_size=40))
def test_whatever_one_member_says_a_place_that_another_reports_stays_an_obstacle(
    size: int, said: list[tuple[PeerReport, float, bool]]
) -> None:
    """Before it and after: where it is taken to be moves by no more than two reports of one place differ."""
    reports, now_s = PeerReports(size, STALE_S), BEGAN_S
    reports.store(REPORTER, PeerReport(SILENT, PLACE, 5.0, silent=True), ZERO, now_s)
    for word, later_s, repeats in said:
        now_s += later_s
        reports.store(LIAR, PeerReport(SILENT, word.rel_ned_m, word.age_s, word.silent, word.relays), ZERO, now_s)
        if repeats:
            reports.store(REPORTER, PeerReport(SILENT, PLACE, 5.0 + now_s - BEGAN_S, silent=True), ZERO, now_s)
        found = reports.places(SILENT, ZERO, now_s, since_s=-1e9)
        assert min(norm(sub(k.rel_ned_m, PLACE)) for k in found) <= SAME_PLACE_M
