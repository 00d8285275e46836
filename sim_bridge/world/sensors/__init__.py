"""Sensors that simulated vehicles carry: a lidar that turns level with the airframe, and its driver."""
