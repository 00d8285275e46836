"""Attenuation of a radio link by trunks: the share of its range that is left.

Three models, `[sim] radio_trunks`. "disc": nothing is lost, the paper's. "cut": one trunk across the line ends the
link, the worst case. "attenuated": every trunk across takes `radio_trunk_db`. The range is where free space has used
up the margin of the link; a loss of L dB shortens it, at 20 dB a decade, to the share 10^(-L/20): one trunk of 6 dB
halves it, two quarter it. A box counts as one trunk, which is too little for a thick wall.

The loss of a trunk, from the field behind an opaque strip as wide (two knife edges; Fresnel integrals as in ITU-R
P.526): 0.25 m, midway between antennas 10 m apart, 2.7 dB at 2.4 GHz and 4.1 dB at 5.8 GHz; 1 m from one of them 4.4
and 6.6 dB; 0.35 m there 6.0 and 8.8 dB. So 6 dB is on the safe side of most. Crowns, which stand above the antennas
here, would take more: 0.58 dB/m by Weissberger's modified exponential decay (0.45 f^0.284 d, f in GHz, up to 14 m;
ECAC-TR-81-101) at 2.4 GHz, where 400 trunks/ha of 0.25 m and 6 dB make 0.06 dB/m. Measurements at trunk level find
that the product of density and diameter governs the loss, as it does here (Azevedo & Santos 2011, IEEE Transactions on
Antennas and Propagation 59 (6), 2357-2367).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mission.common.frames import Vec3
from mission.document.model import RadioTrunks, Sim
from mission.stand.stand import Stand

ANTENNA_UP_M: Final = 0.2  # above a vehicle's feet: what stands on the ground does not send from below it

RangeShare = Callable[[Vec3, Vec3], float]  # places of two vehicles (NED m) -> 0..1 of the range between them


def range_share(sim: Sim, stand: Stand) -> RangeShare | None:
    """By `[sim] radio_trunks`; None: nothing is lost anywhere. The same from a to b as from b to a."""
    if sim.radio_trunks is RadioTrunks.DISC or not stand.has_obstacles:
        return None
    factor = 0.0 if sim.radio_trunks is RadioTrunks.CUT else 10.0 ** (-sim.radio_trunk_db / 20.0)

    def share(a_ned_m: Vec3, b_ned_m: Vec3) -> float:
        if b_ned_m < a_ned_m:
            a_ned_m, b_ned_m = b_ned_m, a_ned_m
        here, there = _antenna_enu_m(a_ned_m), _antenna_enu_m(b_ned_m)
        across = len(stand.crossed(here, there)) + len(stand.boxes_crossed(here, there))
        return factor**across if across else 1.0

    return share


def _antenna_enu_m(ned_m: Vec3) -> Vec3:
    return (ned_m[1], ned_m[0], ANTENNA_UP_M - ned_m[2])
