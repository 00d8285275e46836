"""Modules whose mutants are tried, in groups, and the tests that are to notice them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Group:
    """`files`: as mutmut's patterns. `quick`: tests of all groups, each run where it comes by; `slow`: of survivors."""

    name: str
    files: tuple[str, ...]
    quick: tuple[str, ...]
    slow: tuple[str, ...]


CORE: Final = "tests/unit/core"
LINK: Final = "tests/unit/mavlink"
PEERS: Final = "companion/mavlink/peers"
TRANSCRIPTS: Final = "tests/scenario/test_tick_transcripts.py"
GROUPS: Final = (
    Group(
        "safety filter, stopping",
        ("companion/core/safety/*.py",),
        (f"{CORE}/safety",),
        (
            f"{CORE}/perception/test_vehicle_tracks.py",
            "tests/property/test_core_trees.py",
            TRANSCRIPTS,
            "tests/property/test_core_safety_laws.py",
            "tests/scenario/test_safety_filter_flights.py",
        ),
    ),
    Group(
        "election, quorum",
        ("companion/core/swarm/election.py", "companion/core/swarm/roster.py", "companion/core/swarm/priorities.py"),
        (f"{CORE}/swarm", f"{CORE}/test_agent.py"),
        ("tests/scenario/test_core_succession_laws.py", TRANSCRIPTS),
    ),
    Group(
        "trust",
        ("companion/core/swarm/trust/*.py",),
        (f"{CORE}/swarm", f"{CORE}/test_agent.py"),
        (TRANSCRIPTS, "tests/scenario/test_insiders.py"),
    ),
    Group(
        "verifier of the radio",
        tuple(f"{PEERS}/{name}.py" for name in ("frame_mac", "guard", "manifest", "session", "stream")),
        tuple(
            f"{LINK}/test_{name}.py"
            for name in (
                "signing",
                "signing_rotation",
                "signing_words",
                "signing_checks",
                "signing_vouched",
                "mac_first",
            )
        ),
        (f"{LINK}/test_endpoint_records.py", "tests/property/test_order_books.py"),
    ),
    Group(
        "orders",
        ("companion/mavlink/orders/*.py",),
        tuple(f"{LINK}/test_{name}.py" for name in ("order_book", "order_choices", "orders", "endpoint_orders")),
        ("tests/property/test_order_books.py", "tests/unit/order"),
    ),
)
