"""Fuzzing of all that reads bytes from outside: `python -m tests.fuzz`. targets.py lists what; campaign.py runs it."""
