"""Response of the airframes to a step of velocity, with each drag.

python -m sim_bridge.world.airframe.steps
"""

from __future__ import annotations

from typing import Final

from mission.common.frames import LocalFrame, Vec3, Wgs84
from mission.document.model import Drag
from sim_bridge.world.airframe.base import Airframe
from sim_bridge.world.airframe.jsbsim_quad import JsbsimQuad
from sim_bridge.world.airframe.point_mass import PointMass

SAMPLE_S: Final = 0.02
HOLD_S: Final = 6.0  # of the velocity before the step
FRAME = LocalFrame(Wgs84(47.4, 8.5, 488.0))
ALOFT: Vec3 = (0.0, 0.0, -100.0)
STEPS: tuple[tuple[str, Vec3, Vec3], ...] = (
    ("0 to 3 m/s", (0.0, 0.0, 0.0), (3.0, 0.0, 0.0)),
    ("3 m/s to 0", (3.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
)


def main() -> None:
    """Print the table."""
    print("| airframe | drag | step | 63 % after | after 2.5 s | after 6 s | after 15 s |")
    print("|---|---|---|---|---|---|---|")
    for drag in Drag:
        for name in ("JSBSim", "point mass"):
            for title, before, after in STEPS:
                north = step(airframe(name, drag), before, after)
                way = [(v - before[0]) / (after[0] - before[0]) for v in north]
                t63_s = (next(i for i, share in enumerate(way) if share >= 0.632) + 1) * SAMPLE_S
                at = " | ".join(f"{round(north[round(s / SAMPLE_S) - 1], 2) + 0.0:.2f} m/s" for s in (2.5, 6.0, 15.0))
                print(f"| {name} | {drag} | {title} | {t63_s:.2f} s | {at} |")


def airframe(name: str, drag: Drag) -> Airframe:
    """One in the air."""
    return JsbsimQuad(FRAME, ALOFT, 0.0, drag=drag) if name == "JSBSim" else PointMass(ALOFT, 0.0, drag=drag)


def step(body: Airframe, before: Vec3, after: Vec3) -> list[float]:
    """Velocity north, m/s, each SAMPLE_S for 15 s after the command has changed."""
    body.set_armed(True)
    for vel_ned_mps, seconds in (((0.0, 0.0, 0.0), 8.0), (before, HOLD_S)):
        body.command(vel_ned_mps, 0.0)
        for _ in range(round(seconds / SAMPLE_S)):
            body.step(SAMPLE_S)
    body.command(after, 0.0)
    north = []
    for _ in range(round(15.0 / SAMPLE_S)):
        body.step(SAMPLE_S)
        north.append(body.state.vel_ned_mps[0])
    return north


if __name__ == "__main__":
    main()
