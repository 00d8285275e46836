"""Leaders that are given up, and what two that have given one up bring about."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.model.beacon import Beacon, Lease
from companion.core.model.events import Position
from companion.core.model.states import FlightState, SwarmPhase
from companion.core.model.vectors import ZERO
from companion.core.swarm.election import SEQ_JUMP, Election
from companion.core.swarm.phases import Phases
from companion.core.swarm.picture import Picture
from companion.core.swarm.priorities import Priorities
from companion.core.swarm.trust.blocklist import BLOCKED_S, DOUBT_LIMIT
from companion.core.swarm.trust.lead_watch import APART_PERIODS
from companion.core.swarm.trust.trust import Trust
from mission.common.frames import Vec3
from tests.unit.core.core_election_kit import follower_of
from tests.unit.core.core_kit import beacon, lease, mission, picture

pytestmark = pytest.mark.sources

MISSION = mission(swarm={"size": 9, "leader_priority": [1, 4]}, route={"at_end": "land"})
ME, LEADER = 9, 1
OWN = lease(LEADER, 500, priority=2, established=True)


def trust() -> Trust:
    return Trust(MISSION, ME, Priorities(MISSION))


def look(now_s: float, pos_ned_m: Vec3 = ZERO, *, dest_ned_m: Vec3 | None = None) -> Picture:
    own = Position(pos_ned_m, ZERO, None)
    return picture(now_s=now_s, own=own, state=FlightState.TRANSIT, airborne=True, dest_ned_m=dest_ned_m)


def receive(judge: Trust, said: Beacon, election: Election, now_s: float) -> bool:
    """As the agent does."""
    return judge.receive_lease(judge.sanitise_beacon(said, now_s), election, now_s)


def accuse(*accusers: int, accused: int = LEADER, now_s: float = 1.0) -> tuple[Trust, Election]:
    """A follower that hears each of these say that they have given it up."""
    judge, election = trust(), follower_of(OWN)
    for sender in accusers:
        receive(judge, beacon(sender, accused=accused), election, now_s)
    judge.run_period(look(now_s), election, Phases(MISSION), is_held=False)
    return judge, election


def test_two_that_have_given_up_a_leader_are_believed_and_one_is_not() -> None:
    assert accuse(3)[1].lease == OWN
    assert accuse(3, LEADER)[1].lease == OWN  # itself is no witness
    assert accuse(3, 3)[1].lease == OWN
    assert accuse(3, 4, accused=2)[1].lease == OWN
    judge, election = accuse(3, 4)
    assert election.lease is None
    claim = beacon(LEADER, lease=replace(OWN, seq=OWN.seq + 90), ref_ned_mps=(3.0, 0.0, 0.0))
    assert not receive(judge, claim, election, 2.0)
    assert election.lease is None
    assert judge.sanitise_beacon(claim, 2.0).ref_ned_mps == ZERO
    assert not judge.blocklist.has(LEADER)  # its other words count
    assert receive(judge, claim, election, 1.1 + BLOCKED_S)


def test_an_accusation_holds_until_it_is_taken_back() -> None:
    judge, election = accuse(3, 4)
    assert not receive(judge, beacon(2, lease=OWN, hop=1), election, 2.0)
    receive(judge, beacon(4), election, 60.0)
    assert receive(judge, beacon(2, lease=replace(OWN, seq=1100), hop=1), election, 60.1)


def test_who_is_blocked_accuses_nobody() -> None:
    judge, election = trust(), follower_of(OWN)
    judge.blocklist.block(3, "lies")
    for sender in (3, 4):
        receive(judge, beacon(sender, accused=LEADER), election, 1.0)
    judge.run_period(look(1.0), election, Phases(MISSION), is_held=False)
    assert election.lease == OWN


def test_who_hears_two_accuse_it_does_not_lead() -> None:
    assert not accuse(3, accused=ME)[0].bars_lead(1.0)
    assert accuse(3, 4, accused=ME)[0].bars_lead(1.0)
    assert not accuse(3, 4, accused=ME)[0].bars_lead(1.1 + BLOCKED_S)


def test_who_gives_up_a_leader_says_so_while_it_is_blocked() -> None:
    judge, election = trust(), follower_of(OWN)
    assert judge.accused == 0
    seq = OWN.seq
    receive(judge, beacon(LEADER, lease=OWN), election, 1.0)
    for ahead, accused in ((SEQ_JUMP + APART_PERIODS, 0), (SEQ_JUMP + APART_PERIODS + 1, LEADER)):
        seq += ahead
        receive(judge, beacon(LEADER, lease=replace(OWN, seq=seq)), election, 1.1)
        assert judge.accused == accused
    assert judge.blocklist.take_news() == [(LEADER, "counts far ahead of itself")]
    judge.run_period(look(1.2), election, Phases(MISSION), is_held=False)
    assert election.lease is None
    judge.run_period(look(1.2 + BLOCKED_S), election, Phases(MISSION), is_held=False)
    assert judge.accused == 0


def test_one_that_starts_anew_does_not_count_ahead_of_itself() -> None:
    """It was not heard for longer, and claims before it acts."""
    far = replace(OWN, seq=OWN.seq + 9 * SEQ_JUMP)
    for second, at_s in ((far, 1.1 + 0.1 * APART_PERIODS), (replace(far, established=False), 1.1)):
        judge, election = trust(), follower_of(OWN)
        receive(judge, beacon(LEADER, lease=OWN), election, 1.0)
        receive(judge, beacon(LEADER, lease=second), election, at_s)
        assert judge.accused == 0


def give_up(*, followers: int, accuser: int = 0, until_s: float) -> tuple[Trust, Election]:
    """A follower that gives up a leader at 1 s; it hears these follow that one, by relayed counts."""
    judge, election, phases = trust(), follower_of(OWN), Phases(MISSION)
    receive(judge, beacon(LEADER, lease=OWN), election, 0.9)
    receive(judge, beacon(LEADER, lease=replace(OWN, seq=9999)), election, 1.0)
    assert judge.accused == LEADER
    for k in range(round(until_s * 10.0) + 1):
        now_s = 1.0 + 0.1 * k
        for sender in range(2, 2 + followers):
            accused = LEADER if sender == accuser else 0
            receive(judge, beacon(sender, lease=replace(OWN, seq=500 + k), hop=1, accused=accused), election, now_s)
        judge.run_period(look(now_s), election, phases, is_held=False)
    return judge, election


@pytest.mark.parametrize(
    ("followers", "accuser", "waits"), [(2, 0, True), (7, 0, True), (2, 3, False), (1, 0, False), (0, 0, False)]
)
def test_who_alone_gives_up_a_leader_that_others_follow_claims_no_lead(
    followers: int, accuser: int, waits: bool
) -> None:
    """One that a false place had pushed off the way led nobody, beside the leader of the others, for 57 s."""
    judge, _ = give_up(followers=followers, accuser=accuser, until_s=20.0)
    assert judge.bars_lead(21.0) is waits


def test_that_others_follow_it_frees_nobody_whom_one_has_given_up() -> None:
    """Time does: what others say may only restrict."""
    judge, election = give_up(followers=7, until_s=BLOCKED_S - 0.5)
    assert (judge.accused, election.lease) == (LEADER, None)
    judge, election = give_up(followers=7, until_s=BLOCKED_S + 1.0)
    assert judge.accused == 0
    assert election.lease is not None
    assert not judge.bars_lead(2.0 + BLOCKED_S)


@pytest.mark.parametrize("is_full", [False, True])
def test_after_its_minute_a_leader_has_to_take_nobody_farther_off(is_full: bool) -> None:
    """One that was pushed off the way gave the same leader up at once, again and again. One that was not blocked, as
    too many were, is given no other bound.
    """
    judge, election, phases = trust(), follower_of(OWN), Phases(MISSION)
    for vehicle in (3, 4) if is_full else ():
        judge.blocklist.note_doubt(vehicle, "lies", DOUBT_LIMIT, 1.0)
    phases.adopt_phase(SwarmPhase.GATHER, 0.0)
    judge.run_period(look(0.0), election, phases, is_held=False)
    phases.adopt_phase(SwarmPhase.TRANSIT, 1.0)
    for _ in range(2):
        judge.run_period(look(1.0, dest_ned_m=(80.0, 0.0, 0.0)), election, phases, is_held=False)

    def fly(since_s: float, east_m: float) -> int:
        for k in range(30):
            judge.run_period(look(since_s + 0.1 * k, (40.0, east_m, 0.0)), election, phases, is_held=False)
        return judge.accused

    assert fly(3.0, 90.0) == (0 if is_full else LEADER)
    judge.run_period(look(9.0 + BLOCKED_S, (40.0, 90.0, 0.0)), election, phases, is_held=False)
    election = follower_of(OWN)
    assert fly(10.0 + BLOCKED_S, 90.0) == (LEADER if is_full else 0)


def test_who_is_blocked_and_leads_on_stays_blocked_while_another_leads() -> None:
    """It was forgiven after a minute, and led half of the swarm again."""

    def is_blocked(claim: Beacon, election: Election) -> bool:
        judge = trust()
        judge.blocklist.note_doubt(3, "leaves the way", DOUBT_LIMIT, 0.0)
        for k in range(100):
            judge.sanitise_beacon(claim, float(k))
            judge.run_period(look(float(k)), election, Phases(MISSION), is_held=True)
        return judge.blocklist.has(3)

    claim = beacon(3, lease=lease(3, 7, established=True))
    assert is_blocked(claim, follower_of(OWN))
    assert not is_blocked(beacon(3, lease=OWN), follower_of(OWN))
    assert not is_blocked(beacon(3, lease=lease(3, 7)), follower_of(OWN))
    assert not is_blocked(claim, Election(ME, 0))  # there is no other
    assert not is_blocked(claim, follower_of(Lease(LEADER, 500, 2, 0, established=True, quorum=False)))
