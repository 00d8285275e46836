"""`sim-bridge serve`: a world on the wall clock, its ports, its map, and the notice of where to connect."""
