"""Whatever reaches an autopilot in flight, of either personality, nothing raises and the airframe is steered sanely."""

from __future__ import annotations

import math
import random
from typing import Any

import pytest

from companion.mavlink import dialect as mav
from mission.common.frames import LocalFrame, Wgs84
from mission.document.model import Personality
from sim_bridge.world.airframe.point_mass import PointMass
from sim_bridge.world.autopilot import Link, make_autopilot

STEP_S = 0.05
FRAMES = 2000
COMMANDS = [20, 21, 22, 176, 178, 179, 192, 400, 401, 410, 510, 511, 512, 519, 520]
NUMBERS = [math.nan, math.inf, -math.inf, 0.0, 1.0, -1.0, 4.0, 6.0, 9.0, 1e30, 21196.0, 32.0]


def message_of(kind: Any, rng: random.Random) -> Any:
    """Any bytes as fields, addressed to the autopilot."""
    values = list(kind.unpacker.unpack(rng.randbytes(kind.unpacker.size)))
    fields: dict[str, Any] = {}
    for name, length in zip(kind.ordered_fieldnames, kind.lengths, strict=True):
        count = 1 if isinstance(values[0], bytes) or length <= 1 else length
        fields[name] = values[:count] if count > 1 else values[0]
        del values[:count]
    fields |= {name: 1 for name in ("target_system", "target_component") if name in fields}
    return kind(*[fields[name] for name in kind.fieldnames])


def command(rng: random.Random) -> Any:
    params = [rng.choice(NUMBERS) for _ in range(7)]
    return mav.MAVLink_command_long_message(1, 1, rng.choice(COMMANDS), 0, *params)


@pytest.mark.parametrize("personality", list(Personality))
@pytest.mark.parametrize("seed", [1, 2])
def test_hostile_frames_never_raise(personality: Personality, seed: int) -> None:
    rng = random.Random(seed)
    body = PointMass((0.0, 0.0, -20.0), 0.0)
    autopilot = make_autopilot(personality, 1, body, LocalFrame(Wgs84(47.4, 8.5, 488.0)))
    codec = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    kinds = [kind for kind in mav.mavlink_map.values() if kind.unpacker.size]
    for step in range(FRAMES):
        now_s = 40.0 + step * STEP_S
        message = command(rng) if rng.random() < 0.5 else message_of(rng.choice(kinds), rng)
        data = bytearray(message.pack(codec))
        if rng.random() < 0.2:
            data[rng.randrange(len(data))] ^= rng.randrange(256)
        autopilot.receive(rng.choice(list(Link)), bytes(data), now_s)
        autopilot.update(now_s)
        body.step(STEP_S)
        for link in Link:
            autopilot.transmit(link, now_s)
    assert all(map(math.isfinite, (*body.state.pos_ned_m, *body.state.vel_ned_mps)))
