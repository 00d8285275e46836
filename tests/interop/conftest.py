"""What several interop tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from interop_kit import MISSION, Served, serving


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Two vehicles at the speed of real time; each test flies its own."""
    with serving(tmp_path_factory.mktemp("fleet"), MISSION) as served:
        yield served
