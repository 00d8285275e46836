"""What to fly. And the version of the whole distribution, here because everything may import this package."""

__version__ = "0.1.0"
