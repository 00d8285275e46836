"""Estimates of an autopilot: satellites and odometry with their errors, and the state that the vehicle believes."""
