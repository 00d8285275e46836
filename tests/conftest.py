"""For all tests: hypothesis draws the same examples every time, and a slow machine fails nothing."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from service_kit import Manager

settings.register_profile("understory", derandomize=True, deadline=None)
settings.load_profile("understory")


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    """A service manager that listens, by both kinds of name."""
    manager = Manager(str(tmp_path / "notify") if request.param == "path" else f"@understory-test-{os.getpid()}")
    yield manager
    manager.socket.close()
