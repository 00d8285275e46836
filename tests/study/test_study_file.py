"""The file of a study: what it crosses to, and what is refused."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from mission.common.problems import MissionError
from sim_bridge import cli
from sim_bridge.lab.study import crossing, spec
from sim_bridge.lab.study.engine import batches
from sim_bridge.lab.study.load import load_study
from tests.study.study_kit import MISSION, STUDY, study, study_file


def test_parameters_laws_and_seeds_are_crossed(tmp_path: Path) -> None:
    text = (
        STUDY + 'cross = { radio.transit_range_m = [25, 30] }\n[[run]]\nname = "paper"\nlaw = "algorithm1"\nseeds = 1\n'
    )
    text += "cross_params = { separation_m = [0.5, 1.0, 2.0] }\nset = { limits.speed_max_mps = 4.0 }\n"
    cases = study(tmp_path, text).cases
    seen = {(c.run, c.mission.swarm.size, c.mission.radio.transit_range_m, c.mission.sim.seed) for c in cases}
    assert {s for s in seen if s[0] == "ours"} == {("ours", n, r, s) for n in (2, 3) for r in (25, 30) for s in (1, 2)}
    papers = [c for c in cases if c.run == "paper"]
    assert [(c.settings["swarm.size"], c.settings["params.separation_m"]) for c in papers] == [
        (n, s) for n in (2, 3) for s in (0.5, 1.0, 2.0)
    ]
    assert {c.mission.limits.speed_max_mps for c in papers} == {4.0}
    assert len({c.key for c in cases}) == len(cases) == 8 + 6


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[2, 3]", "[2, 0]"), r"study.toml:5: swarm.size = 0: must be an integer from 1 to 250"),
        (("[2, 3]", "4"), r"study.toml:5: cross.swarm.size = 4: must be an array of at least one value"),
        (("swarm.size", "swarm.sise"), r"study.toml:5: swarm.sise = 2: unknown key; did you mean size\?"),
        (('"ours"\n', '"ours"\nlaw = "boids"\n'), r'study.toml:8: run\[0\].law = "boids": must be one of ours, algori'),
        (
            ('"ours"\n', '"ours"\nbackend = "gazebo"\n'),
            r'study.toml:8: run\[0\].backend = "gazebo": must be one of "po',
        ),
        (
            ('"ours"\n', '"ours"\nbackend = "estimator"\n'),
            r"flies no missions: its studies are files",
        ),
        (
            ('"ours"\n', '"x"\nlaw = "algorithm1"\nbackend = "jsbsim"\n'),
            r'run\[0\].law = "algorithm1": must be "ours" where',
        ),
        (('"ours"\n', '"ours"\nparams = { gain = 1 }\n'), r'study.toml:8: gain = 1: law "ours" has no parameters'),
        (
            ('"ours"\n', '"ours"\nlaw = "algorithm1"\ncross_params = { dt_s = [1, -1] }\n'),
            r"study.toml:9: dt_s = -1: must be a number above 0, at most 10",
        ),
        (
            ('"ours"\n', '"ours"\n[[run]]\nname = "ours"\nsafety_filter = false\nbackend = "agents"\n'),
            r'study.toml:9: run\[1\].name = "ours": is another run\'s: must be new',
        ),
        (("seeds = 2", "seeds = 0"), r"study.toml:3: seeds = 0: must be an integer from 1 to 100000"),
        (("mission.toml", "none.toml"), r'study.toml:2: missions\[0\] = "none.toml": .*/none.toml: no such file'),
        (('missions = ["mission.toml"]\n', ""), r"run\[0\].missions: missing here and in the study"),
        (('[[run]]\nname = "ours"\n', ""), r"study.toml:1: run: missing; must be an array"),
        (
            ('"ours"\n', '"ours"\nmissions = ["mission.toml", "none.toml"]\n'),
            r'study.toml:8: run\[0\].missions\[1\] = "none.toml": .*/none.toml: no such file',
        ),
        (('"ours"\n', '"ours"\ncross = { swarm.size = [4] }\n'), r"crossed twice"),
        (
            ('"ours"\n', '"ours"\ncross = { swarm.size = [4] }\nset = { swarm.size = 8 }\n'),
            r"study.toml:8: run\[0\].cross.swarm.size = \[4\]: also in set",
        ),
        (
            ("swarm.size = [2, 3]", "sim.seed = [4, 5]"),
            r"study.toml:5: cross.sim.seed = \[4, 5\]: the seeds of a study are `seeds` and `first_seed`",
        ),
        (('"ours"\n', '"ours"\nset = { sim.seed = 5 }\n'), r"study.toml:8: run\[0\].set.sim.seed = 5: the seeds of a"),
    ],
)
def test_a_bad_study_is_refused_with_its_place(change: tuple[str, str], told: str, tmp_path: Path) -> None:
    assert change[0] in STUDY
    with pytest.raises(MissionError, match=told):
        study(tmp_path, STUDY.replace(*change))


def test_a_mission_in_the_place_of_a_study_is_told_so(tmp_path: Path) -> None:
    (tmp_path / "mission.toml").write_text(MISSION, encoding="utf-8")
    with pytest.raises(MissionError, match=r"mission\.toml: is a mission, and no study: `sim-bridge fly` flies it"):
        load_study(tmp_path / "mission.toml")


def test_what_a_run_sets_is_not_crossed_by_the_study(tmp_path: Path) -> None:
    text = STUDY + 'set = { swarm.size = 8 }\n[[run]]\nname = "crossed"\n'
    found = {(c.run, c.mission.swarm.size, c.settings["swarm.size"]) for c in study(tmp_path, text).cases}
    assert found == {("ours", 8, 8), ("crossed", 2, 2), ("crossed", 3, 3)}


def test_too_many_flights_are_refused_before_any_is_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def built(*_: object) -> None:
        pytest.fail("a flight was built")

    monkeypatch.setattr(crossing, "MissionCase", built)
    text = STUDY.replace("seeds = 2", "seeds = 30000") + '[[run]]\nname = "more"\n'
    told = r"study.toml:8: run\[1\]: 120000 flights up to here: at most 100000 in all"
    with pytest.raises(MissionError, match=told):
        study(tmp_path, text)


def test_program_refuses_a_bad_study_with_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = study_file(tmp_path, STUDY.replace("[2, 3]", "[2, 0]"))
    assert cli.main(["study", str(file), "--out", str(tmp_path / "out")]) == 2
    assert "swarm.size = 0: must be an integer" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_seeds_of_the_same_point_mass_case_fly_together_and_others_alone(tmp_path: Path) -> None:
    text = STUDY + '[[run]]\nname = "real"\nbackend = "agents"\n'
    found = [{(c.run, c.mission.swarm.size) for c in batch} for batch in batches(study(tmp_path, text).cases, 2)]
    assert all(len(kinds) == 1 for kinds in found)
    assert len(found) == 2 + 4


@pytest.mark.parametrize("backend", ["agents", "jsbsim"])
def test_autopilots_of_a_study_are_as_wrong_as_recorded_unless_told(backend: str, tmp_path: Path) -> None:
    run = f'[[run]]\nname = "{{}}"\nbackend = "{backend}"\n'
    text = STUDY + run.format("default") + run.format("exact") + 'set = { sim.estimates = "exact" }\n'
    text += run.format("both") + 'cross = { sim.estimates = ["exact", "recorded"] }\n'
    cases = study(tmp_path, text).cases
    flown = {name: {c.mission.sim.estimates for c in cases if c.run == name} for name in ("default", "exact", "both")}
    told = {c.settings.get("sim.estimates") for c in cases if c.run == "default"}
    assert flown["exact"] == {"exact"}
    assert flown["both"] == {"exact", "recorded"}
    assert (flown["default"], told) == ({"recorded"}, {"recorded"})


WIND_FAULT = '[{ kind = "wind", vehicles = [1], wind_mps = [3.0, 0.0], at_s = 5.0 }]'


@pytest.mark.parametrize(
    ("backend", "said", "told"),
    [
        (
            "point-mass",
            'sim.estimates = "recorded"',
            "flies without sim.estimates, which mission.toml has: must be agents",
        ),
        ("point-mass", "sim.position_noise_m = 0.1", "flies without sim.position_noise_m, "),
        (
            "point-mass",
            "sim.wind_mps = [3.0, 0.0, 0.0]",
            "flies without sim.wind_mps, which mission.toml has: must be jsbsim",
        ),
        (
            "agents",
            "sim.wind_mps = [3.0, 0.0, 0.0]",
            "flies without sim.wind_mps, which mission.toml has: must be jsbsim",
        ),
        (
            "agents",
            "sim.turbulence_mps = 2.0",
            "flies without sim.turbulence_mps, which mission.toml has: must be jsbsim",
        ),
        (
            "agents",
            f"sim.faults = {WIND_FAULT}",
            "flies without faults of wind, which mission.toml has: must be jsbsim",
        ),
    ],
)
def test_what_a_backend_would_leave_out_without_a_word_is_refused(
    backend: str, said: str, told: str, tmp_path: Path
) -> None:
    text = f'{STUDY}backend = "{backend}"\nset = {{ {said} }}\n'
    with pytest.raises(MissionError, match=re.escape(f'backend = "{backend}": {told}')):
        study(tmp_path, text)
    study(tmp_path, text.replace(f'"{backend}"', '"jsbsim"'))


@pytest.mark.parametrize(
    ("backend", "told"), [("point-mass", "mission.toml has no [sensing]"), ("agents", 'with backend = "jsbsim"')]
)
def test_gusts_where_nothing_flies_them_are_refused(backend: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(MissionError, match=rf"gusts_mps = 0.3: .*{re.escape(told)}"):
        study(tmp_path, f'{STUDY}backend = "{backend}"\ngusts_mps = 0.3\n')


def test_a_mission_file_that_says_what_its_estimates_are_is_flown_so(tmp_path: Path) -> None:
    file = study_file(tmp_path, STUDY + 'backend = "agents"\n')
    (tmp_path / "mission.toml").write_text(MISSION + '[sim]\nestimates = "exact"\n', encoding="utf-8")
    assert {(c.mission.sim.estimates, c.settings.get("sim.estimates")) for c in load_study(file).cases} == {
        ("exact", None)
    }


def test_program_says_which_runs_fly_by_wrong_estimates(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = STUDY.replace("seeds = 2", "seeds = 1").replace("[2, 3]", "[1]")
    file = study_file(tmp_path, text + '[[run]]\nname = "stack"\nbackend = "agents"\n')
    assert cli.main(["study", str(file), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    told = capsys.readouterr().err.splitlines()[0]
    assert 'sim.estimates = "recorded"' in told
    assert told.endswith(": stack")


def test_a_row_that_was_cut_off_is_told_and_flown_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """And the costs beside the rows: a line that is joined to another is no JSON, and the plots could not be drawn."""
    file, out = study_file(tmp_path, STUDY.replace("[2, 3]", "[1]")), tmp_path / "out"
    command = ["study", str(file), "--out", str(out), "--workers", "1"]
    assert cli.main(command) == 0
    told = f"{out}/rows.jsonl: the last row was cut off, and is removed: its flight is flown anew if it is asked for"
    assert "cut off" not in capsys.readouterr().err
    rows = (out / "rows.jsonl").read_bytes()
    for name in ("rows.jsonl", "costs.jsonl"):
        (out / name).write_bytes((out / name).read_bytes()[:-20])

    assert cli.main(command) == 0
    assert capsys.readouterr().err.splitlines().count(told) == 1
    assert (out / "rows.jsonl").read_bytes() == rows
    assert len([json.loads(line) for line in (out / "costs.jsonl").read_text().splitlines()]) == 2


def test_studies_that_come_along_say_what_their_estimates_are() -> None:
    """Their figures stand in the documentation."""
    for file in sorted((Path(spec.__file__).parent / "examples").glob("*.toml")):
        for run in tomllib.loads(file.read_text(encoding="utf-8"))["run"]:
            if run.get("backend", "point-mass") != "point-mass":
                assert "estimates" in run.get("set", {}).get("sim", {}), f"{file.name}: {run['name']}"
