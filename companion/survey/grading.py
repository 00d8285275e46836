"""Quality gates of a fitted stem -> how far it is to be relied on, with the reason.

As 3DFin's (Laino et al. 2024, "3DFin: a software for automated 3D forest inventories from terrestrial point clouds",
Forestry 97, 479-496): sectors of the circumference that are occupied, points within the stem, number of points.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from companion.survey.observation import Grade
from companion.survey.stem_fit import StemFit


class Gate(NamedTuple):
    """A figure of a fit beyond which it gets a grade at best."""

    figure: str
    limit: float
    grade: Grade
    reason: str


# The first that a fit fails counts: the worse ones come first. Figures as `figures_of` has them, the more the worse.
GATES: Final = (
    Gate("few", 1.0 / 40.0, Grade.POOR, "few rays"),
    Gate("hidden", 1.0 - 0.25, Grade.POOR, "seen from one side"),
    Gate("inner", 0.10, Grade.POOR, "rays end within the stem"),
    Gate("rms", 0.035, Grade.POOR, "not round"),
    Gate("sd", 0.04, Grade.POOR, "diameter uncertain"),
    Gate("few", 1.0 / 80.0, Grade.FAIR, "few rays"),
    Gate("hidden", 1.0 - 0.42, Grade.FAIR, "seen from one side"),
    Gate("inner", 0.03, Grade.FAIR, "rays end within the stem"),
    Gate("rms", 0.025, Grade.FAIR, "not round"),
    Gate("sd", 0.02, Grade.FAIR, "diameter uncertain"),
)


def grade_fit(fit: StemFit, dbh_sd_m: float) -> tuple[Grade, str]:
    """The grade and why it is no better; empty: it is GOOD."""
    figures = {
        "few": 1.0 / max(1, fit.rays),
        "hidden": 1.0 - fit.arc_share,
        "inner": fit.inner_share,
        "rms": fit.rms_m,
        "sd": dbh_sd_m,
    }
    for gate in GATES:
        if figures[gate.figure] > gate.limit:
            return gate.grade, gate.reason
    return Grade.GOOD, ""
