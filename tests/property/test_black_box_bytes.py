"""Whatever bytes a black box holds: a replay ends in words, never in an exception."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from companion.journal import mcap
from companion.journal.reading import Flight
from companion.journal.replay import replay_flight
from tests.unit.journal.journal_kit import Messages, chunks_of, file_of, recorded, sealed_anew


@functools.cache
def whole_log() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return recorded(Path(folder), 12).segments[1].read_bytes()


def replay_of(data: bytes) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "vehicle-3-flight-0001-0001.mcap")
        path.write_bytes(data)
        replayed = replay_flight(Flight(3, 1, {1: path}))
        replayed.summary.lines()
        return replayed.is_same and not replayed.ends.startswith("cut off")


@given(st.binary(max_size=200))
def test_any_bytes_behind_the_magic(data: bytes) -> None:
    assert not replay_of(mcap.MAGIC + data)


@given(st.data())
def test_bytes_that_were_changed(data: st.DataObject) -> None:
    log = bytearray(whole_log())
    for _ in range(data.draw(st.integers(1, 4))):
        log[data.draw(st.integers(0, len(log) - len(mcap.end()) - 1))] ^= data.draw(st.integers(1, 255))
    assert not replay_of(bytes(log)) or log == whole_log()


@settings(max_examples=60)
@given(st.data())
def test_entries_of_any_content_with_a_chain_that_holds(data: st.DataObject) -> None:
    """As one writes them who knows the format, and means ill."""
    head, chunks = chunks_of(whole_log())
    messages: Messages = [message for chunk in chunks for message in chunk]
    at = data.draw(st.integers(0, len(messages) - 1))
    old = messages[at]
    body = data.draw(st.one_of(st.binary(max_size=60), st.just(old.data[: len(old.data) // 2]), st.sampled_from(ODD)))
    channel = data.draw(st.one_of(st.just(old.channel_id), st.integers(0, 20)))
    messages[at] = mcap.Message(channel, old.sequence, old.time_ns, body, b"")
    with contextlib.suppress(ValueError):  # nothing to seal: as it is
        messages = sealed_anew(messages)
    replay_of(file_of(head, messages))


ODD = [
    b"{}",
    b"[]",
    b'{"format":1}',
    b'{"tick":1,"time_s":1.0,"state":"X","cuts":[{}],"beacons":{},"said":[],"refused":{},"chain":"' + b"0" * 64 + b'"}',
    b'{"first_tick":"a","last_tick":1,"why":"x","chain":"' + b"0" * 64 + b'"}',
    b'{"tick":1,"time_s":1.0,"why":"broken","chain":"' + b"0" * 64 + b'"}',
    b"[" * 5000,
    bytes([0x9F] * 3000),
    b"\x83\x01\x02\x03",
]
