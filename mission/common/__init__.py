"""Shared by all three programs: frames, exit codes, signals, addresses, problems with their places."""
