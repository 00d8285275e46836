"""How well vehicles find each other by odometry and ranges: companion.core.relative judged against the truth."""
