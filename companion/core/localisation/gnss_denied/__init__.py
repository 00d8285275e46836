"""Localisation where not all receive GNSS: by odometry, inter-vehicle ranging and shared trunks."""
