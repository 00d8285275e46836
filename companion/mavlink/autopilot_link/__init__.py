"""The link between a companion and its autopilot, where both ends have a key."""
