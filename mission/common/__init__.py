"""What all three programs share: frames, exit codes, signals, addresses, problems with their places."""
