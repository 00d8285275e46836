"""Flights recorded, measured, judged and shown."""
