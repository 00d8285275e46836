"""The live map of a flight: rows go out, what viewers ask for comes in between two ticks, and sets the pace."""
