"""What is read from a Tick: phase and leader, rows of a recording, the trace."""

from __future__ import annotations

import contextlib
import resource
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from companion.core.model.states import SwarmPhase
from sim_bridge.judge import recording
from sim_bridge.judge.recording import Recorder, Trace, assembled
from tests.unit.judge.tick_kit import a_tick

ROOM_BYTES = 1000  # less than four ticks take
SPEED: Any = ((0.0, 0.0, 0.1),) * 3


def said(phase: SwarmPhase, acting: int = 0, leader: int = 0) -> Any:
    return SimpleNamespace(swarm_phase=phase, stop=0, acting_leader=acting, leader=leader)


def test_phase_is_what_the_acting_leader_announces() -> None:
    heard = {1: said(SwarmPhase.LAND), 2: said(SwarmPhase.TRANSIT, acting=2), 3: said(SwarmPhase.GATHER, acting=2)}
    tick = a_tick(said=heard)
    assert tick.phase((1, 2, 3)) is SwarmPhase.TRANSIT
    assert tick.leader((1, 2, 3)) == 2


def test_phase_is_the_furthest_that_anybody_who_counts_announces_while_nobody_leads() -> None:
    tick = a_tick(said={1: said(SwarmPhase.GATHER), 2: said(SwarmPhase.TRANSIT, acting=2), 3: said(SwarmPhase.LAND)})
    assert tick.phase((1, 3)) is SwarmPhase.LAND
    assert tick.phase((1,)) is SwarmPhase.GATHER
    assert tick.leader((1, 3)) is None


def test_a_swarm_that_has_said_nothing_assembles() -> None:
    assert a_tick().phase((1, 2, 3)) is SwarmPhase.ASSEMBLE
    assert a_tick().leader((1, 2, 3)) is None


def test_a_row_holds_what_each_vehicle_said_last_or_that_it_has_said_nothing() -> None:
    recorder = Recorder()
    recorder.add(a_tick(1.0, said={2: said(SwarmPhase.TRANSIT, acting=2, leader=2)}, said_s={2: 0.95}, answered=(1, 2)))
    found = recorder.recording()
    assert found.phase.tolist() == [[-1, SwarmPhase.TRANSIT, -1]]
    assert found.leader.tolist() == [[0, 2, 0]]
    assert found.acting.tolist() == [[False, True, False]]
    assert found.agent_alive.tolist() == [[True, True, False]]


def test_a_claim_of_a_companion_that_did_not_answer_since_is_no_claim_until_it_speaks_again() -> None:
    recorder = Recorder()
    claim = {2: said(SwarmPhase.TRANSIT, acting=2, leader=2)}
    recorder.add(a_tick(1.0, said=claim, said_s={2: 0.95}))
    recorder.add(a_tick(2.0, said=claim, said_s={2: 0.95}, answered=(1, 3)))
    recorder.add(a_tick(3.0, said=claim, said_s={2: 0.95}))
    recorder.add(a_tick(4.0, said=claim, said_s={2: 3.95}))
    assert recorder.recording().acting[:, 1].tolist() == [True, False, False, True]


@contextlib.contextmanager
def room_for(size_bytes: int) -> Iterator[None]:
    """Files of this process grow no further, as on a full disk: what is beyond is refused, a part may be taken."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size_bytes, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.sources  # its constant is compiled into what is
@pytest.mark.parametrize("where", ["disk", "memory", "disk that is full for a while", "full disk"])
def test_a_long_recording_is_kept_as_it_was_and_only_its_last_ticks_as_rows(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "KEPT_TICKS", 4)
    full_until = {"disk that is full for a while": 9, "full disk": 15}.get(where, 0)
    filed_from = 0 if where == "disk" else 11 if full_until == 9 else 15  # a chunk's last tick, with room again
    recorder = Recorder(None if where == "memory" else tmp_path)
    ticks = [a_tick(time_s, pos_ned_m=((time_s, 0.0, 0.0),) * 3) for time_s in range(1, 15)]
    for k, tick in enumerate(ticks):
        with room_for(ROOM_BYTES if k < full_until else resource.RLIM_INFINITY):
            recorder.add(tick)
        assert recorder.last == recorder.row(tick)
        assert len(recorder._rows) < 4
        assert len(recorder._arrays) == (0 if k >= filed_from else (k + 1) // 4)
    with room_for(ROOM_BYTES if where == "full disk" else resource.RLIM_INFINITY):
        assert recorder.recording().time_s.tolist() == list(range(1, 15))
    recorder.add(ticks[-1])
    assert recorder.recording().time_s.tolist() == [*range(1, 15), 14]
    whole = assembled([recorder.row(tick) for tick in (*ticks, ticks[-1])])
    for name in recording.COLUMNS:
        found, wanted = getattr(recorder.recording(), name), getattr(whole, name)
        assert found.dtype == wanted.dtype
        assert found.tolist() == wanted.tolist()
    assert list(tmp_path.iterdir()) == []  # the file has no name


def digest(**changes: Any) -> str:
    trace = Trace()
    trace.add(a_tick(**changes))
    return trace.hexdigest()


@pytest.mark.parametrize(
    "changes",
    [
        {"time_s": 0.05},
        {"pos_ned_m": ((0.0, 0.0, 0.0),) * 3},
        {"vel_ned_mps": SPEED},
        {"armed": (True, False, False)},
        {"mode": ("HOLD", "LAND", "HOLD")},
        {"frames": {2: (bytes(40),)}},
    ],
    ids=str,
)
def test_trace_shows_any_change_of_state_mode_or_beacon(changes: dict[str, Any]) -> None:
    assert digest(**changes) != digest()


def test_trace_knows_who_sent_a_beacon_but_not_its_sequence_number() -> None:
    frame = bytes(range(40))
    other_number = frame[:4] + b"\x99" + frame[5:]
    assert digest(frames={2: (frame,)}) == digest(frames={2: (other_number,)})
    assert digest(frames={2: (frame,)}) != digest(frames={3: (frame,)})
