"""The schema of our own messages, and what is generated from it: `python -m companion.mavlink.schema`."""
