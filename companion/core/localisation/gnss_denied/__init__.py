"""Localisation where not all receive GNSS: by odometry and inter-vehicle ranging."""
