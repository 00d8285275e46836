"""Landmarks of level scans: stems and walls, their tracks, and constellations of trunks held against each other."""
