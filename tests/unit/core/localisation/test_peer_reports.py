"""Reports of third vehicles, by the member that sends them: one member's word ends no other's alarm."""

from __future__ import annotations

import pytest

from companion.core.localisation.peer_reports import (
    PASSED_ON_MAX,
    PLACES_MAX,
    RELAYED_S,
    SAME_PLACE_M,
    TAKEN_BACK,
    UNREPEATED_MAX,
    VOTE_S,
    PeerReports,
)
from companion.core.localisation.peer_table import STALE_S, TELL_AFTER_S, PeerTable
from companion.core.model.beacon import PeerReport
from companion.core.model.vectors import ZERO
from mission.common.frames import Vec3
from tests.unit.core.core_kit import heard_beacon

SILENT, REPORTER, LIAR = 9, 1, 2
PLACE = (8.0, 0.0, 0.0)
BEGAN_S = 100.0  # the reporter had heard it 5 s before


def alarm(rel: Vec3 = PLACE, *, age_s: float = 5.0, relays: int = 0) -> PeerReport:
    return PeerReport(SILENT, rel, age_s, silent=True, relays=relays)


def hears(age_s: float = 0.1, *, relays: int = 0) -> PeerReport:
    return PeerReport(SILENT, (30.0, 0.0, 0.0), age_s, silent=False, relays=relays)


def taken_back() -> PeerReport:
    return PeerReport(SILENT, ZERO, 0.0, silent=False, relays=TAKEN_BACK)


def reported(size: int = 10) -> PeerReports:
    reports = PeerReports(size, STALE_S)
    reports.store(REPORTER, alarm(), ZERO, BEGAN_S)
    return reports


def places(reports: PeerReports, now_s: float = BEGAN_S + 10.0) -> list[Vec3]:
    return [k.rel_ned_m for k in reports.places(SILENT, ZERO, now_s, since_s=-1e9)]


# --- who ends an alarm ---


@pytest.mark.parametrize("size", [2, 3, 4, 5, 8, 12])
def test_one_member_that_says_it_hears_a_silent_vehicle_ends_nobody_elses_alarm(size: int) -> None:
    reports = reported(size)
    for k in range(100):
        reports.store(LIAR, hears(), ZERO, BEGAN_S + 0.1 * k)
    assert places(reports) == [PLACE]


@pytest.mark.parametrize(("size", "enough"), [(4, 2), (5, 3), (6, 3), (8, 4), (12, 6)])
def test_a_majority_of_the_others_that_say_so_ends_it(size: int, enough: int) -> None:
    reports = reported(size)
    for k in range(enough - 1):
        reports.store(2 + k, hears(), ZERO, BEGAN_S + 0.1 * k)
    assert places(reports) == [PLACE]
    reports.store(1 + enough, hears(), ZERO, BEGAN_S + 0.1 * enough)
    assert places(reports) == []
    assert reports.vehicles() == set()


def test_a_majority_that_heard_it_before_it_fell_silent_ends_nothing() -> None:
    """All hear its last beacon at about the same time: what they say of that is said for a while."""
    reports = PeerReports(8, STALE_S)
    for k in range(2, 8):
        reports.store(k, hears(age_s=0.4), ZERO, BEGAN_S)
    reports.store(REPORTER, alarm(age_s=TELL_AFTER_S), ZERO, BEGAN_S - 0.4 + TELL_AFTER_S)
    assert places(reports) == [PLACE]


def test_a_lie_and_true_words_of_before_are_no_majority_that_has_heard_it_since() -> None:
    """As many as it takes say that they hear it, but only one has heard it after it fell silent."""
    reports = PeerReports(8, STALE_S)
    for k in range(3, 6):
        reports.store(k, hears(), ZERO, BEGAN_S)
    later_s = BEGAN_S + TELL_AFTER_S
    reports.store(REPORTER, alarm(age_s=TELL_AFTER_S + 0.1), ZERO, later_s)
    reports.store(LIAR, hears(), ZERO, later_s + 0.2)
    assert places(reports, later_s + 0.3) == [PLACE]


def test_words_count_together_only_within_a_while() -> None:
    reports = reported(5)
    for k in range(6):
        reports.store(2 + k % 3, hears(), ZERO, BEGAN_S + (VOTE_S + 0.2) * k)
    assert places(reports, BEGAN_S + 20.0) == [PLACE]


def test_one_who_calls_it_silent_again_does_not_count_as_one_who_hears_it() -> None:
    reports = reported(5)
    for sender in (2, 3):
        reports.store(sender, hears(), ZERO, BEGAN_S)
    reports.store(2, alarm((30.0, 0.0, 0.0), age_s=3.0), ZERO, BEGAN_S + 0.1)
    reports.store(4, hears(), ZERO, BEGAN_S + 0.2)
    assert places(reports) == [PLACE, (30.0, 0.0, 0.0)]


def test_an_alarm_from_before_a_majority_heard_it_does_not_begin_again_and_a_later_one_does() -> None:
    reports = reported(4)
    for sender in (2, 3):
        reports.store(sender, hears(), ZERO, BEGAN_S)
    reports.store(REPORTER, alarm(age_s=5.5), ZERO, BEGAN_S + 0.5)
    assert places(reports) == []
    reports.store(REPORTER, alarm(age_s=TELL_AFTER_S), ZERO, BEGAN_S + 1.0 + TELL_AFTER_S)
    assert places(reports) == [PLACE]


@pytest.mark.parametrize("answer", [hears(), taken_back()], ids=["hears it", "takes it back"])
def test_a_reporter_takes_its_own_word_back(answer: PeerReport) -> None:
    reports = reported()
    reports.store(REPORTER, answer, ZERO, BEGAN_S + 0.1)
    assert places(reports) == []


def test_one_that_takes_its_word_back_leaves_what_another_says() -> None:
    reports = reported()
    reports.store(LIAR, alarm(), ZERO, BEGAN_S)
    reports.store(LIAR, taken_back(), ZERO, BEGAN_S + 0.1)
    assert places(reports) == [PLACE]


def test_taking_back_is_no_word_that_it_is_heard() -> None:
    reports = reported(4)
    for sender in (2, 3):
        reports.store(sender, taken_back(), ZERO, BEGAN_S)
    assert places(reports) == [PLACE]


# --- places ---


def test_places_that_differ_add_up_and_those_that_do_not_are_one() -> None:
    reports = reported()
    reports.store(2, alarm((8.0 + 0.9 * SAME_PLACE_M, 0.0, 0.0)), ZERO, BEGAN_S)
    reports.store(3, alarm((20.0, 0.0, 0.0)), ZERO, BEGAN_S)
    assert places(reports) == [PLACE, (20.0, 0.0, 0.0)]


def test_a_place_stays_where_it_is_as_this_vehicle_moves() -> None:
    reports = PeerReports(8, STALE_S)
    reports.store(REPORTER, alarm(), (100.0, 50.0, -8.0), BEGAN_S)
    (found,) = reports.places(SILENT, (101.0, 50.0, -8.5), BEGAN_S + 1.0, since_s=-1e9)
    assert found.rel_ned_m == (7.0, 0.0, 0.5)
    assert (found.age_s, found.received) == (pytest.approx(6.0), True)


def test_members_first_places_come_before_anybodys_second() -> None:
    """Three are passed on: one member's false ones do not crowd out another's."""
    reports = PeerReports(8, STALE_S)
    for k in range(PLACES_MAX):
        reports.store(LIAR, alarm((30.0 + 5.0 * k, 0.0, 0.0)), ZERO, BEGAN_S)
    reports.store(3, alarm(relays=2), ZERO, BEGAN_S)
    assert places(reports)[1] == PLACE


def test_a_member_tells_of_so_many_places_of_a_vehicle_and_the_latest_count() -> None:
    reports = PeerReports(8, STALE_S)
    for k in range(10):
        reports.store(LIAR, alarm((5.0 * k, 0.0, 0.0)), ZERO, BEGAN_S)
    assert places(reports) == [(5.0 * k, 0.0, 0.0) for k in (9, 8, 7)]


def test_a_place_that_its_reporter_tells_no_more_while_it_tells_others_is_taken_back() -> None:
    reports = reported()
    for k in range(UNREPEATED_MAX):
        reports.store(REPORTER, alarm((20.0, 0.0, 0.0)), ZERO, BEGAN_S + 0.1 * k)
    assert places(reports) == [(20.0, 0.0, 0.0), PLACE]
    reports.store(REPORTER, alarm((20.0, 0.0, 0.0)), ZERO, BEGAN_S + 3.0)
    assert places(reports) == [(20.0, 0.0, 0.0)]


# --- members that pass it on: tables in a row, or in a ring ---


class Members:
    """Tables of members 1 to n at one place, and who hears whom; each passes on what it selects, ten times a second."""

    def __init__(self, count: int, links: set[tuple[int, int]], *, size: int = 9) -> None:
        self.tables = {k: PeerTable(size=size) for k in range(1, count + 1)}
        self.links, self.now_s = links | {(b, a) for a, b in links}, BEGAN_S
        self.hearers: set[int] = set()  # of the vehicle that others call silent
        self.silent: dict[int, dict[int, PeerReport]] = {}

    def run(self, seconds: float) -> None:
        for _ in range(round(10 * seconds)):
            self.now_s += 0.1
            said = {}
            for k, table in self.tables.items():
                if k in self.hearers:
                    time_ms = round(1e3 * self.now_s)
                    table.store_beacon(
                        heard_beacon(SILENT, airborne=True, time_ms=time_ms, rel_ned_m=PLACE), ZERO, self.now_s
                    )
                found = self.silent[k] = table.silent_airborne(ZERO, self.now_s, range_m=30.0)
                said[k] = table.select_report(found, table.neighbours(ZERO, self.now_s), ZERO, self.now_s)
            for sender, report in said.items():
                for k, table in self.tables.items():
                    if report is not None and (sender, k) in self.links:
                        table.store_report(sender, report, ZERO, self.now_s)

    def who_know(self) -> list[int]:
        return [k for k, found in self.silent.items() if SILENT in found]


RING = {(1, 2), (2, 3), (3, 4), (2, 4), (4, 5), (3, 5)}  # beyond 2 it goes round


def test_an_alarm_reaches_those_who_hear_the_reporter_only_over_others() -> None:
    members = Members(5, RING)
    members.hearers = {1}
    members.run(1.0)
    members.hearers = set()
    members.run(5.0)
    assert members.who_know() == [1, 2, 3, 4, 5]


def test_an_alarm_that_has_gone_round_ends_when_its_reporter_takes_it_back() -> None:
    """Beyond 2 they have told it to one another: nobody's word alone, heard from whom it was told, keeps it."""
    members = Members(5, RING)
    members.hearers = {1}
    members.run(1.0)
    members.hearers = set()
    members.run(5.0)
    members.hearers = {1}
    members.run(6.0)
    assert members.who_know() == []


def test_an_alarm_goes_over_so_many_members_and_no_farther() -> None:
    count = PASSED_ON_MAX + 3
    members = Members(count, {(k, k + 1) for k in range(1, count)}, size=count + 1)
    members.hearers = {1}
    members.run(1.0)
    members.hearers = set()
    members.run(10.0)
    assert members.who_know() == list(range(1, PASSED_ON_MAX + 3))


def test_a_majority_that_hears_it_ends_the_alarm_of_one_that_does_not_and_so_of_those_behind_it() -> None:
    """1 has lost it, and hears the majority; 5 hears 1 alone."""
    members = Members(5, {(1, 2), (1, 3), (1, 4), (1, 5)}, size=6)
    members.hearers = {1, 2, 3, 4}
    members.run(1.0)
    members.hearers = {2, 3, 4}
    members.run(5.0)
    assert members.who_know() == []


def test_while_too_few_hear_it_those_that_lost_it_keep_clear() -> None:
    members = Members(5, {(1, 2), (1, 3), (1, 4), (1, 5)}, size=6)
    members.hearers = {1, 2, 3, 4}
    members.run(1.0)
    members.hearers = {2, 3}
    members.run(5.0)
    assert 1 in members.who_know()


def test_place_at_which_a_member_hears_a_vehicle_is_kept_while_it_is_fresh() -> None:
    reports = PeerReports(8, 0.5)
    reports.store(3, PeerReport(2, (6.0, 0.0, 0.0), 0.2, silent=False), ZERO, 10.0)
    ((rel, age_s),) = reports.heard_places(2, (1.0, 0.0, 0.0), 10.3)
    assert rel == (5.0, 0.0, 0.0)
    assert age_s == pytest.approx(0.5)
    assert reports.heard_places(2, ZERO, 10.0 + RELAYED_S) == []


def test_of_places_that_are_the_same_the_newest_counts_and_others_add_up() -> None:
    reports = PeerReports(8, 0.5)
    for sender, north_m, age_s in ((3, 6.0, 0.4), (4, 6.3, 0.1), (5, 20.0, 0.0)):
        reports.store(sender, PeerReport(2, (north_m, 0.0, 0.0), age_s, silent=False), ZERO, 10.0)
    assert reports.heard_places(2, ZERO, 10.0) == [((20.0, 0.0, 0.0), 0.0), ((6.3, 0.0, 0.0), pytest.approx(0.1))]


@pytest.mark.parametrize("relays", [0, TAKEN_BACK])
def test_member_that_does_not_hear_a_vehicle_any_more_takes_its_place_back(relays: int) -> None:
    reports = PeerReports(8, 0.5)
    reports.store(3, PeerReport(2, (6.0, 0.0, 0.0), 0.0, silent=False), ZERO, 10.0)
    reports.store(3, PeerReport(2, ZERO, 0.0, silent=relays == 0, relays=relays), ZERO, 10.1)
    assert reports.heard_places(2, ZERO, 10.1) == []
