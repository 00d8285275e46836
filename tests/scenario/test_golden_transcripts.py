"""Golden transcripts of election and failsafe: what vehicles say and do, in scenarios that read like a flight card."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from golden import play, transcripts

from companion.core.vehicle.failsafe import Cause

ENDS = {  # with these the flight ends: only a landing follows, or nothing does
    Cause.ALONE_LONG,
    Cause.NO_MAJORITY_LONG,
    Cause.OBSTACLES_LOST,
    Cause.POSITION_DOUBTED_LONG,
    Cause.HEIGHT_FALSE,
    Cause.SWARM_LANDS,
}


@pytest.mark.parametrize("path", transcripts(), ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_what_happens_is_what_the_transcript_says(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert play(text).splitlines() == text.splitlines(), "python -m tests.golden --rewrite, and read the difference"


def test_every_row_of_the_failsafe_table_is_seen_to_act_and_to_clear() -> None:
    changes = "\n".join(path.read_text(encoding="utf-8") for path in transcripts())
    acted = set(re.findall(r"cause +\w+ -> (\w+)", changes))
    cleared = set(re.findall(r"cause +(\w+) -> \w+", changes))
    names = {cause.name.lower() for cause in Cause}
    assert acted - {"none"} == names
    assert names - cleared == {cause.name.lower() for cause in ENDS}


def test_a_command_that_does_not_exist_is_named() -> None:
    with pytest.raises(ValueError, match="'jump 3': no such command"):
        play("fleet size=1\njump 3\n----\n")
