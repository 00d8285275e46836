"""The state machine of a vehicle's role in its swarm: role and event -> next role. `election.Election` runs it.

What is not in the table is refused: it raises, as a broken invariant does.
"""

from __future__ import annotations

from enum import Enum

from companion.core.model.states import Role


class RoleEvent(Enum):
    """Events that change a role; the value says so in words."""

    HEAR = "it hears a lease that precedes its own claim, or the one that it follows"
    EXPIRE = "the lease that it follows has not been renewed in time"
    CLAIM = "it may lead, and its own claim precedes all that it hears"
    SUCCEED = "it is the heir, and its leader's last count has come"
    AGREE = "all that it hears agree on its claim; or it is the heir of a lost leader, or nobody has answered for long"
    RESIGN = "it may not lead, and there is no heir; or its count is used up"
    HAND_OVER = "the last count that it has announced has come: its heir leads"


TRANSITIONS: dict[Role, dict[RoleEvent, Role]] = {
    Role.UNLED: {
        RoleEvent.HEAR: Role.FOLLOWER,
        RoleEvent.CLAIM: Role.CLAIMANT,
    },
    Role.FOLLOWER: {
        RoleEvent.HEAR: Role.FOLLOWER,
        RoleEvent.EXPIRE: Role.UNLED,
        RoleEvent.CLAIM: Role.CLAIMANT,
        RoleEvent.SUCCEED: Role.LEADER,
    },
    Role.CLAIMANT: {
        RoleEvent.HEAR: Role.FOLLOWER,
        RoleEvent.AGREE: Role.LEADER,
        RoleEvent.RESIGN: Role.UNLED,
    },
    Role.LEADER: {
        RoleEvent.HEAR: Role.FOLLOWER,
        RoleEvent.HAND_OVER: Role.FOLLOWER,
        RoleEvent.RESIGN: Role.UNLED,
    },
}


def transition(role: Role, event: RoleEvent) -> Role:
    """The next role; ValueError: refused."""
    following = TRANSITIONS[role].get(event)
    if following is None:
        raise ValueError(f"role {role.name}: {event.name} is refused")
    return following
