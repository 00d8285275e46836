"""Positions of the neighbours, and of this vehicle in the mission: one Localiser, with GNSS on all or GNSS-denied."""
