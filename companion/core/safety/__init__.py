"""The last word on every setpoint: how a vehicle stops, what pushes it, and the filter that keeps its limits."""
