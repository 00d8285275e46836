"""For all tests: hypothesis draws the same examples every time, and a slow machine fails nothing."""

from __future__ import annotations

from hypothesis import settings

settings.register_profile("understory", derandomize=True, deadline=None)
settings.load_profile("understory")
