"""Golden transcripts of the tick: each of its four arrows, played by itself, makes what was written down."""

from __future__ import annotations

import math

import pytest

from companion.core.model.beacon import PeerReport
from companion.core.model.states import FlightState
from tests.tick_arrows import ARROWS, FLIGHTS, TESTDATA, play, read, record
from tests.unit.core.core_kit import neighbour
from tests.unit.core.value_text import Reader, Writer, differences

pytestmark = pytest.mark.sources


@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize("arrow", ARROWS)
def test_arrow_makes_what_the_transcript_says(arrow: str, name: str) -> None:
    assert play(arrow, name)[:5] == [], "python -m tests.golden --rewrite, and read the difference"


@pytest.mark.parametrize("name", FLIGHTS)
def test_every_transcript_feeds_every_arrow(name: str) -> None:
    ticks = read(name)
    assert all(tick.picture is not None and tick.orders is not None for tick in ticks)
    assert sum(tick.desired is not None for tick in ticks) > 100
    assert sum(tick.setpoint is not None for tick in ticks) > 25
    assert {tick.orders.state for tick in ticks} >= {FlightState.READY, FlightState.TAKING_OFF, FlightState.HOLD}


def test_a_transcript_can_be_written_anew() -> None:
    assert record("satellites_leader") == (TESTDATA / "satellites_leader.txt").read_text(encoding="utf-8")


def test_among_trees_some_are_seen() -> None:
    assert any(tick.brief is not None and tick.brief.around.cloud.norths for tick in read("trees_leader"))


def test_values_are_read_back_to_the_bit_and_said_once() -> None:
    first = neighbour(2, (1.0, -0.0, 0.1 + 0.2), age_s=0.05)
    second = neighbour(2, (1.0, -0.0, 0.1 + 0.2), age_s=0.1)
    values = [first, second, PeerReport(3, (math.inf, math.nan, 0.0), 0.0, silent=True), {2: [True, False]}]
    writer, reader = Writer(), Reader()
    texts = [writer.text(value) for value in values]
    assert texts[1] == "Neighbour(2, age_s=0.1)"
    for text, value in zip(texts, values, strict=True):
        assert list(differences(reader.value(text), value)) == []


def test_a_difference_is_named() -> None:
    one, other = neighbour(2, (1.0, 0.0, 0.0)), neighbour(2, (1.0, -0.0, 0.0))
    assert list(differences(one, other)) == ["rel_ned_m[1]: 0.0 -> -0.0"]
