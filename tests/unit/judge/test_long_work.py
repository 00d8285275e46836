"""Rate and time left of long work, in words."""

from __future__ import annotations

import pytest

from sim_bridge.judge.progress import describe_pace


@pytest.mark.parametrize(
    ("done", "share", "elapsed_s", "words"),
    [
        (0, 0.0, 10.0, ""),
        (3, 0.0, 0.0, ""),
        (5, 0.25, 30.0, ", 10 a minute, 2 min left"),
        (5, 0.5, 60.0, ", 5 a minute, 60 s left"),
        (1, 0.01, 60.0, ", 1 a minute, 99 min left"),
        (4, 1.0, 60.0, ", 4 a minute, 0 s left"),
        (4, 0.0, 60.0, ", 4 a minute"),
        (1234, 0.5, 60.0, ", 1234 a minute, 60 s left"),
    ],
)
def test_pace_in_words(done: int, share: float, elapsed_s: float, words: str) -> None:
    assert describe_pace(done, share, elapsed_s) == words
