"""Forests: generated from a seed or read from a stem map, their figures and drawings."""
