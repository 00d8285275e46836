"""The bench: figures come from costs as they say, pages keep what was measured before, hashes tell what has changed."""

from __future__ import annotations

import argparse
import dataclasses
import io
import math
import subprocess
import sys
import threading
from collections.abc import Iterator

import pytest

from mission.common.exit_codes import EXIT_ENVIRONMENT
from sim_bridge.judge import progress
from tests.bench import hashes, signed_radio, speed
from tests.bench.__main__ import PROGRAMS, _next, main
from tests.bench.hashes import FLIGHTS, Hashes, difference, read, seeds, table
from tests.bench.other_simulators import ENTRANTS, HERE
from tests.bench.other_simulators.course import NEAR_M, SPEED_MPS, setpoint, starts
from tests.bench.page import HEAD, section, with_section
from tests.bench.speed import BARE, BESIDE, IN_PROCESS, PROCESSES, PURE, exponent, growth_rows, ratio_rows
from tests.bench.table import Row
from tests.bench.turns import Stint, cost_s

SEEN = Hashes("paper", 2, "a" * 64, "b" * 64, 285.55, "ARRIVED")


def test_cost_counts_long_stints_for_more() -> None:
    stints = [Stint(10.0, 1.0, 9.9, ""), Stint(90.0, 3.0, 9.9, "")]
    assert cost_s(stints) == pytest.approx(0.04)


def test_exponent_is_one_when_a_vehicle_costs_the_same_in_any_company() -> None:
    assert exponent({n: 0.004 * n for n in (8, 20, 50, 100)}) == pytest.approx(1.0)
    assert exponent({n: 0.004 * n**1.4 for n in (8, 20, 50, 100)}) == pytest.approx(1.4)


@pytest.mark.parametrize(("power", "reached"), [(0.1, True), (0.2, False)])
def test_growth_is_of_the_swarm_not_of_the_vehicle(power: float, reached: bool) -> None:
    costs = {n: [0.01 * n**power] * 5 for n in (8, 20, 50, 100)}
    growth, told = growth_rows("", costs)
    assert (growth.seen, growth.reached) == (f"{1.0 + power:.2f}", reached)
    assert told.seen.startswith(f"n = 8: {10 * 8**power:.1f}")


def test_ratios_are_taken_seed_by_seed_and_their_median_counts() -> None:
    costs = {BARE: [1.0, 2.0, 4.0], IN_PROCESS: [2.0, 4.8, 12.0], PROCESSES: [5.0, 10.0, 20.0]}
    told = list(ratio_rows(costs, [36.0, 30.0, 37.0]))
    rows = {row.what.split(": ")[-1]: row for row in told if row.what.startswith("full stack")}
    assert (rows[IN_PROCESS].seen, rows[IN_PROCESS].reached) == ("median 2.40x (2.00 to 3.00)", True)
    assert (rows[PROCESSES].seen, rows[PROCESSES].reached) == ("median 5.00x (5.00 to 5.00)", False)
    factor = next(row for row in told if row.wanted == ">= 35x")
    assert factor.reached
    assert factor.seen.startswith("median 36.00x")


def test_another_checkout_and_pure_python_are_told_where_they_flew() -> None:
    costs = {BARE: [1.0], IN_PROCESS: [2.0], PROCESSES: [3.0], PURE: [3.0], BESIDE + IN_PROCESS: [5.0]}
    seen = {row.what: row.seen for row in ratio_rows(costs, [40.0])}
    assert seen["- pure Python / compiled"].startswith("median 1.50x")
    assert seen[f"- {BESIDE}{IN_PROCESS} / this one"].startswith("median 2.50x")
    assert f"- {BESIDE}{PROCESSES} / this one" not in seen


def test_help_has_a_line_for_each_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["no-such"])
    names = capsys.readouterr().err.rpartition("must be of ")[2].strip().split(", ")

    with pytest.raises(SystemExit):
        main(["--help"])
    usual, _, named = capsys.readouterr().out.partition("only when named:")
    told = [line.split()[0] for line in (usual.partition("all of these:")[2] + named).splitlines() if line.strip()]
    assert sorted(told) == sorted([*names, *PROGRAMS])
    assert len(told) == len(set(told))


def test_a_section_takes_the_place_of_its_like_and_of_no_other() -> None:
    rows = [Row("speed", "<= 2", "1.5", True)]
    page = with_section("", "paper", "## paper\n\nold\n", ["speed", "paper"])
    page = with_section(page, "by hand", "## by hand\n\nkept\n", ["speed", "paper"])
    page = with_section(page, "speed", section("speed", rows), ["speed", "paper"])
    assert page.startswith(HEAD)
    assert [line for line in page.splitlines() if line.startswith("## ")] == ["## speed", "## paper", "## by hand"]
    assert "| speed | <= 2 | 1.5 | yes |" in page
    page = with_section(page, "paper", "## paper\n\nnew\n", ["speed", "paper"])
    assert "old" not in page
    assert "new" in page
    assert "kept" in page
    assert with_section(page, "paper", "## paper\n\nnew\n", ["speed", "paper"]) == page


def test_hashes_come_back_from_their_table() -> None:
    other = dataclasses.replace(SEEN, name="loss", seed=1)
    text = table([SEEN, other])
    assert read(text) == {("paper", 2): SEEN, ("loss", 1): other}
    assert text.splitlines()[-1] == str(SEEN)


def test_a_line_that_is_no_flight_is_named() -> None:
    with pytest.raises(ValueError, match="line 2: must be flight seed trace motion"):
        read("# head\npaper 2 abc\n")


def test_other_beacons_are_told_from_another_flight() -> None:
    assert difference(SEEN, SEEN) == "equal"
    assert difference(SEEN, None) == "not recorded"
    assert difference(SEEN, dataclasses.replace(SEEN, trace="c" * 64)).endswith("the same motion")
    assert difference(SEEN, dataclasses.replace(SEEN, trace="c" * 64, motion="c" * 64)) == "ANOTHER FLIGHT"


def test_a_motion_that_was_not_recorded_is_not_compared() -> None:
    recorded = dataclasses.replace(SEEN, motion="-")
    assert difference(SEEN, recorded) == "equal"
    assert difference(dataclasses.replace(SEEN, trace="c" * 64), recorded).startswith("ANOTHER FLIGHT")


def test_seeds_are_a_range_or_one() -> None:
    assert (seeds("1-5"), seeds("3")) == (range(1, 6), range(3, 4))


@pytest.mark.parametrize("wrong", ["", "0", "5-1", "a", "1-b", "-1"])
def test_other_seeds_are_refused(wrong: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="must be A-B"):
        seeds(wrong)


@pytest.mark.parametrize(
    ("name", "option"),
    [("encounters", "--runs"), ("own-motion", "--runs"), ("layers", "--flights"), ("trunks", "--jobs")],
)
def test_a_bench_of_nothing_is_refused(name: str, option: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([name, option, "0"])
    assert ended.value.code == 2
    assert f"{option}: '0': must be a whole number of at least 1" in capsys.readouterr().err


@pytest.mark.parametrize("name", FLIGHTS)
def test_each_flight_of_the_hashes_is_a_mission(name: str) -> None:
    flies = hashes.mission(name, 4)
    assert (flies.swarm.size, flies.sim.seed) == (8, 4)
    assert flies.origin is not None
    for key in FLIGHTS[name][1]:
        assert key in flies.sim.model_fields_set


def test_simulators_fly_straight_to_their_positions_and_stop_there() -> None:
    place = (130.0, 0.0, 8.0)
    assert setpoint((0.0, 0.0, 8.0), place) == pytest.approx((SPEED_MPS, 0.0, 0.0))
    assert math.hypot(*setpoint((130.0, 30.0, 60.0), place)) == pytest.approx(SPEED_MPS)
    assert math.hypot(*setpoint((129.0, 0.0, 8.0), place)) <= NEAR_M
    assert setpoint(place, place) == (0.0, 0.0, 0.0)


def test_simulators_start_apart() -> None:
    places = starts()
    assert len(places) == speed.N
    assert min(math.dist(a, b) for a in places for b in places if a != b) > 5.0


def test_each_race_has_its_script_and_the_version_that_its_environment_pins() -> None:
    for entrant in ENTRANTS:
        assert (HERE / entrant.script).exists()
        if entrant.environment is not None:
            wanted = (HERE / f"{entrant.environment}.in").read_text().strip().lower()
            assert f"\n{wanted} " in (HERE / f"{entrant.environment}.lock").read_text().lower()


class Told(io.StringIO):
    """Tells when something was written."""

    def __init__(self) -> None:
        super().__init__()
        self.written = threading.Event()

    def write(self, text: str) -> int:
        self.written.set()
        return super().write(text)


def test_a_benchmark_under_way_gives_signs_of_life(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SILENT_MAX_S", 0.001)
    told = Told()
    monkeypatch.setattr(sys, "stderr", told)
    row = Row("speed", "told", "fast", True)

    def slow() -> Iterator[Row]:
        assert told.written.wait(30.0)
        yield row

    measured = slow()
    assert _next(measured, "speed, row 1") == row
    assert _next(measured, "speed, row 2") is None
    assert told.getvalue().startswith("speed, row 1: 0 s\n")


def test_without_the_development_tools_it_says_what_installs_them() -> None:
    code = "import runpy, sys; sys.modules['pytest'] = None; runpy.run_module('tests.bench', run_name='__main__')"
    done = subprocess.run([sys.executable, "-c", code, "--help"], capture_output=True, text=True, check=False)
    told = "tests.bench: the development tools are missing: `make dev` installs them\n"
    assert (done.returncode, done.stdout, done.stderr) == (EXIT_ENVIRONMENT, "", told)


def test_an_impostors_words_count_nowhere_and_each_way_has_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert signed_radio.main(["--frames", "0", "--sizes", "--live", "--impostors", "2"]) == 0
    rows = [
        line.split(" | ")
        for line in capsys.readouterr().out.splitlines()
        if line.startswith(("| one", "| with", "| the"))
    ]
    assert len(rows) == len(signed_radio.IMPOSTORS) * len(signed_radio.LOSSES)
    at_once = next(row for row in rows if row[0] == "| with each beacon" and row[1] == "0%")
    assert float(at_once[4]) <= 1.1  # the next manifest
    assert at_once[5:] == ["0", "0 |"]
