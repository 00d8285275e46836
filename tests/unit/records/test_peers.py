"""Which records go out next."""

from __future__ import annotations

from collections.abc import Iterator

from companion.records.holdings import Holding
from companion.records.peers import HEARD_S, PAIRS_MAX, PLAN_MAX, Peers
from companion.records.record import BASE_ID, Entry, LogKey, Vector

ME = 1
OWN, OTHERS = LogKey(ME, 5), LogKey(2, 6)


def lacks(key: LogKey, first: int, last: int) -> Entry:
    """All of a log but these."""
    there = [number for number in range(1, 33) if not first <= number <= last]
    return Entry(key, 0, 0, 32, 0, sum(1 << (number - 1) for number in there))


def planned(vectors: dict[int, tuple[int, list[Entry]]], now_s: float = 1.0) -> list[tuple[LogKey, int]]:
    """Records in their order; `vectors`: hops to the base station, and what is told, by sender."""
    peers = Peers(ME, 8)
    for sender, (hops, entries) in vectors.items():
        peers.note_vector(sender, Vector(1, hops, sender == BASE_ID, False, tuple(entries)), 1.0, lambda _key: True)
    found = peers.plan({OWN: Holding.of(32), OTHERS: Holding.of(32)}, OWN, now_s)
    return [(candidate.key, candidate.number) for candidate in found]


def test_what_the_base_station_lacks_comes_first_then_what_is_lacked_nearer_to_it() -> None:
    vectors = {
        3: (7, [lacks(OWN, 1, 1)]),  # farther from the base station than this one
        4: (1, [lacks(OWN, 2, 2)]),
        BASE_ID: (0, [lacks(OTHERS, 9, 9)]),
    }
    assert planned(vectors) == [(OTHERS, 9), (OWN, 1), (OWN, 2)]  # the base is one hop off: nobody is nearer
    assert planned({3: (7, [lacks(OWN, 1, 1)]), 4: (1, [lacks(OTHERS, 2, 2)])}) == [(OTHERS, 2), (OWN, 1)]


def test_own_records_come_before_others_and_none_twice() -> None:
    vectors = {3: (255, [lacks(OTHERS, 1, 2), lacks(OWN, 5, 6)]), 4: (255, [lacks(OWN, 6, 7)])}
    assert planned(vectors) == [(OWN, 5), (OWN, 6), (OWN, 7), (OTHERS, 1), (OTHERS, 2)]


def test_a_node_that_was_not_heard_for_long_lacks_nothing() -> None:
    assert planned({3: (255, [lacks(OWN, 5, 6)])}, now_s=1.0 + HEARD_S + 0.1) == []


def test_a_member_that_tells_of_many_logs_in_every_name_costs_a_plan_no_more_and_hides_nothing_for_long() -> None:
    """17,000 pairs took 0.39 s of a tick; with a bound each has its turn, and the base station's have one of theirs."""
    logs = [LogKey(1 + k % 50, 100 + k // 50) for k in range(350)]
    looked_at: list[LogKey] = []

    class Counted(Holding):
        def held(self, first: int, most: int) -> Iterator[int]:
            looked_at.append(OWN)
            return super().held(first, most)

    holdings: dict[LogKey, Holding] = {key: Counted() for key in logs}
    for holding in holdings.values():
        holding.add(1)
    peers = Peers(ME, 50)
    for sender in (*range(2, 51), BASE_ID):
        for at in range(0, len(logs), 8):
            entries = tuple(Entry(key, 0, 0, 40, 0, 0) for key in logs[at : at + 8])
            peers.note_vector(sender, Vector(1, 0, sender == BASE_ID, False, entries), 1.0, lambda _key: True)
    planned: set[LogKey] = set()
    for _ in range(6):
        looked_at.clear()
        found = peers.plan(holdings, OWN, 1.0)
        assert len(looked_at) <= PAIRS_MAX
        planned |= {candidate.key for candidate in found if candidate.reach == 0}
    assert len(planned) > PLAN_MAX
