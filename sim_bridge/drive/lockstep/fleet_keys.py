"""The keys of a simulated fleet: as good as drawn at random, and the same for the same seed."""

from __future__ import annotations

import hashlib
from typing import Final

from companion.keys.crypto import public_key
from companion.keys.keyring import OPERATOR, Keyring
from companion.mavlink.peers.guard import SignedGuard
from companion.mavlink.peers.session import BASE_ID, open_session
from mission.document.load import dump_mission
from mission.document.model import Mission


class FleetKeys:
    """Keyrings of a mission's vehicles and its operator, and a guard for each start of a companion."""

    def __init__(self, mission: Mission) -> None:
        self._seed: Final = mission.sim.seed
        self._digest: Final = hashlib.sha256(dump_mission(mission).encode()).digest()  # of the file in the run folder
        self._starts: Final = dict[int, int]()
        owners = range(1, mission.swarm.size + 1)
        self._vehicles: Final = {k: public_key(self._draw("seed", k)) for k in owners}

    def keyring(self, owner: int) -> Keyring:
        """A vehicle's, or the operator's."""
        operator = public_key(self._draw("seed", OPERATOR))
        return Keyring(
            owner, self._draw("seed", owner), {0: self._draw("secret", 0)}, 0, operator, dict(self._vehicles)
        )

    def guard(self, node: int) -> SignedGuard:
        """Of the next start of a vehicle's companion, or of the base station."""
        start = self._starts[node] = self._starts.get(node, 0) + 1
        boot = int.from_bytes(self._draw(f"boot {start}", node)[:4], "little") or 1
        owner = OPERATOR if node == BASE_ID else node
        return SignedGuard(open_session(self.keyring(owner), node, self._digest, boot))

    def _draw(self, what: str, owner: int) -> bytes:
        return hashlib.sha256(f"understory simulated fleet: {self._seed}, {what}, {owner}".encode()).digest()
