"""Where the neighbours are, and this vehicle in the mission: one Localiser, with GNSS on all or GNSS-denied."""
