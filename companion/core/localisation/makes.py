"""The makes of Localiser, and the one place that chooses between them."""

from __future__ import annotations

from companion.core.localisation.gnss_denied.localiser import GnssDeniedLocaliser
from companion.core.localisation.gnss_localiser import GnssLocaliser
from companion.core.localisation.localiser import Localiser
from mission.document.model import Mission


def build_localiser(mission: Mission, vehicle_id: int) -> Localiser:
    """The make that a mission's vehicles have."""
    if mission.flies_by_ranges:
        return GnssDeniedLocaliser(mission, vehicle_id)
    return GnssLocaliser(mission, vehicle_id)
