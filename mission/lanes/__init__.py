"""Lanes over a stand that is surveyed: how far a swarm spreads across its course (spread), and the lanes laid (lay)."""
