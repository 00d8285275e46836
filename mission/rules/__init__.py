"""Rules that must hold between the keys of a mission."""
