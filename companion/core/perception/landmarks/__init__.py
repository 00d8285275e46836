"""Landmarks of level scans: stems and walls, and their tracks."""
