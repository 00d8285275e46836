"""The mission: what to fly. And the distribution's version, here because everything may import this package."""

from mission.common import compiled as compiled  # first: it settles where all other modules come from

__version__ = "0.2.0"
