"""Perception: scans become the obstacle map, the local obstacle cloud of a tick, and clear ghost tracks."""
