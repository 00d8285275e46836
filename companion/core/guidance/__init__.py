"""The velocity that the mission wishes for: the five movement conditions, coverage, and the way through obstacles."""
