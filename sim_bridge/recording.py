"""Ground truth of one flight, sampled once a tick: what every figure about a flight is computed from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Recording:
    """Arrays over T ticks and n vehicles (vehicle id k in column k-1). NED metres about the mission's origin."""

    time_s: NDArray[np.float64]  # (T,) simulated
    pos_ned_m: NDArray[np.float64]  # (T, n, 3)
    vel_ned_mps: NDArray[np.float64]  # (T, n, 3)
    on_ground: NDArray[np.bool_]  # (T, n)
    armed: NDArray[np.bool_]  # (T, n)
    agent_alive: NDArray[np.bool_]  # (T, n) its companion answered in this tick
    range_m: NDArray[np.float64]  # (T, n) radio range in use
    phase: NDArray[np.int8]  # (T, n) SwarmPhase that its last beacon announced; -1 before the first
    acting: NDArray[np.bool_]  # (T, n) its last beacon claims an established lead
    leader: NDArray[np.int16]  # (T, n) whom its last beacon follows; 0: none
