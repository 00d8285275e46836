"""The ways to drive a world: in lockstep, on the wall clock for others (serve), and over external autopilots."""
