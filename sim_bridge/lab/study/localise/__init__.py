"""Accuracy of relative localisation by odometry and ranges: the core's relative filter judged against the truth."""
