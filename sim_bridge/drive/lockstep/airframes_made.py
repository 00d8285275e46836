"""Airframes that are seen to be made: JSBSim takes a second for each."""

from __future__ import annotations

from mission.common.frames import LocalFrame, Vec3
from sim_bridge.judge.progress import Progress
from sim_bridge.world.airframe.base import Airframe, AirframeFactory


def counted(make: AirframeFactory, total: int, progress: Progress) -> AirframeFactory:
    """`make`, which is seen to go on."""
    made = 0

    def make_one(frame: LocalFrame, pos_ned_m: Vec3, seed: int) -> Airframe:
        nonlocal made
        body = make(frame, pos_ned_m, seed)
        made += 1
        progress.stage("making vehicles", made, total)
        return body

    return make_one
