"""The world: airframes, their autopilots, and the air between them. Deterministic; it moves only in step."""
