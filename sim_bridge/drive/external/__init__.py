"""`sim-bridge fly --autopilots`: companions over autopilots that somebody else runs: SITL, HITL."""
