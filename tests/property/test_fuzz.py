"""The fuzzer's corpus, read again: what was once a finding never is one again; and a slice of its campaigns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from companion.mavlink.endpoint import Endpoint
from tests.fuzz import targets
from tests.fuzz.campaign import run
from tests.fuzz.targets import CORPUS, FLIGHTS, TARGETS, corpus_of

KEPT = [(name, file) for name in TARGETS for file in corpus_of(name)]
CORPUS_MAX_BYTES = 500_000


@pytest.mark.parametrize(("name", "file"), KEPT, ids=[f"{name}/{file}" for name, file in KEPT])
def test_an_input_of_the_corpus_raises_nothing(name: str, file: str) -> None:
    TARGETS[name]().run(corpus_of(name)[file])


@pytest.mark.parametrize("name", [name for name in TARGETS if name not in FLIGHTS])
def test_a_slice_of_each_targets_campaign_finds_nothing(name: str, tmp_path: Path) -> None:
    tally = run(name, 150, corpus=tmp_path, say=lambda _: None)
    assert not tally.findings
    assert tally.executions >= 150


def test_a_slice_of_the_flights_under_attack_finds_nothing(tmp_path: Path) -> None:
    tally = run("open", 60_000, seed=8, corpus=tmp_path, say=lambda _: None)
    assert not tally.findings
    assert len(tally.reached) >= 12  # states of flight, led or not: it gets past the first gate


def test_corpus_is_small_and_each_target_has_one() -> None:
    assert all(corpus_of(name) for name in TARGETS)
    assert sum(path.stat().st_size for path in CORPUS.rglob("*") if path.is_file()) < CORPUS_MAX_BYTES


def test_a_finding_is_kept_short_under_a_name_and_replays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def read(data: bytes) -> object:
        if b"\xff" in data:
            raise IndexError("planted")
        return len(data)

    monkeypatch.setitem(TARGETS, "ld19", lambda: targets.PlainReader(read))
    tally = run("ld19", 5000, corpus=tmp_path, say=lambda _: None)
    (path,) = tally.findings.values()
    assert path.parent == tmp_path / "ld19"
    assert path.read_bytes() == b"\xff"


def planted(receive: Callable[[Endpoint, bytes, float], None]) -> Callable[[Endpoint, bytes, float], None]:
    def fails_in_flight(self: Endpoint, data: bytes, now_s: float) -> None:
        receive(self, data, now_s)
        assert not (self.agent.status(now_s).leader and len(data) == 1), "planted"

    return fails_in_flight


@pytest.mark.sources
def test_a_finding_in_flight_is_a_tape_that_replays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Endpoint, "from_peers", planted(Endpoint.from_peers))
    tally = run("open", 200_000, corpus=tmp_path, say=lambda _: None)
    (path,) = tally.findings.values()
    with pytest.raises(AssertionError, match="planted"):
        TARGETS["open"]().run(path.read_bytes())
