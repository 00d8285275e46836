"""Algorithm 1 of the paper, for simulation only: as printed, and in the reading that flies."""
