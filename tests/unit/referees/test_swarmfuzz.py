"""SwarmFuzz's attack as a referee: what is drawn, what is flown, and the page's table."""

from __future__ import annotations

from tests.referees.referee import Case, Row
from tests.referees.swarmfuzz import DRIFT_MPS, RADIOS, UNATTACKED, attack_of, cases, mission_of
from tests.referees.swarmfuzz_table import TITLE, section


def row(name: str, seed: int, grade: str) -> Row:
    return Case(name, 5, seed, "exact").row(grade, min_separation_m=4.0)


def test_an_attack_leads_one_member_as_far_as_asked_and_keeps_it_there() -> None:
    for case in cases():
        target, faults = attack_of(case)
        assert mission_of(case).swarm.size == case.n
        assert (mission_of(case).ranging is not None) == case.name.endswith(RADIOS)
        if case.name.startswith(UNATTACKED):
            assert (target, faults) == (0, [])
            continue
        led, kept = mission_of(case).sim.faults
        assert led.vehicles == kept.vehicles == (target,)
        spoofed_m = (kept.at_s - led.at_s) * DRIFT_MPS
        assert abs(spoofed_m - float(case.name.split()[0])) < 1e-9
        assert (led.for_s, kept.for_s) == (None, None)
    assert attack_of(Case("5 m, attack 1", 5, 1, "exact"))[0] == attack_of(Case("10 m, attack 1", 5, 1, "exact"))[0]
    alike = Case("5 m, attack 1", 5, 1, "exact"), Case("5 m, attack 1" + RADIOS, 5, 1, "exact")
    assert attack_of(alike[0]) == attack_of(alike[1])


def test_a_mission_is_hit_where_one_of_its_attacks_makes_another_collide() -> None:
    flights = [row(UNATTACKED, seed, "clear") for seed in (1, 2)]
    flights += [row("5 m, attack 1", 1, "clear"), row("5 m, attack 2", 1, "others")]
    flights += [row("5 m, attack 1", 2, "own"), row("5 m, attack 2", 2, "clear")]
    flights += [row("5 m, attack 1" + RADIOS, 1, "clear"), row(UNATTACKED + RADIOS, 1, "clear")]
    text = section(flights, "abc")
    assert text.startswith(f"## {TITLE}\n")
    assert "| no attack | 5 | 0 of 2 " in text
    assert "| 5 m | 5 | 1 of 2 (9% to 91%) | 1 | 1 | 2 | 4.00 |" in text
    assert "| all attacks | 5 | 1 of 2 (9% to 91%) | 1 | 1 | 2 | 4.00 |" in text
    assert "| no attack, range radios | 5 | 0 of 1 " in text
    assert "| 5 m, range radios | 5 | 0 of 1 (0% to 79%) | 0 | 0 | 1 | 4.00 |" in text
    assert "| all attacks, range radios | 5 | 0 of 1 (0% to 79%) | 0 | 0 | 1 | 4.00 |" in text
    heading, rule, *rows = [line for line in text.splitlines() if line.startswith("|")]
    assert {line.count("|") for line in (heading, rule, *rows)} == {8}
