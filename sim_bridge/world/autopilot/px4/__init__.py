"""PX4, as its MAVLink clients see it: commands become a mode, the mode a desired velocity; failsafes act."""
