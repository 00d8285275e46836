"""Programs of the bench that take turns: what they answer, what they cost, how they end."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.bench import other_simulators
from tests.bench.other_simulators import ENVIRONMENTS, Entrant
from tests.bench.stint import cpu_time_s
from tests.bench.turns import StintError, StintProgram, pure_copy, stint_command, take_turns

COUNTS = """
import json, sys
print("a greeting that is no answer", flush=True)
for count, line in enumerate(sys.stdin, start=1):
    last = {"ended": "flown"} if count == %d else {}
    print(json.dumps({"vehicle_s": float(line), "cpu_s": count, "wall_s": 0.0, **last}), flush=True)
"""
SHORT = '{"coverage": {"duration_s": 0}, "route": {"d2_enu_m": [25, 0, 8]}}'
SPENT_S = 0.5  # more than two interpreters take to start
SPENDS = f"""
import sys, time
while time.process_time() < {SPENT_S}: pass
print("spent", flush=True)
sys.stdin.read()
"""


def counting(stints: int) -> StintProgram:
    """A program that has flown after so many stints."""
    return StintProgram([sys.executable, "-c", COUNTS % stints])


def test_programs_take_turns_until_all_have_flown() -> None:
    with counting(99) as pacer, counting(2) as short, counting(3) as long:
        take_turns([short, long], pacer, 5.0)
        assert [len(program.stints) for program in (pacer, short, long)] == [3, 2, 3]
        assert [stint.cpu_s for stint in long.stints] == [1, 2, 3]
        assert pacer.end is None


def test_a_program_that_dies_is_told_with_its_last_words() -> None:
    dies = [sys.executable, "-c", "raise SystemExit('no such simulator')"]
    with StintProgram(dies) as program, pytest.raises(StintError, match="no such simulator"):
        program.fly(1.0)


def test_a_simulator_that_is_not_installed_is_told_not_made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    absent = Entrant("absent (", "fly_absent.py", "absent", "nothing")
    monkeypatch.setattr(other_simulators, "ENTRANTS", (absent,))
    monkeypatch.setattr(other_simulators, "stint_command", lambda _: [sys.executable, "-c", FAKE_FLIGHT])
    full, row, _ = other_simulators.other_simulators()
    assert full.reached
    assert (row.what, row.reached) == ("- absent", False)
    assert "not installed" in row.seen
    assert not (ENVIRONMENTS / "absent").exists()


FAKE_FLIGHT = """
import json, sys
for line in sys.stdin:
    last = {"ended": "flown", "verdict": "ARRIVED"} if line == "end\\n" else {}
    print(json.dumps({"vehicle_s": 40.0, "cpu_s": 0.5, "wall_s": 0.5, **last}), flush=True)
"""


def test_time_of_grandchildren_counts_while_they_live_and_when_they_are_gone() -> None:
    before_s = cpu_time_s()
    child_does = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {SPENDS!r}])"
    with subprocess.Popen(
        [sys.executable, "-c", child_does], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "spent\n"
        living_s = cpu_time_s() - before_s
        child.communicate()
    assert living_s >= SPENT_S
    assert cpu_time_s() - before_s >= SPENT_S


@pytest.mark.parametrize("options", [(), ("--processes",)])
def test_a_flight_in_stints_tells_the_whole_of_it(options: tuple[str, ...]) -> None:
    with StintProgram(
        stint_command("mission/examples/lone_tree.toml", "--n", "2", "--set", SHORT, *options)
    ) as program:
        program.fly("transit")
        program.fly(2.0)
        program.fly("end")
    start, transit, _ = program.stints
    assert (start.phase, transit.phase) == ("transit", "transit")
    assert transit.vehicle_s == pytest.approx(4.0)
    assert all(stint.cpu_s > 0.0 for stint in program.stints)
    assert program.end is not None
    assert program.end["arrived"]
    assert program.end["contacts"] == 0


def test_a_pure_copy_has_all_of_the_source_and_nothing_that_is_compiled(tmp_path: Path) -> None:
    for package in ("mission", "companion", "sim_bridge"):
        (tmp_path / package).mkdir()
        (tmp_path / package / "agent.py").write_text("")
        (tmp_path / package / "agent.cpython-311-x86_64-linux-gnu.so").write_bytes(b"")
    with pure_copy(tmp_path) as copy:
        assert sorted(file.name for file in copy.rglob("*") if file.is_file()) == ["agent.py"] * 3
