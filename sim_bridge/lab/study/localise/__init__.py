"""How well vehicles find each other by odometry and ranges: the core's relative filter judged against the truth."""
