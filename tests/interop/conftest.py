"""What several interop tests share."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from interop_kit import MISSION, Served, serving

COPTERS_SPEED = "3"  # ArduPilot boots for 42 s; MAVSDK repeats setpoints at 20 Hz of wall time, whatever the speed
ALONE = ("test_external_autopilots.py", "test_restart.py")  # each test starts all that it needs
# By how long a worker is at what it has of a file, together: else the longest might begin last.
LONGEST_FIRST = (
    "test_preflight.py",
    "test_restart.py",
    "test_signed_companions.py",
    "test_signed_autopilot.py",
    "test_external_autopilots.py",
    "test_installed_make.py",
    "test_mavproxy.py",
    "test_mavsdk.py",
    "test_companions.py",
)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Side by side, the tests of a file that share a server and its make go to the same worker."""
    from xdist.scheduler import LoadScopeScheduling

    class ByServer(LoadScopeScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            file, _, test = nodeid.partition("::")
            if file.endswith(ALONE):
                return nodeid
            return file + next((make for make in ("px4", "ardupilot") if f"[{make}]" in test), "")

        def _assign_work_unit(self, node: Any) -> None:
            def rank(scope: str) -> int:
                return next((i for i, file in enumerate(LONGEST_FIRST) if file in scope), len(LONGEST_FIRST))

            self.workqueue.move_to_end(min(self.workqueue, key=rank), last=False)
            super()._assign_work_unit(node)

        def _reschedule(self, node: Any) -> None:
            """A worker wants to know of one test more than it runs; whoever is free first takes what else there is."""
            if not self.workqueue or self._pending_of(self.assigned_work[node]) <= 1:
                super()._reschedule(node)

    return ByServer(config, log) if config.getoption("dist") == "loadscope" else None


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
