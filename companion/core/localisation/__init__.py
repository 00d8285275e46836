"""Where the neighbours are, and where this vehicle is among them: with satellites on all, or by ranges and odometry."""
