"""What stands still, in level scans: stems and walls, and their tracks."""
