"""For all tests: hypothesis draws the same examples every time, and a slow machine fails nothing.

Tests reach into objects, copy them and replace their parts, which compiled ones do not allow: this process imports
the sources. The programs that tests start are compiled, and must fly the same. `UNDERSTORY_PURE= pytest` is compiled,
too, as `make test` runs those that fly swarms (marked `compiled` here, by their folder); those of them that are marked
`sources` are left out then, and run with the rest.
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import is_hypothesis_test, settings

with pytest.MonkeyPatch.context() as environment:
    if "UNDERSTORY_PURE" not in os.environ:
        environment.setenv("UNDERSTORY_PURE", "1")
    from mission.common.compiled import STATE, why_pure

from tests.unit.shell.service_kit import Manager

settings.register_profile("understory", derandomize=True, deadline=None)
settings.load_profile("understory")
FLIGHTS = [Path(__file__).parent / name for name in ("scenario", "study", "report")]  # as in the Makefile
LONGEST = ("test_pages_run.py", "test_followers_without_d2.py", "test_search_slice.py")  # half a minute in one test
FUZZ = int(os.environ.get("FUZZ", "0"))  # `make fuzz`: so many times as many examples, others each time

# Thousands of tests are many objects, and all of them stay: not to be searched for garbage again and again.
gc.set_threshold(20_000, 20, 100)


@pytest.hookimpl(tryfirst=True)  # before -m leaves out some
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    # What takes longest begins first: else one core waits at the end for the other.
    items.sort(key=lambda item: (item.path.name not in LONGEST, not flies_swarms(item)))
    for item in items:
        if flies_swarms(item) and not item.get_closest_marker("sources"):
            item.add_marker("compiled")
    if STATE == "compiled":
        needy = [item for item in items if item.get_closest_marker("sources")]
        config.hook.pytest_deselected(items=needy)
        items[:] = [item for item in items if item not in needy]
    for drawn in {getattr(item, "obj", None) for item in items if FUZZ}:
        if is_hypothesis_test(drawn):  # it has no public way to change settings that a test has
            usual = getattr(drawn, "_hypothesis_internal_use_settings", settings.default)
            more = settings(usual, derandomize=False, max_examples=FUZZ * usual.max_examples)
            drawn._hypothesis_internal_use_settings = more


def flies_swarms(item: pytest.Item) -> bool:
    return any(folder in item.path.parents for folder in FLIGHTS)


def pytest_collection_finish() -> None:
    gc.freeze()


# Tests interrupt what they start. Under nohup, or in a shell's background, children would ignore that.
for number in (signal.SIGINT, signal.SIGHUP):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, signal.default_int_handler if number is signal.SIGINT else signal.SIG_DFL)


def pytest_report_header() -> str:
    """What is tested."""
    return f"understory: {STATE}; its programs: {why_pure() or 'compiled'}"


@pytest.fixture(scope="session", autouse=True)
def _users_state_stays_as_it_is(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    """A service manager that listens, by both kinds of name."""
    manager = Manager(str(tmp_path / "notify") if request.param == "path" else f"@understory-test-{os.getpid()}")
    yield manager
    manager.socket.close()


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """A flight in this process leaves signals ignored, which the programs of later tests would inherit."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        if handler is not None:  # as C has it
            signal.signal(number, handler)
