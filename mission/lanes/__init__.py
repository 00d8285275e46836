"""Lanes over a stand that is surveyed: a swarm's line abreast on them (spread), and the lanes laid (lay)."""
