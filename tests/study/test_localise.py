"""Relative localisation judged: the harness is what it says, the estimator as sure as it may be, and near the bound."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import mission
from companion.core.agent import TICK_S
from sim_bridge import cli
from sim_bridge.lab.study.load import load_study
from sim_bridge.lab.study.localise import batch
from sim_bridge.lab.study.localise import flight_figures as figures
from sim_bridge.lab.study.localise.flight import Seen, believed, fly
from sim_bridge.lab.study.localise.paths import Paths, among_trees, in_the_open
from sim_bridge.lab.study.localise.sensors import Measured, Sensors, measure

EXACT = Sensors(velocity_mps=0.0, bias_mps=0.0, yaw_deg=0.0, range_m=0.0, loss=0.0, start_m=0.0)
STUDY = """
localise = 1
size = 3
duration_s = 20.0
seeds = 2
[[run]]
name = "weave"
motion = { weave_mps = 0.35 }
[run.must]
rmse_m = { mean = 100.0 }
p95_m = { mean = 0.0 }
nees_inside = { mean = 0.0 }
"""


def flight(
    sensors: Sensors, *, weave_mps: float = 0.35, seed: int = 1, n: int = 5, duration_s: float = 60.0
) -> tuple[Paths, Measured]:
    paths = in_the_open(n, duration_s, weave_mps, np.random.default_rng(seed))
    return paths, measure(paths, sensors, np.random.default_rng([seed, 1]))


def judged(sensors: Sensors, *, weave_mps: float = 0.35, seed: int = 1) -> Seen:
    paths, measured = flight(sensors, weave_mps=weave_mps, seed=seed)
    return fly(paths, measured, believed(sensors), 0, sensors.start_m)


# --- the harness ---


def test_exact_odometers_lead_to_where_vehicles_are() -> None:
    paths, measured = flight(EXACT)
    np.testing.assert_allclose(paths.pos_ne_m[0] + measured.odo_ne_m, paths.pos_ne_m, atol=1e-9)


def test_odometers_err_as_much_as_they_are_said_to() -> None:
    paths, measured = flight(Sensors(yaw_deg=0.0), n=16, duration_s=300.0)
    off = measured.vel_ne_mps - paths.vel_ne_mps
    assert off.std() == pytest.approx(math.hypot(0.1, 0.05), rel=0.05)
    turned = flight(Sensors(velocity_mps=0.0, bias_mps=0.0, yaw_deg=3.0), n=16)[1]
    assert np.degrees(turned.yaw_rad[0]).std() == pytest.approx(3.0, rel=0.5)


def test_a_compass_turns_what_its_odometer_counts_and_nothing_else() -> None:
    paths, measured = flight(Sensors(velocity_mps=0.0, bias_mps=0.0, yaw_deg=5.0))
    np.testing.assert_allclose(np.hypot(*measured.vel_ne_mps.T), np.hypot(*paths.vel_ne_mps.T), atol=1e-9)
    told = np.arctan2(measured.vel_ne_mps[..., 1], measured.vel_ne_mps[..., 0])
    true = np.arctan2(paths.vel_ne_mps[..., 1], paths.vel_ne_mps[..., 0])
    np.testing.assert_allclose(np.angle(np.exp(1j * (true - told - measured.yaw_rad))), 0.0, atol=1e-9)


def test_ranges_come_as_often_as_they_are_said_to_and_are_lost_as_often() -> None:
    paths, measured = flight(Sensors(loss=0.3, reach_m=100.0))
    found = [one for per_tick in measured.ranges for one in per_tick]
    pairs, seconds = 10, len(paths.pos_ne_m) * TICK_S
    assert len(found) == pytest.approx(0.7 * 10.0 * pairs * seconds, rel=0.03)
    off = [one.metres - math.dist(paths.pos_ne_m[one.tick][one.a], paths.pos_ne_m[one.tick][one.b]) for one in found]
    assert np.std(off) == pytest.approx(0.1, rel=0.05)
    assert abs(np.mean(off)) < 0.01


def test_late_ranges_are_late_and_so_many() -> None:
    paths, measured = flight(Sensors(nlos=0.15, range_m=0.0))
    found = [one for per_tick in measured.ranges for one in per_tick]
    off = np.array(
        [one.metres - math.dist(paths.pos_ne_m[one.tick][one.a], paths.pos_ne_m[one.tick][one.b]) for one in found]
    )
    late = off > 0.1
    assert late.mean() == pytest.approx(0.15, abs=0.02)
    assert off[late].min() >= 0.2
    assert off[late].max() <= 1.2
    np.testing.assert_allclose(off[~late], 0.0, atol=1e-9)


def test_a_trunk_makes_ranges_late_by_the_same_for_as_long_as_it_stands_between() -> None:
    paths, _ = flight(EXACT)
    paths.blocked[200:300, 0, 1] = True
    for kind, expected in (("late", True), ("cut", False)):
        sensors = EXACT.model_copy(update={"trunks": kind, "reach_m": 100.0})
        measured = measure(paths, sensors, np.random.default_rng(1))
        past = [one for tick in range(200, 300) for one in measured.ranges[tick] if (one.a, one.b) == (0, 1)]
        assert bool(past) is expected
        off = {
            round(one.metres - math.dist(paths.pos_ne_m[one.tick][0], paths.pos_ne_m[one.tick][1]), 9) for one in past
        }
        assert len(off) == (1 if expected else 0)
        assert all(0.2 <= metres <= 1.2 for metres in off)


def test_each_range_is_told_once_and_by_one_of_the_two() -> None:
    _, measured = flight(Sensors())
    told = [(one.a, one.b, one.tick) for sent in measured.broadcasts for beacon in sent for one in beacon.ranges]
    assert len(told) == len(set(told))
    assert all(
        beacon.sender in (one.a, one.b) for sent in measured.broadcasts for beacon in sent for one in beacon.ranges
    )
    measured_count = sum(len(per_tick) for per_tick in measured.ranges)
    assert measured_count - 30 <= len(told) <= measured_count


def test_a_flight_among_trees_is_our_laws_and_goes_past_trunks() -> None:
    paths = among_trees(2, 15.0, 400.0, 3)
    assert paths.pos_ne_m.shape == (300, 2, 2)
    np.testing.assert_allclose(np.diff(paths.pos_ne_m, axis=0), paths.vel_ne_mps[:-1] * TICK_S, atol=1e-9)
    assert 1.5 < np.linalg.norm(paths.vel_ne_mps, axis=-1).mean() < 4.0


# --- the estimator ---


def test_a_swarm_that_weaves_is_found_to_half_a_metre_and_the_filter_knows_how_well() -> None:
    seen = [judged(Sensors(), seed=seed) for seed in (1, 2, 3)]
    found = [figures.of_flight([one]) for one in seen]
    assert np.mean([one["rmse_m"] for one in found]) < 0.5
    # 8 degrees of freedom, three flights, some independent moments in each.
    assert 0.6 < np.mean([one["nees"] for one in found]) < 1.5
    assert np.mean([one["nis"] for one in found]) == pytest.approx(0.98, abs=0.06)


def test_the_turn_of_a_rigid_swarm_is_not_found_and_the_filter_knows() -> None:
    seen = [judged(Sensors(), weave_mps=0.0, seed=seed) for seed in (1, 2, 3)]
    sd = np.array([one.rotation_sd_rad[-1] for one in seen])
    assert (sd > math.radians(4.0)).all()
    off = np.array([one.turned_rad[-1] for one in seen])
    assert (np.abs(off) < 3.0 * sd).all()


def test_the_estimator_is_near_what_all_measurements_at_once_give() -> None:
    sensors = Sensors()
    ours, bound = [], []
    for seed in (1, 2):
        paths, measured = flight(sensors, seed=seed)
        seen = fly(paths, measured, believed(sensors), 0, sensors.start_m)
        ours.append(figures.of_flight([seen])["rmse_m"])
        bound.append(batch.solve(paths, measured, believed(sensors), 0, sensors.start_m))
    assert all(one.smoothed_m < one.causal_m for one in bound)
    assert np.mean(ours) < 1.3 * np.mean([one.causal_m for one in bound])


def test_the_batch_finds_the_truth_where_nothing_errs() -> None:
    sensors = Sensors(velocity_mps=0.001, bias_mps=0.001, yaw_deg=0.01, range_m=0.001, start_m=0.001, loss=0.0)
    paths, measured = flight(sensors)
    bound = batch.solve(paths, measured, believed(sensors), 0, sensors.start_m)
    assert bound.smoothed_m < 0.05


def test_nothing_of_the_true_place_reaches_the_estimator() -> None:
    sensors = Sensors()
    paths, measured = flight(sensors)
    off = np.array([1000.0, -500.0])
    elsewhere = Paths(paths.pos_ne_m + off, paths.vel_ne_mps, paths.blocked)
    moved = measure(elsewhere, sensors, np.random.default_rng([1, 1]))
    here = fly(paths, measured, believed(sensors), 0, sensors.start_m)
    there = fly(elsewhere, moved, believed(sensors), 0, sensors.start_m)
    np.testing.assert_allclose(here.off_ne_m, there.off_ne_m, atol=1e-6)


# --- the program ---


def test_a_study_is_flown_judged_and_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "study.toml", tmp_path / "out"
    file.write_text(STUDY, encoding="utf-8")
    assert cli.main(["study", str(file), "--out", str(out), "--workers", "1"]) == 1
    rows = (out / "rows.jsonl").read_text(encoding="utf-8")
    assert len(rows.splitlines()) == 2
    verdicts = {v["figure"]: v["reached"] for v in json.loads((out / "must.json").read_text(encoding="utf-8"))}
    assert verdicts == {"rmse_m": True, "p95_m": False, "nees_inside": True}
    shown = capsys.readouterr().out
    assert "MISSED" in shown
    assert "error along" in shown  # headings fold
    cli.main(["report", str(out)])
    assert "2 of 2 flights estimated, to " in capsys.readouterr().out
    (group,) = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert 0.0 <= group["nees_inside_mean"] <= 1.0
    assert "contacts_mean" not in group
    assert cli.main(["study", str(file), "--out", str(out)]) == 1
    assert (out / "rows.jsonl").read_text(encoding="utf-8") == rows


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size = 3", "size = 1", "size = 1"),
        ("rmse_m = { mean = 100.0 }", "rmse_m = { best = 1.0 }", "best"),
        ("rmse_m = { mean = 100.0 }", "speed_m = { mean = 1.0 }", "speed_m"),
        ("nees_inside = { mean", "nees_inside = { worst", "must be one of mean"),
    ],
)
def test_a_study_that_is_wrong_is_refused_with_its_line(
    old: str, new: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.toml"
    file.write_text(STUDY.replace(old, new), encoding="utf-8")
    assert cli.main(["study", str(file)]) == 2
    assert said in capsys.readouterr().err


def test_the_study_that_comes_along_loads() -> None:
    cases = load_study(Path(mission.__file__).parent / "studies" / "localise.toml").cases
    assert {(case.n, case.duration_s, case.backend) for case in cases} == {(8, 600.0, "estimator")}
    assert min(case.seed for case in cases) == 1000
    assert {case.path_seed for case in cases} == {1000, 1001}
