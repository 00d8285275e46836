"""The link between a companion and its autopilot: keys at both ends, and what it is asked for beside the flight."""
