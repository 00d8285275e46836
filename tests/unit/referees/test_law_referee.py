"""Third-party guidance laws as a referee: the same missions and seeds for each, and the page's table."""

from __future__ import annotations

from tests.referees.laws import FILTERS, LAWS, MISSIONS, SEEDS, SIZES, cases, entrant_of, mission_of
from tests.referees.laws_table import TITLE, section
from tests.referees.referee import Case, Row

OURS = "lone tree, ours, with"


def row(name: str, seed: int, trace_hash: str = "0a", **changes: object) -> Row:
    figures = {"contacts": 0, "min_separation_m": 7.0, "trunk_clearance_min_m": 3.0, "arrival_s": 43.0}
    return Case(name, 4, seed, "recorded").row("clear", **{**figures, "trace_hash": trace_hash, **changes})


def test_every_law_meets_the_same_missions_with_and_without_the_filter() -> None:
    found = cases()
    assert len(found) == len(set(found)) == len(MISSIONS) * len(LAWS) * len(FILTERS) * len(SIZES) * len(SEEDS)
    flown = [mission_of(Case(f"200 trees/ha, {law}, {how}", 8, 3, "exact")) for law in LAWS for how in FILTERS]
    assert all(mission == flown[0] for mission in flown)
    assert (flown[0].swarm.size, flown[0].sim.seed, flown[0].sim.estimates.value) == (8, 3, "exact")
    assert flown[0].forest.stand is not None
    assert flown[0].forest.stand.density_per_ha == 200.0
    assert entrant_of(OURS).is_ours
    assert entrant_of("lone tree, velocity obstacles, without").note().endswith("; WITHOUT SAFETY FILTER")


def test_the_table_has_a_row_of_each_law_and_a_hash_of_its_flights() -> None:
    flights = [row(OURS, 1), row(OURS, 2, arrival_s=None, min_separation_m=6.5)]
    flights.append(row("lone tree, velocity obstacles, without", 1, contacts=2, trunk_clearance_min_m=None))
    text = section(flights, "abc")
    assert text.startswith(f"## {TITLE}\n")
    assert "| lone tree | 4 | ours | with | 2 | 2 | 0 | 0 | 0 | 0 | 0 | 6.50 | 3.00 | 43 (of 1) | `" in text
    assert "| velocity obstacles | without | 1 | 1 | 0 | 0 | 0 | 0 | 2 | 7.00 |  | 43 (of 1) | `" in text
    heading, rule, *rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in (heading, rule, *rows)} == {16}
    assert section([row(OURS, 1, "0b"), flights[1]], "abc") != section(flights[:2], "abc")
