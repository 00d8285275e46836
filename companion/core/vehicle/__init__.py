"""The own autopilot: what it reports, its modes, what is asked of it, the flight state machine, the failsafe table."""
