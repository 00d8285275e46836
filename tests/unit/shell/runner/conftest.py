"""A runner for each test."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from companion.shell import runner as runner_module
from tests.unit.shell.runner_kit import Bench


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    bench = Bench()
    monkeypatch.setattr(runner_module, "time", SimpleNamespace(monotonic=lambda: bench.now_s))
    monkeypatch.setattr(runner_module, "select", SimpleNamespace(select=bench.select))
    return bench
