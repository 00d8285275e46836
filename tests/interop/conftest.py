"""What several interop tests share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from interop_kit import MISSION, Served, serving

COPTERS_SPEED = "3"  # ArduPilot boots for 42 s; MAVSDK repeats setpoints at 20 Hz of wall time, whatever the speed
SHARED = {"fleet", "copters", "vehicles", "flown", "served"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Side by side (--dist loadgroup), those of a file that share a server and its make go to the same worker."""
    for item in items:
        here = isinstance(item, pytest.Function) and item.path.parent == Path(__file__).parent
        if here and SHARED & set(item.fixturenames):
            makes = item.callspec.params.values() if hasattr(item, "callspec") else ()
            make = next((make for make in makes if make in ("px4", "ardupilot")), "")
            item.add_marker(pytest.mark.xdist_group(f"{item.path.stem}-{make}"))


@pytest.fixture(scope="session")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Two vehicles at the speed of real time; each test flies its own."""
    with serving(tmp_path_factory.mktemp("fleet"), MISSION) as served:
        yield served


@pytest.fixture(scope="session")
def copters(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Two vehicles that behave as ArduPilot; each test flies its own."""
    folder = tmp_path_factory.mktemp("copters")
    with serving(folder, MISSION, "--personality", "ardupilot", "--speed", COPTERS_SPEED) as served:
        yield served


@pytest.fixture(params=["px4", "ardupilot"])
def personality(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def vehicles(personality: str, request: pytest.FixtureRequest) -> Served:
    """The fleet, or the copters."""
    served: Served = request.getfixturevalue({"px4": "fleet", "ardupilot": "copters"}[personality])
    return served
