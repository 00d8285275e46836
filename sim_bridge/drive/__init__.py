"""The ways to drive a world: in lockstep, on the wall clock for others, and over external autopilots."""
