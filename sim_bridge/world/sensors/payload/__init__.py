"""Sensors of `[[payload]]`: fields.py, the truth about a stand; drivers.py, what vehicles tell of it."""
