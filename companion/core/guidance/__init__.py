"""The desired velocity: the five movement conditions, coverage, and the way through obstacles."""
