"""The differences that remain, each with its reason: at most three for a personality. A stale one fails the tool."""

from __future__ import annotations

from dataclasses import dataclass

from mission.document.model import Personality
from sim_bridge.conformance.check import Check, Difference

EVERY_FLIGHT = frozenset[str]()


@dataclass(frozen=True, slots=True)
class Explained:
    """`recordings`: names, none meaning all of that personality. `what`: of the Differences that it covers."""

    personality: Personality
    check: str
    what: frozenset[str]
    reason: str
    recordings: frozenset[str] = EVERY_FLIGHT

    def of_flight(self, personality: Personality, name: str) -> bool:
        """True when it speaks of that flight."""
        return self.personality is personality and (not self.recordings or name in self.recordings)

    def covers(self, check: Check, difference: Difference) -> bool:
        """True for one of its differences."""
        return check.name == self.check and difference.what in self.what


EXPLAINED = (
    Explained(
        Personality.PX4,
        "streams",
        frozenset({"DISTANCE_SENSOR (132)", *(f"message {k}" for k in (8, 29, 42, 87, 380, 411, 436, 12901, 12904))}),
        "PX4 streams with nothing behind them here: LINK_NODE_STATUS (8), SCALED_PRESSURE (29), MISSION_CURRENT"
        " (42), POSITION_TARGET_GLOBAL_INT (87), DISTANCE_SENSOR (132), TIME_ESTIMATE_TO_TARGET (380),"
        " CURRENT_EVENT_SEQUENCE (411), CURRENT_MODE (436), OPEN_DRONE_ID_LOCATION (12901), OPEN_DRONE_ID_SYSTEM"
        " (12904). Asking for them is acknowledged as recorded.",
    ),
    Explained(
        Personality.PX4,
        "commands",
        frozenset({"ack 400 TEMPORARILY_REJECTED to 1/195: order"}),
        "PX4 acknowledged the arm request, one of three sent at once, 4 ms after a request sent 10 ms later. Why, the"
        " recording does not tell. Our model answers every command at once, in the order of arrival.",
        frozenset({"px4_mavsdk_A"}),
    ),
    Explained(
        Personality.ARDUPILOT,
        "streams",
        frozenset({"message 62", "message 65"}),
        "NAV_CONTROLLER_OUTPUT and RC_CHANNELS: there is no navigation controller and no RC here. Asking for them is"
        " acknowledged as recorded.",
        frozenset({"ap_pymavlink_A"}),
    ),
)
EXPLAINED_MAX = 3  # for a personality


@dataclass(frozen=True, slots=True)
class Verdict:
    """One flight's checks, sorted."""

    explained: tuple[tuple[str, Difference, Explained], ...]  # check, what, why
    unexplained: tuple[tuple[str, Difference], ...]
    stale: tuple[Explained, ...]  # speak of this flight, and nothing there is different

    @property
    def holds(self) -> bool:
        """All is as recorded or explained, and nothing is explained for nothing."""
        return not self.unexplained and not self.stale


def judge(
    personality: Personality, name: str, checks: list[Check], known: tuple[Explained, ...] = EXPLAINED
) -> Verdict:
    """Known differences, with the reason of each."""
    ours = [each for each in known if each.of_flight(personality, name)]
    explained: list[tuple[str, Difference, Explained]] = []
    unexplained: list[tuple[str, Difference]] = []
    for check in checks:
        for difference in check.differences:
            why = next((each for each in ours if each.covers(check, difference)), None)
            if why:
                explained.append((check.name, difference, why))
            else:
                unexplained.append((check.name, difference))
    used = [why for _, _, why in explained]
    return Verdict(tuple(explained), tuple(unexplained), tuple(each for each in ours if each not in used))
