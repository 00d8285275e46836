"""Faults that a run folder keeps, and what is refused when they are damaged."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from companion.core.model.states import SwarmPhase
from mission.schema.faults import Fault
from sim_bridge.drive import faults
from sim_bridge.drive.faults import Faults
from sim_bridge.judge.run_folder import RunFolderError, load_faults


def fault(kind: str, **values: Any) -> Fault:
    return Fault.model_validate({"kind": kind, "at_s": 0.0, **values})


class Said:
    def __init__(self) -> None:
        self.texts: list[str] = []

    def event(self, _time_s: float, text: str) -> None:
        self.texts.append(text)


def kept(some: Faults, folder: Path) -> list[str]:
    said = Said()
    faults.keep_faults(some, 100.0, folder, said)  # type: ignore[arg-type]
    return said.texts


def test_what_happened_comes_back_from_the_run_folder(tmp_path: Path) -> None:
    some = Faults(
        [
            fault("stop", at_s=1.0, for_s=3.0),
            fault("late", vehicles=[2, 4], late_s=1.5),
            fault("insider", vehicles=[3], lie="push"),
            fault("kill", at_s=60.0),
        ]
    )
    for now_s in (0.0, 1.0):
        some.advance(now_s, alive=(1, 2, 3, 4), phase=SwarmPhase.ASSEMBLE, leader=1)
    assert kept(some, tmp_path) == ["fault that never happened: kill leader@60"]
    assert load_faults(tmp_path) == tuple(some.happened)
    assert [row["asked"] for row in json.loads((tmp_path / "faults.json").read_text()) if row["at_s"] is None] == [
        "kill leader@60"
    ]


def test_a_flight_without_faults_leaves_no_file(tmp_path: Path) -> None:
    assert kept(Faults([]), tmp_path) == []
    assert not list(tmp_path.iterdir())
    assert load_faults(tmp_path) == ()


ROW = '{"kind": "kill", "vehicles": [1], "at_s": 1, "until_s": null, "late_s": null, "asked": ""}'


@pytest.mark.parametrize(
    "text",
    [
        *("", "{", "7", "[7]", "[{}]", '[{"at_s": 1}]', "\udcff", "[" * 100_000),
        *[f"[{ROW.replace(*change)}]" for change in (("kill", "hug"), ("[1]", "[]"), ("[1]", "[0]"), ("1,", "NaN,"))],
        f"[{ROW.replace('1,', '1' + '0' * 400 + ',')}]",
    ],
    ids=lambda text: text[:60],
)
def test_a_damaged_file_is_refused_by_its_name(text: str, tmp_path: Path) -> None:
    (tmp_path / "faults.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(RunFolderError, match=r"faults\.json: must be the faults of a flight") as caught:
        load_faults(tmp_path)
    assert not re.search(r"Error|FaultEvent\(|<enum|object is", str(caught.value))  # words, not Python's


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("kill", "hug"),
            '[0].kind = "hug": must be one of kill, restart, stop, partition, base-lost, late, blind, wind, '
            "gnss-outage, gnss-drift, position-jump, position-freeze, position-drift, height-error, motor, "
            "scan-errors, range-errors, pilot, disk-full, insider, outsider",
        ),
        (("kill", "late"), "[0].late_s = null: must be a number, 0 to 10"),
        (("kill", "gnss-drift"), "[0] has no drift_mps"),
        (("[1]", "[0]"), "[0].vehicles = [0]: must be ids, each 1 to 3"),
        (("[1]", "[2, 9]"), "[0].vehicles = [2, 9]: must be ids, each 1 to 3"),
        (("[1]", "[true]"), "[0].vehicles = [true]: must be ids, each 1 to 3"),
        (("1,", "NaN,"), "[0].at_s = NaN: must be a number, at most 1e+07, or null"),
        (('"until_s"', '"lost"'), "[0] has no until_s"),
        (('""', "7"), "[0].asked = 7: must be text"),
        (
            ('"asked"', '"lie": [7], "asked"'),
            "[0].lie = [7]: must be one of push, offset, floor, ghost, usurper, sinkhole, phase, lease, stall, roster, "
            "clock, ranges, orders, trunks, or null",
        ),
        (("[{", "[[{"), "line 1: is no JSON"),
        (("[{", "{"), "line 1: is no JSON"),
    ],
)
def test_what_is_wrong_in_a_damaged_file_is_said(change: tuple[str, str], words: str, tmp_path: Path) -> None:
    (tmp_path / "faults.json").write_text(f"[{ROW}]".replace(*change))
    with pytest.raises(RunFolderError) as caught:
        load_faults(tmp_path, 3)
    assert str(caught.value).endswith(f"faults.json: must be the faults of a flight: {words}")
